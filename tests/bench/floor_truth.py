"""Public annotations of floor maps: doors, contacts of rooms, hand-made graphs."""

from __future__ import annotations

import json
import lzma
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml

from perception.grid import FREE, OCCUPIED, Frame
from perception.rosmap import read_ros_map
from tests.bench.data import data_path

RESOLUTION = 0.05
_LEAST_CONTACT_M = 0.4


@dataclass(frozen=True)
class Floor:
    """A grid with its frame, and segments (n, 2, 2) of doors, map frame, by name."""

    image: np.ndarray
    frame: Frame
    doors: dict[str, np.ndarray]


@dataclass(frozen=True)
class HandGraph:
    """A hand-made graph over a grid: positions (n, 2) and pairs of nodes, map frame."""

    image: np.ndarray
    frame: Frame
    nodes: np.ndarray
    links: list[tuple[int, int]]


def read_levels(path: Path) -> np.ndarray:
    """Read an image as grey levels, packed or not."""
    data = path.read_bytes()
    if path.suffix == ".xz":
        data = lzma.decompress(data)
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)


def load_gdc(name: str) -> Floor | None:
    """Load a floor of the GDC building with its doors."""
    folder = data_path("maps", "utexas_gdc", name)
    if folder is None:
        return None
    ros_map = read_ros_map(folder / f"{name}.yaml")
    doors = {
        door["name"]: np.array([door["door_corner_pt_1"], door["door_corner_pt_2"]], float)
        for door in yaml.safe_load((folder / "doors.yaml").read_text())
    }
    return Floor(ros_map.image, ros_map.frame, doors)


def load_gdc_openings(name: str) -> dict[str, np.ndarray]:
    """Load the middles (n, 2) of openings listed by hand, map frame, by kind."""
    path = Path(__file__).parent / "truth" / "gdc_openings.json"
    entries = json.loads(path.read_text())[name]
    return {
        kind: np.array([e["at"] for e in entries if e["kind"] == kind], float).reshape(-1, 2)
        for kind in ("opening", "bay")
    }


def list_ipa() -> list[Path]:
    """Return the segmentations of the ipa maps with ground truth."""
    folder = data_path("maps", "ipa_room_segmentation")
    return sorted(folder.glob("*_gt_segmentation.png")) if folder else []


def load_ipa(
    truth: Path, *, furnished: bool
) -> tuple[np.ndarray, Frame, list[tuple[np.ndarray, float]]]:
    """Return grid, frame, and contacts of rooms: (n, 2) points in metres, and width.

    A contact is where two rooms of the segmentation meet in free space, at least 0.4 m wide.
    """
    name = str(truth).removesuffix("_gt_segmentation.png")
    plain = read_levels(Path(f"{name}.png"))
    grid = read_levels(Path(f"{name}_furnitures.png")) if furnished else plain
    frame = Frame(0.0, len(grid) * RESOLUTION, RESOLUTION)
    near = _spread_rooms(read_levels(truth), plain > 205)
    edge = np.zeros(near.shape, np.uint8)
    edge[:, :-1] |= (near[:, :-1] != near[:, 1:]) & (near[:, :-1] > 0) & (near[:, 1:] > 0)
    edge[:-1] |= (near[:-1] != near[1:]) & (near[:-1] > 0) & (near[1:] > 0)
    count, labels = cv2.connectedComponents(cv2.dilate(edge, np.ones((3, 3), np.uint8)))
    rows, columns = np.nonzero(edge)
    contacts = []
    for k in range(1, count):
        own = labels[rows, columns] == k
        points = np.column_stack([columns[own], rows[own]])
        width = float(np.ptp(points, axis=0).max()) * RESOLUTION
        if width >= _LEAST_CONTACT_M:
            contacts.append((frame.to_metres(points), width))
    return grid, frame, contacts


