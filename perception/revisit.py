"""Looking at a place again once the robot has left it: one map of the whole passage.

While the robot drives, its map shows what lies ahead and what it has passed, so two passages in
opposite directions show different halves of one crossing. A map centred on the place, of all scans
taken on the way to it and away from it, is much the same from whichever side it was entered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array
from perception.grid import OCCUPIED
from perception.lpm import LocalMap
from perception.scanlog import ScanLog
from perception.sightings import PlaceSettings, Sighting, read_topology

REACH_M = 10.0
"""Scans taken nearer than this to the centre, without a break, make the map."""

MOST_SCANS = 80
"""Of more scans than this, evenly chosen ones make the map."""

WINDOW_M = 12.0
"""The place is read in a window so wide: a room that was entered is known to its last corner, and
leads nowhere; of one that was passed by, the end is unknown. So near the place both go on."""

ASIDE_M = 0.3
"""The local topology is read at the centre, and so far from it to four sides, where no wall lies in
between: the centre of a large place may be in a pillar, or at the corner of a wall."""

ON_WAY_M, MOST_ON_WAY = 1.5, 3
"""It is read as well where the robot was, so near to the centre, at so many poses."""

SLIM_VOTE = 0.12
"""It is read once more for a robot slimmer by a cell on both sides, with such a vote: how wide
a narrow way is, is known to a cell."""

SAME_M = 2.0
"""What is read further than this from the centre is another place."""


def map_passage(
    log: ScanLog, poses: Array, centre_m: Array, scan: int, settings: PlaceSettings
) -> LocalMap:
    """Draw the surroundings of a place from all scans of one passage.

    Parameters
    ----------
    log : the scans. poses : (n, 3) of the laser, drive frame.
    centre_m : (2,) of the place, drive frame. scan : one taken in the place.

    Source
    ------
    Ours.
    """
    near = np.hypot(*(poses[:, :2] - centre_m).T) < REACH_M
    first = last = scan
    while first > 0 and near[first - 1]:
        first -= 1
    while last < len(poses) - 1 and near[last + 1]:
        last += 1
    local = LocalMap(settings.lpm_m, settings.cell_m, settings.range_cap_m)
    local.scroll_to(centre_m)
    count = min(last - first + 1, MOST_SCANS)
    for i in np.linspace(first, last, count).round().astype(int):
        local.add_scan(poses[i], log.ranges_m[i], log.angles_rad)
    return local


def look_again(
    local: LocalMap,
    poses: Array,
    centre_m: Array,
    passage: tuple[int, int, int],
    settings: PlaceSettings,
    slimmer_cells: Sequence[int] = (0, 1),
) -> list[Sighting]:
    """Read the local topology of a place in the map of its passage, from a few points in it.

    Parameters
    ----------
    local : see :func:`map_passage`, centred on the place. poses : (n, 3) of the laser, drive frame.
    centre_m : (2,) of the place, drive frame.
    passage : the first scan of the passage, the one nearest to the centre, and the last.
    slimmer_cells : it is read for robots slimmer by so many cells on both sides, until one finds
        nothing.

    Source
    ------
    Ours.
    """
    first, nearest, last = passage
    local = local.shrink_to(min(WINDOW_M, settings.lpm_m))
    sides = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], float)
    around = np.asarray(centre_m, float) + ASIDE_M * sides
    points = list(around[~find_walled_off(local, poses[nearest], around, 0.0)])
    way = poses[first : last + 1, :2]
    way = way[np.hypot(*(way - centre_m).T) < ON_WAY_M]
    if len(way):
        chosen = np.linspace(0, len(way) - 1, min(len(way), MOST_ON_WAY)).round().astype(int)
        points += list(way[chosen])
    found = list[Sighting]()
    for cells in slimmer_cells:
        radius_m = max(settings.robot_radius_m - cells * settings.cell_m, 0.0)
        how = replace(settings, robot_radius_m=radius_m, by_sight=True)
        read = [read_topology(nearest, poses, local, how, at_m=point) for point in points]
        near = [s for s in read if s is not None and np.hypot(*(s.centre_m - centre_m)) < SAME_M]
        if not near:
            break
        found += [replace(s, vote=SLIM_VOTE) for s in near] if cells else near
    return found


def find_walled_off(
    local: LocalMap, pose: Array, points_m: Array, width_m: float
) -> NDArray[np.bool_]:
    """Tell of each point whether walls, or gaps narrower than a width, part a pose from it.

    Parameters
    ----------
    local : see :func:`map_passage`. pose : (3,) of the laser. points_m : (n, 2). All drive frame.
    width_m : pieces of wall so near to each other are one.

    Source
    ------
    Ours.
    """
    frame = local.frame
    side = 2 * round(width_m / 2 / frame.resolution_m) + 1
    occupied = (local.image() == OCCUPIED).astype(np.uint8)
    solid = cv2.morphologyEx(occupied, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    start, ends = frame.to_pixels(pose[:2]), frame.to_pixels(np.asarray(points_m, float))
    share = np.linspace(0.0, 1.0, 2 * len(solid))[:, None]
    parted = []
    for end in ends.reshape(-1, 2):
        x, y = np.rint(start + share * (end - start)).astype(int).T
        on = (x >= 0) & (y >= 0) & (x < solid.shape[1]) & (y < solid.shape[0])
        parted.append(bool(solid[y[on], x[on]].any()))
    return np.array(parted, bool)


def touches_wall(local: LocalMap, point_m: Array, radius_m: float) -> bool:
    """Tell whether a wall lies within a radius of a point (2,), drive frame.

    Source
    ------
    Ours.
    """
    rows, columns = np.nonzero(local.image() == OCCUPIED)
    away = np.column_stack([columns, rows]) - local.frame.to_pixels(np.asarray(point_m, float))
    return bool(np.hypot(*away.T).min(initial=np.inf) * local.frame.resolution_m < radius_m)
