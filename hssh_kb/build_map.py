"""A finished floor map becomes a knowledge base: a virtual robot explores its place graph.

The robot knows where it is, so the map hypothesis is the place graph itself; it is held to the
same axioms as any other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hssh_kb.errors import InputError
from hssh_kb.floor_walk import FloorWalk, walk_floor
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.ranking import RankedMaps
from hssh_kb.records import BuildRecord, PlaceLayout, Raster, Trajectory
from perception.floor_graph import FloorMap
from perception.floor_level import FloorDoors
from perception.floor_map import explore_floor
from perception.geometry import Array
from perception.grid import UNKNOWN, Frame, Image

if TYPE_CHECKING:
    from hssh_kb.build import Clock
    from hssh_kb.kb import KnowledgeBase

SPEED_M_S = 0.5
"""How fast the virtual robot goes."""

_STEP_M = 0.2
_MARGIN_CELLS, _MARGIN_M = 10, 6.0
_SIGMA = (0.01, 0.01, 0.002)


def build_from_floor_map(
    path: str | Path,
    *,
    names: str | Path | None = None,
    start_m: tuple[float, float] | None = None,
    force: bool = False,
    doors: FloorDoors = "keep",
    min_gateway_m: float = 0.0,
    progress: Callable[[str, int, int], None] | None = None,
    clock: Clock | None = None,
) -> KnowledgeBase:
    """Build a knowledge base from a ROS map.

    Parameters
    ----------
    path : the yaml file; see :func:`perception.rosmap.read_ros_map`.
    names : a file of room polygons; see :func:`perception.rooms.read_rooms`.
    start_m : a point (map frame) of the part of the floor wanted, where the walk begins; the
        largest part by default.
    force : read images of more than 60 million cells too.
    doors : "ignore" leaves out the rooms behind doors; a door between two corridors stays.
    min_gateway_m : what can be reached through narrower gateways only is left out.

    Returns
    -------
    Its first and only map is the place graph of the floor, laid out where the places are; what
    contradicts the axioms, or could not be used, is told in the notices of its record.

    Raises
    ------
    InputError : the files cannot be read, or there is nothing to explore.
    """
    from hssh_kb.build import Clock
    from perception.rooms import read_rooms
    from perception.rosmap import read_ros_map

    report = progress or _report_nothing
    clock = clock or Clock()
    with clock.stage("read"):
        ros_map = read_ros_map(path, force=force)
        rooms = read_rooms(names, ros_map) if names is not None else {}
    with clock.stage("places"):
        report("places", 0, 1)
        floor = explore_floor(
            ros_map.image,
            ros_map.frame,
            start_m=start_m,
            rooms_m=rooms,
            doors=doors,
            min_gateway_m=min_gateway_m,
        )
        report("places", 1, 1)
    notices = [*ros_map.notices, *_tell_parts(floor), *_tell_rooms(floor, rooms)]
    with clock.stage("walk"):
        walk = walk_floor(floor, source=ros_map.source, start_m=start_m)
    return make_floor_kb(
        floor,
        walk,
        ros_map.image,
        ros_map.frame,
        notices=notices,
        seconds=clock.seconds,
        options={
            "names": str(names) if names is not None else None,
            "start_m": list(start_m) if start_m is not None else None,
            "doors": doors,
            "min_gateway_m": min_gateway_m,
        },
    )


def _report_nothing(stage: str, done: int, total: int) -> None:
    """Take the place of a progress bar."""


def make_floor_kb(
    floor: FloorMap,
    walk: FloorWalk,
    image: Image,
    frame: Frame,
    *,
    notices: Sequence[str] = (),
    seconds: dict[str, float] | None = None,
    options: dict[str, object] | None = None,
) -> KnowledgeBase:
    """Return the knowledge base of a walk over a floor; see :func:`build_from_floor_map`."""
    from hssh_kb.build import own_version
    from hssh_kb.kb import KnowledgeBase

    hypothesis = walk.hypothesis
    drive, scans = _drive(floor, walk)
    length = np.hypot(*np.diff(drive[:, :2], axis=0, prepend=drive[:1, :2]).T)
    return KnowledgeBase(
        walk.experience,
        RankedMaps((hypothesis,), "posterior"),
        (_lay_out(floor, walk, hypothesis),),
        trajectory=Trajectory(drive, np.cumsum(length) / SPEED_M_S, scans),
        global_map=_crop(image, frame, floor.skeleton_m),
        record=BuildRecord(
            source=walk.experience.source,
            version=own_version(),
            seconds=seconds or {},
            notices=(*notices, *walk.notices),
            options=options or {},
        ),
    )


def _tell_parts(floor: FloorMap) -> list[str]:
    """Tell of the parts of the floor that were left out."""
    parts = floor.other_parts
    if not parts:
        return []
    told = "; ".join(f"{area:.0f} m2, --start={x:.2f},{y:.2f}" for area, (x, y) in parts[:4])
    more = "; ..." if len(parts) > 4 else ""
    several = len(parts) > 1
    return [
        f"{len(parts)} other part{'s' * several} of the floor cannot be reached from here and "
        f"{'are' if several else 'is'} left out ({told}{more})"
    ]


def _tell_rooms(floor: FloorMap, rooms: dict[str, list[Array]]) -> list[str]:
    """Tell of named rooms that no place lies in."""
    found = {name for place in floor.places for name in place.names}
    lost = [name for name in rooms if name not in found]
    if not lost:
        return []
    if not found:
        raise InputError(
            f"none of the {len(rooms)} named rooms lies in the part of the floor that is explored; "
            "do the names belong to this map?"
        )
    shown = ", ".join(lost[:8]) + (", ..." if len(lost) > 8 else "")
    return [f"no way leads into {len(lost)} of the {len(rooms)} named rooms: {shown}"]


def _drive(floor: FloorMap, walk: FloorWalk) -> tuple[Array, np.ndarray]:
    """Return the poses of the virtual robot, and at which of them each visit is."""
    pieces = [np.array([floor.places[walk.places[0]].centre_m])]
    scans, count = [0], 1
    for edge_number, forward in walk.travels:
        points = floor.edges[edge_number].points_m
        points = _resample(points if forward else points[::-1])[1:]
        pieces.append(points)
        count += len(points)
        scans.append(count - 1)
    points = np.concatenate(pieces)
    ahead = np.diff(points, axis=0, append=2 * points[-1:] - points[-2:-1])
    if len(points) == 1:
        ahead = np.array([[1.0, 0.0]])
    return np.column_stack([points, np.arctan2(ahead[:, 1], ahead[:, 0])]), np.array(scans)


def _resample(points: Array) -> Array:
    """Return points along a polyline about 0.2 m apart, its ends kept."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(math.ceil(along[-1] / _STEP_M), 1) + 1)
    return np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])


