"""Pictures of drives through places: where the walls are, where the robot went, what it saw."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from perception.draw import draw_topology
from perception.lpm import LocalMap
from perception.places import PlaceSettings, PlaceVisit
from perception.sightings import read_topology
from perception.topology import local_topology
from tests.perception.corridor_worlds import CorridorWorld
from tests.perception.place_drives import Entry

PIXELS_A_METRE = 22
INK, WAY, FOUND, STRAY = (40, 40, 40), (200, 140, 60), (60, 140, 30), (40, 40, 220)


def draw_entries(
    world: CorridorWorld, node: int, entries: Sequence[Entry], settings: PlaceSettings
) -> np.ndarray:
    """Draw one panel an entry: the drive with its visits, and the local map beside it."""
    return np.vstack([draw_entry(world, node, entry, settings) for entry in entries])


def draw_entry(
    world: CorridorWorld, node: int, entry: Entry, settings: PlaceSettings
) -> np.ndarray:
    """Draw one drive: green what was found at the place, red what was found elsewhere."""
    side, at = 17 * PIXELS_A_METRE, world.nodes[node]
    picture = np.full((side, side, 3), 255, np.uint8)

    def pixel(point: np.ndarray) -> tuple[int, int]:
        x, y = (np.asarray(point)[:2] - at) * PIXELS_A_METRE + side / 2
        return round(float(x)), round(side - float(y))

    for x0, y0, x1, y1 in world.segments:
        cv2.line(picture, pixel((x0, y0)), pixel((x1, y1)), INK, 2)
    for a, b in zip(entry.poses[:-1], entry.poses[1:], strict=True):
        cv2.line(picture, pixel(a), pixel(b), WAY, 1)
    cv2.circle(picture, pixel(entry.poses[0]), 4, WAY, -1)
    for visits, colour in ((entry.visits, FOUND), (entry.strays, STRAY)):
        for visit in visits:
            _draw_visit(picture, pixel, visit, colour)
    return np.hstack([picture, draw_local_map(entry, _nearest(entry, at), settings, side)])


def draw_stray(world: CorridorWorld, entry: Entry, settings: PlaceSettings) -> np.ndarray:
    """Draw the first place that was found where there is none, with the local map there."""
    scan = entry.strays[0].scan
    return draw_local_map(entry, scan, settings, 17 * PIXELS_A_METRE)


def _nearest(entry: Entry, at: np.ndarray) -> int:
    return int(np.argmin(np.hypot(*(entry.poses[:, :2] - at).T)))


def _draw_visit(picture: np.ndarray, pixel, visit: PlaceVisit, colour: tuple) -> None:
    cv2.circle(picture, pixel(visit.centre_m), 5, colour, 2)
    reading = visit.readings[0]
    for heading, alpha, gate in zip(
        reading.headings_rad, reading.star.alpha, reading.gateways_m, strict=True
    ):
        start = visit.centre_m + np.nan_to_num(np.array(gate))
        end = start + (1.5 if alpha else 0.7) * np.array([math.cos(heading), math.sin(heading)])
        cv2.arrowedLine(picture, pixel(start), pixel(end), colour, 2 if alpha else 1, tipLength=0.2)
    for row, reading in enumerate(visit.readings[:4]):
        text = f"{reading.weight:.2f} {reading.star}"
        y = pixel(visit.centre_m)[1]
        cv2.putText(picture, text, (8, y + 16 * row + 40), 0, 0.4, colour, 1, cv2.LINE_AA)


def draw_local_map(entry: Entry, scan: int, settings: PlaceSettings, side: int) -> np.ndarray:
    """Draw the local map of the robot at a scan with the topology read there."""
    local = LocalMap(settings.lpm_m, settings.cell_m, settings.range_cap_m)
    for k in range(scan + 1):
        local.update(entry.poses[k], entry.log.ranges_m[k], entry.log.angles_rad)
    sighting = read_topology(scan, entry.poses, local, settings)
    if sighting is not None:
        topology = sighting.topology
    else:
        column, row = local.frame.to_pixels(entry.poses[scan, :2])
        topology = local_topology(
            local.image(),
            robot_px=(float(column), float(row)),
            resolution_m=settings.cell_m,
            robot_radius_m=settings.robot_radius_m,
            min_frontier_m=settings.min_frontier_m,
            min_depth_m=settings.min_depth_m,
            denoise=False,
        )
    return cv2.resize(draw_topology(local.image(), topology), (side, side))
