"""The space a robot can pass in a finished floor map, and its walls as closed contours.

Unlike the surroundings of a robot (:mod:`perception.region`) a finished map has no exits: what was
never seen is not passed. Each wall contour is closed, and two points of it are told apart by how
far apart they are along the contour.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from perception.errors import InputError
from perception.geometry import Array, measure_along
from perception.grid import Image, Mask, classify
from perception.region import Index, Region

_FULL = np.ones((3, 3), np.uint8)
_SMOOTH_M = 0.8
"""Walls are measured along a contour smoothed so far, lest roughness count as length."""
_INSET_M, _SHEET_SHARE, _SHEET_CLEARANCE_M = 0.4, 0.1, 4.0
"""A part along more of the edge of the map than this share, and so wide, surrounds the floor."""
_LEAST_INDOORS = 0.2
"""Unless every other part is smaller than this share of it."""
_BETWEEN_CONTOURS = 1 << 18
"""Added to the position along the contour from one contour to the next."""


OtherPart = tuple[float, tuple[float, float]]


@dataclass(frozen=True)
class FloorSettings:
    """Lengths in metres by which a floor map is read.

    Attributes
    ----------
    robot_radius_m : half the width of the robot.
    speck_m : groups of cells that are not free and smaller than this both ways become free.
    opening_m : free space narrower than twice this is no space.
    midline_m : M; in wider space the skeleton follows the walls at this distance.
    least_part_m2 : parts of the floor smaller than this are not told of.

    Source
    ------
    Ours; measured on the annotated floors of tests/bench/bench_floor_maps.py.
    """

    robot_radius_m: float = 0.25
    speck_m: float = 0.7
    opening_m: float = 0.15
    midline_m: float = 1.5
    least_part_m2: float = 4.0


@dataclass(frozen=True, eq=False)
class FloorSpace:
    """One connected part of a floor, cropped to itself.

    Attributes
    ----------
    region : its passable cells and walls; pixel coordinates are those of the crop.
    position : (n,) int32 place of each wall cell along its contour, in cells; the positions on
        different contours are far apart.
    lengths : length of the contour of each arc, in cells.
    corner_px : (column, row) of the crop in the map.
    occupied : (H, W) mask of the occupied cells of the crop.
    resolution_m : side of a cell.
    other_parts : the parts of the floor left out, largest first: (area in m2, a point of it in
        pixels of the whole map).
    """

    region: Region
    position: NDArray[np.int32]
    lengths: Index
    corner_px: tuple[int, int]
    occupied: Mask
    resolution_m: float
    other_parts: tuple[OtherPart, ...]

    def to_map(self, points_px: Array) -> Array:
        """Carry points (..., 2) of the crop to pixels of the whole map."""
        return np.asarray(np.asarray(points_px, float) + np.array(self.corner_px, float))


def find_floor_space(
    image: Image,
    resolution_m: float,
    settings: FloorSettings | None = None,
    *,
    start_px: tuple[float, float] | None = None,
) -> FloorSpace:
    """Find the part of a floor that holds a start, or the largest one.

    Parameters
    ----------
    image : (H, W) uint8, dark occupied, light free; row 0 at the top.
    resolution_m : side of a cell.
    start_px : (column, row) within the part wanted; by default the largest part, but not what
        surrounds a drawn plan.

    Raises
    ------
    InputError : no free space wide enough for the robot, or none around the start.
    """
    settings = settings or FloorSettings()
    free = _remove_specks(image, settings.speck_m / resolution_m)
    radius = settings.robot_radius_m / resolution_m
    distance = _measure_distance(free)
    count, *found = cv2.connectedComponentsWithStats(
        (distance >= radius).view(np.uint8), connectivity=4, ltype=cv2.CV_32S
    )
    labels, stats = np.asarray(found[0], np.int32), np.asarray(found[1], np.int32)
    if count < 2:
        raise InputError(
            f"the map has no free space that a robot {2 * settings.robot_radius_m:g} m wide can "
            "pass; check its thresholds, 'negate' and resolution"
        )
    sheet = _find_sheet(labels, distance, len(stats), resolution_m)
    chosen = _choose(labels, stats, radius, start_px, sheet)
    others = _list_others(labels, stats, distance, chosen, settings, resolution_m)
    margin = int(np.ceil(radius)) + 2
    x, y, w, h = (int(v) for v in stats[chosen, :4])
    x0, y0 = max(x - margin, 0), max(y - margin, 0)
    window = (slice(y0, y + h + margin), slice(x0, x + w + margin))
    wide = labels[window] == chosen
    inside = _open(free[window], distance[window], wide, settings.opening_m / resolution_m)
    start = _find_start(wide, distance[window])
    region, position, lengths = _trace_walls(inside, start, max(round(_SMOOTH_M / resolution_m), 1))
    occupied = classify(image[window]).occupied
    return FloorSpace(region, position, lengths, (x0, y0), occupied, resolution_m, others)


def _list_others(
    labels: NDArray[np.int32],
    stats: NDArray[np.int32],
    distance: NDArray[np.float32],
    chosen: int,
    settings: FloorSettings,
    resolution_m: float,
) -> tuple[OtherPart, ...]:
    """Return area and the widest point of each part that was not chosen, largest first."""
    areas = stats[:, cv2.CC_STAT_AREA] * resolution_m**2
    others = []
    for k in np.flatnonzero(areas >= settings.least_part_m2).tolist():
        if k in (0, chosen):
            continue
        x, y, w, h = (int(v) for v in stats[k, :4])
        window = (slice(y, y + h), slice(x, x + w))
        inner = np.where(labels[window] == k, distance[window], -1.0)
        row, column = divmod(int(inner.argmax()), w)
        others.append((float(areas[k]), (float(x + column), float(y + row))))
    return tuple(sorted(others, reverse=True))


def _remove_specks(image: Image, speck_px: float) -> Mask:
    """Return the free cells, small things standing in them removed."""
    free = classify(image).free
    solid = (~free).view(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(solid, connectivity=8)
    height, width = free.shape
    x, y, w, h = (stats[:, k] for k in range(4))
    small = (np.maximum(w, h) < speck_px) & (x > 0) & (y > 0) & (x + w < width) & (y + h < height)
    small[0] = False
    if count > 1 and small.any():
        free = free | small[labels]
    free[0], free[-1], free[:, 0], free[:, -1] = False, False, False, False
    return free


def _measure_distance(free: Mask) -> NDArray[np.float32]:
    """Return the distance of each cell to the nearest one that is not free, less half a cell."""
    found = cv2.distanceTransform(free.view(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(found - 0.5, np.float32)


def _choose(
    labels: NDArray[np.int32],
    stats: NDArray[np.int32],
    radius_px: float,
    start_px: tuple[float, float] | None,
    sheet: Mask,
) -> int:
    """Return the label of the part that holds the start, or of the largest.

    What surrounds a drawn plan, free to the edge of the sheet, is not taken for the floor.
    """
    if start_px is None:
        area = stats[:, cv2.CC_STAT_AREA].astype(float)
        area[0] = 0
        indoors = area * ~sheet
        large = indoors.max() >= _LEAST_INDOORS * area.max()
        return int(np.argmax(indoors if large else area))
    height, width = labels.shape
    x, y = round(start_px[0]), round(start_px[1])
    if not (0 <= x < width and 0 <= y < height):
        raise InputError(
            f"the start lies at column {x}, row {y}, outside the map of {width} x {height} cells"
        )
    reach = 4 * int(np.ceil(radius_px)) + 2
    x0, y0 = max(x - reach, 0), max(y - reach, 0)
    near = labels[y0 : y + reach + 1, x0 : x + reach + 1]
    rows, columns = np.nonzero(near)
    if not len(rows):
        raise InputError(
            f"the start at column {x}, row {y} lies in no free space wide enough for the robot; "
            "give a point in a corridor or room"
        )
    k = int(np.argmin((rows + y0 - y) ** 2 + (columns + x0 - x) ** 2))
    return int(near[rows[k], columns[k]])


def _find_sheet(
    labels: NDArray[np.int32], distance: NDArray[np.float32], count: int, resolution_m: float
) -> Mask:
    """Tell which parts are the sheet around a plan: along the edge of the map, and wide open."""
    inset = min(round(_INSET_M / resolution_m), (min(labels.shape) - 1) // 2)
    inner = labels[inset : labels.shape[0] - inset, inset : labels.shape[1] - inset]
    edge = np.concatenate([inner[0], inner[-1], inner[:, 0], inner[:, -1]])
    share = np.bincount(edge, minlength=count) / max(len(edge), 1)
    sheet = np.zeros(count, bool)
    for k in np.flatnonzero(share > _SHEET_SHARE):
        sheet[k] = float(distance[labels == k].max()) * resolution_m > _SHEET_CLEARANCE_M
    return sheet


def _open(free: Mask, distance: NDArray[np.float32], wide: Mask, opening_px: float) -> Mask:
    """Return the free cells within a disc of the opening that fits, joined to the wide ones."""
    fits = (distance >= opening_px).view(np.uint8)
    away = cv2.distanceTransform(1 - fits, cv2.DIST_L2, 5)
    opened = ((away <= opening_px) & free).view(np.uint8)
    _, labels = cv2.connectedComponents(opened, connectivity=4)
    row, column = divmod(int(np.argmax(wide)), wide.shape[1])
    return np.asarray(labels == labels[row, column])


def _find_start(wide: Mask, distance: NDArray[np.float32]) -> tuple[int, int]:
    k = int(np.argmax(np.where(wide, distance, -1.0)))
    row, column = divmod(k, wide.shape[1])
    return column, row


def _trace_walls(
    inside: Mask, start: tuple[int, int], smooth_px: int
) -> tuple[Region, NDArray[np.int32], Index]:
    """Return the region with its walls, their positions, and the length of each contour."""
    contours, _ = cv2.findContours(inside.view(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    walls, arcs, positions, lengths = [], [], [], []
    for number, contour in enumerate(contours):
        points = contour.reshape(-1, 2).astype(np.int64)
        smooth = uniform_filter1d(points.astype(float), smooth_px, axis=0, mode="wrap")
        along = measure_along(np.vstack([smooth, smooth[:1]]))
        walls.append(points)
        arcs.append(np.full(len(points), number))
        positions.append(along[:-1].astype(np.int32))
        lengths.append(max(round(along[-1]), 1))
    offset = 0
    for k, position in enumerate(positions):
        positions[k] = position + np.int32(offset)
        offset += lengths[k] + _BETWEEN_CONTOURS
    wall = np.concatenate(walls)
    region = Region(
        inside,
        start,
        wall,
        np.concatenate(arcs),
        np.full(len(wall), len(wall)),
        (),
        np.zeros(inside.shape, np.int32),
        0.0,
    )
    return region, np.concatenate(positions), np.array(lengths, np.int64)


def measure_wall(space: FloorSpace, one: Index, other: Index) -> Array:
    """Return the length of wall between two wall cells, in cells; infinite on different walls."""
    arc = space.region.arc
    gap = np.abs(space.position[one].astype(np.int64) - space.position[other])
    around = np.minimum(gap, space.lengths[arc[one]] - gap).astype(float)
    around[arc[one] != arc[other]] = np.inf
    return np.asarray(around)