def _lay_out(floor: FloorMap, walk: FloorWalk, hypothesis: Hypothesis) -> PlaceLayout:
    centres = [floor.places[walk.places[first]].centre_m for first in hypothesis.places]
    poses = np.column_stack([np.array(centres).reshape(-1, 2), np.zeros(len(centres))])
    covariance = np.diag(np.square(_SIGMA))
    return PlaceLayout(poses, np.repeat(covariance[None], len(centres), axis=0), 0.0)


def _crop(image: Image, frame: Frame, skeleton_m: Array) -> Raster:
    """Return the part of a map that is explored, with a margin, where anything is known."""
    resolution = frame.resolution_m
    ends = frame.to_pixels(np.array([skeleton_m.min(axis=0), skeleton_m.max(axis=0)]))
    low, high = np.sort(ends[:, ::-1].astype(np.int64), axis=0)  # rows, columns
    margin = math.ceil(_MARGIN_M / resolution)
    low, high = np.maximum(low - margin, 0), high + margin + 1
    known = image[low[0] : high[0], low[1] : high[1]] != UNKNOWN
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    top, left = (
        max(int(low[k] + at[0]) - _MARGIN_CELLS, 0) for k, at in enumerate((rows, columns))
    )
    bottom, right = (
        int(low[k] + at[-1]) + _MARGIN_CELLS + 1 for k, at in enumerate((rows, columns))
    )
    part = image[top:bottom, left:right]
    corner = Frame(frame.left_m + left * resolution, frame.top_m - top * resolution, resolution)
    return Raster(np.ascontiguousarray(part), corner)