def _spread_rooms(segmentation: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the number of the nearest room of each free cell within 0.6 m of one, else 0."""
    white = (segmentation > 250).astype(np.uint8)
    _, rooms, stats, _ = cv2.connectedComponentsWithStats(white, connectivity=4)
    rooms[stats[rooms, cv2.CC_STAT_AREA] < 400] = 0
    distance, labels = cv2.distanceTransformWithLabels(
        (rooms == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.zeros(labels.max() + 1, np.int32)
    table[labels[rooms > 0]] = rooms[rooms > 0]
    near = table[labels]
    near[~free | (distance > 12)] = 0
    return near


STRANDS = {
    "aachen": ("strands/aachen", "UMIC_first_floor", "UMIC_FF.yaml.xz"),
    "tsc": ("strands/tsc", "tsc", "tsc2015.yaml.xz"),
    "aaf_y3": ("strands/aaf_y3", "aaf_deployment16-cropped", "aaf_deployment16.tpl.xz"),
    "aaf_y4": ("strands/aaf_y4", "y4_aaf-cropped", "aaf_y4.tpl.xz"),
}


def load_strands(name: str) -> HandGraph | None:
    """Load a site of the STRANDS project with its topological map."""
    place, stem, graph = STRANDS[name]
    folder = data_path("maps", *place.split("/"))
    if folder is None:
        return None
    sheet = yaml.safe_load((folder / f"{stem}.yaml").read_text())
    levels = read_levels(folder / f"{stem}.pgm.xz")
    resolution = float(sheet["resolution"])
    x, y = sheet["origin"][:2]
    frame = Frame(x, y + len(levels) * resolution, resolution)
    entries = yaml.load(
        lzma.decompress((folder / graph).read_bytes()),
        Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader),
    )
    number = {entry["node"]["name"]: k for k, entry in enumerate(entries)}
    positions = [entry["node"]["pose"]["position"] for entry in entries]
    links = {
        tuple(sorted((number[entry["node"]["name"]], number[edge["node"]])))
        for entry in entries
        for edge in entry["node"]["edges"]
        if edge["node"] in number and edge["node"] != entry["node"]["name"]
    }
    image = np.where(levels > 205, FREE, np.where(levels < 89, OCCUPIED, 205)).astype(np.uint8)
    nodes = np.array([[p["x"], p["y"]] for p in positions], float)
    return HandGraph(image, frame, nodes, sorted(links))


def load_amrl(name: str) -> HandGraph | None:
    """Load a floor of the AMRL maps: walls drawn 10 cm thick, and its navigation graph."""
    walls = data_path("maps", "amrl", f"{name}.vectormap.json.xz")
    graph = data_path("maps", "amrl", f"{name}.navigation.json")
    if walls is None or graph is None:
        return None
    segments = np.array(
        [
            [[wall["p0"]["x"], wall["p0"]["y"]], [wall["p1"]["x"], wall["p1"]["y"]]]
            for wall in json.loads(lzma.decompress(walls.read_bytes()))
        ]
    )
    data = json.loads(graph.read_text())
    low, high = segments.min(axis=(0, 1)) - 1, segments.max(axis=(0, 1)) + 1
    columns, rows = np.ceil((high - low) / RESOLUTION).astype(int)
    frame = Frame(float(low[0]), float(low[1]) + rows * RESOLUTION, RESOLUTION)
    image = np.full((rows, columns), FREE, np.uint8)
    for one, other in np.round(frame.to_pixels(segments)).astype(int):
        cv2.line(image, one.tolist(), other.tolist(), OCCUPIED, 2)
    number = {node["id"]: k for k, node in enumerate(data["nodes"])}
    nodes = np.array([[node["loc"]["x"], node["loc"]["y"]] for node in data["nodes"]], float)
    links = [(number[edge["s0_id"]], number[edge["s1_id"]]) for edge in data["edges"]]
    return HandGraph(image, frame, nodes, links)


_FARTHEST_M = 8.0


def count_ways(image: np.ndarray, frame: Frame, points: np.ndarray) -> np.ndarray:
    """Return (n,) how many ways lead on from each point, without a skeleton.

    The free space around a point, just beyond its clearance, falls into so many parts of more than
    0.25 m2; the most over four rings.
    """
    resolution = frame.resolution_m
    solid = (image != FREE).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(solid, connectivity=8)
    small = stats[:, 2:4].max(axis=1) * resolution < 0.7
    small[0] = False
    free = np.pad(((solid == 0) | small[labels]).astype(np.uint8), 1)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)
    reach = round(_FARTHEST_M / resolution)
    found = []
    for x, y in (np.round(frame.to_pixels(points)).astype(int) + 1).tolist():
        left, top = max(x - reach, 0), max(y - reach, 0)
        part = free[top : y + reach + 1, left : x + reach + 1]
        rows, columns = np.indices(part.shape)
        away = np.hypot(columns - (x - left), rows - (y - top)) * resolution
        clearance = float(distance[y, x]) * resolution
        most = 0
        for beyond in (0.4, 0.8, 1.2, 1.6):
            first, last = clearance + beyond, clearance + beyond + 0.5
            disc = ((away <= last) & (part > 0)).astype(np.uint8)
            _, around = cv2.connectedComponents(disc, connectivity=4)
            ring = (around == around[y - top, x - left]) & (away > first) & (disc > 0)
            stats = cv2.connectedComponentsWithStats(ring.astype(np.uint8), connectivity=4)[2]
            most = max(most, int((stats[1:, cv2.CC_STAT_AREA] * resolution**2 > 0.25).sum()))
        found.append(most)
    return np.array(found)
