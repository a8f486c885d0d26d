"""Places of a whole floor: where its skeleton branches, bends or ends, and one in each room."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from perception.gateways import Gateway
from perception.geometry import Array
from perception.skeleton import Branch, Node
from perception.skeleton_graph import SkeletonGraph

PlaceKind = Literal["junction", "corner", "dead end", "room"]

_LEAST_BEND_RAD = math.radians(50.0)
_ARM_M = 1.0
_LEAST_ROOM_M = 1.2
_CORNERS_APART_M = 2.0
_PLACE_SIZE = 1.5

_STAY = 0.1
"""How much the middle of the base points weighs, beside 1 for the line out of a gateway."""

_STEPS = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True, eq=False)
class PlaceNodes:
    """A place as nodes of the skeleton.

    Attributes
    ----------
    nodes : the nodes that make it up.
    kind : see :data:`PlaceKind`.
    """

    nodes: tuple[int, ...]
    kind: PlaceKind


def find_places(
    graph: SkeletonGraph,
    doors: Array,
    resolution_m: float,
    *,
    rooms_px: Sequence[Array] = (),
) -> tuple[PlaceNodes, ...]:
    """Find the places of a floor; branches are split where a place lies on them.

    Parameters
    ----------
    graph : the pruned skeleton; after this every branch leads from place to place or lies within
        one. Tags are the doors on it, as row numbers of ``doors``.
    doors : (n, 2) points of the skeleton that lie in doors.
    resolution_m : side of a cell.
    rooms_px : (n, 2) polygons that shall hold a place each if the skeleton passes them.

    Source
    ------
    Beeson 2008, Algorithm 6.1 (junctions that hold each other are one place, unless a door lies
    between them); corners, and a place in each room, are ours.
    """
    kinds: dict[int, PlaceKind] = {}
    for node in list(graph.at):
        degree = graph.degree(node)
        if degree >= 3:
            kinds[node] = "junction"
        elif degree == 1:
            kinds[node] = "dead end"
    door_cells = {(float(x), float(y)) for x, y in doors}
    for k in list(graph.branches):
        if graph.branches[k].tail in kinds:
            _split_corners(graph, k, door_cells, kinds, resolution_m)
        else:
            _split_ring(graph, k, kinds, resolution_m)
    for k in list(graph.branches):
        _split_rooms(graph, k, door_cells, kinds, resolution_m)
    groups = _group_junctions(graph, kinds, door_cells)
    for k in list(graph.branches):
        _split_loop(graph, k, groups, kinds)
    for polygon in rooms_px:
        _settle_in_room(graph, polygon, kinds)
    groups = _group_junctions(graph, kinds, door_cells)
    return tuple(PlaceNodes(nodes, kinds[nodes[0]]) for nodes in groups)


def find_middle(
    base_px: Array, radii_px: Array, gateways: Sequence[Gateway], widest_px: float
) -> Array:
    """Return the point of a place nearest to the lines straight into it through its gateways.

    The junctions of the skeleton are drawn aside by niches, and by open space; the axes of the
    corridors are not.

    Parameters
    ----------
    base_px, radii_px : (k, 2), (k,) the base points, and their distance to obstacles.
    widest_px : gateways wider than this lie in a hall and have no axis.

    Source
    ------
    Ours.

    Examples
    --------
    >>> north = Gateway((10.0, 0.0), ((9.0, 0.0), (11.0, 0.0)), -math.pi / 2, 2, 2, 9)
    >>> east = Gateway((20.0, 8.0), ((20.0, 7.0), (20.0, 9.0)), 0.0, 2, 2, 9)
    >>> find_middle(np.array([[12.0, 6.0]]), np.array([4.0]), [north, east], 5.0).round(1)
    array([10.2,  7.8])
    """
    start = base_px.mean(axis=0)
    weights, sums = _STAY * np.eye(2), _STAY * start
    for gateway in gateways:
        if gateway.width_px > widest_px:
            continue
        along = np.array([math.cos(gateway.outward_rad), math.sin(gateway.outward_rad)])
        across = np.eye(2) - np.outer(along, along)
        weights, sums = weights + across, sums + across @ gateway.centre_px
    way = start + _STEPS[:, None] * (np.linalg.solve(weights, sums) - start)
    inside = (np.hypot(*(way[:, None] - base_px).transpose(2, 0, 1)) <= radii_px).any(axis=1)
    return np.asarray(way[np.flatnonzero(inside)[-1]] if inside.any() else start)


def _split_corners(
    graph: SkeletonGraph,
    k: int,
    door_cells: set[tuple[float, float]],
    kinds: dict[int, PlaceKind],
    resolution_m: float,
) -> None:
    """Split a branch at its sharp bends; but not in a room where it ends, past furniture."""
    branch = graph.branches[k]
    ends = [graph.nodes[branch.tail], graph.nodes[branch.head]]
    doors = [i for i, point in enumerate(branch.points_px.tolist()) if tuple(point) in door_cells]
    first, last = 0, len(branch.points_px)
    if doors and kinds.get(branch.head) == "dead end":
        last = doors[-1]
    if doors and kinds.get(branch.tail) == "dead end":
        first = doors[0]
    corners = [i for i in _find_corners(branch, ends, resolution_m) if first <= i <= last]
    for i in sorted(corners, reverse=True):
        node, k, _ = graph.split(k, i)
        kinds[node] = "corner"


def _split_ring(
    graph: SkeletonGraph, k: int, kinds: dict[int, PlaceKind], resolution_m: float
) -> None:
    """Split a ring without junction at its bends, at two points at least."""
    ring = graph.branches[k]
    size = len(ring.points_px)
    base = ring.tail
    found = sorted({i % size for i in _find_corners(ring.joined(ring), [], resolution_m)})
    apart = _CORNERS_APART_M / resolution_m
    cuts = [i for n, i in enumerate(found) if n == 0 or i - found[n - 1] > apart]
    if len(cuts) < 2:
        cuts = [size // 3, 2 * size // 3]
    for i in sorted(cuts, reverse=True):
        node, k, _ = graph.split(k, min(max(i, 1), size - 2))
        kinds[node] = "corner"
    graph.join_at(base)


def _find_corners(branch: Branch, ends: Sequence[Node], resolution_m: float) -> list[int]:
    steps = branch.steps_px
    reach = np.maximum(_ARM_M / resolution_m, 1.3 * branch.radius_px)
    inner = np.flatnonzero((steps > reach) & (steps < steps[-1] - reach))[::2]
    if not len(inner):
        return []
    here, reach = branch.points_px[inner], reach[inner]
    bend = branch.measure_bends(inner, reach)
    for end in ends:
        gap = np.hypot(*(here - end.point_px).T)
        holds = np.maximum(branch.radius_px[inner], end.radius_px)
        bend[gap <= 1.2 * holds] = 0.0
    found = list[int]()
    for m in np.argsort(-bend):
        if bend[m] < _LEAST_BEND_RAD:
            break
        i = int(inner[m])
        apart = max(_CORNERS_APART_M / resolution_m, 2.0 * float(branch.radius_px[i]))
        if all(abs(steps[i] - steps[j]) > apart for j in found):
            found.append(i)
    return found


def _split_rooms(
    graph: SkeletonGraph,
    k: int,
    door_cells: set[tuple[float, float]],
    kinds: dict[int, PlaceKind],
    resolution_m: float,
) -> None:
    """Split a branch in the widest point of each room that lies between two doors on it."""
    branch = graph.branches[k]
    points = [tuple(point) for point in branch.points_px.tolist()]
    doors = [i for i, point in enumerate(points) if point in door_cells]
    steps = branch.steps_px
    cuts = []
    for first, last in itertools.pairwise(doors):
        if (steps[last] - steps[first]) * resolution_m >= _LEAST_ROOM_M:
            cuts.append(first + int(np.argmax(branch.radius_px[first:last])))
    for i in reversed(cuts):
        node, k, _ = graph.split(k, i)
        kinds[node] = "room"


def _group_junctions(
    graph: SkeletonGraph, kinds: dict[int, PlaceKind], door_cells: set[tuple[float, float]]
) -> list[tuple[int, ...]]:
    """Return the nodes of each place: junctions of which one holds the other are one place."""
    groups: dict[int, list[int]] = {node: [node] for node in kinds}
    links = list[tuple[float, int, int]]()
    for branch in graph.branches.values():
        one, other = branch.tail, branch.head
        if one == other or not kinds.get(one) == kinds.get(other) == "junction":
            continue
        a, b = graph.nodes[one], graph.nodes[other]
        gap = math.dist(a.point_px, b.point_px)
        if gap > max(a.radius_px, b.radius_px):
            continue
        holds = np.hypot(*(branch.points_px - a.point_px).T) <= a.radius_px
        holds |= np.hypot(*(branch.points_px - b.point_px).T) <= b.radius_px
        if holds.all() and not any(tuple(p) in door_cells for p in branch.points_px.tolist()):
            links.append((gap, one, other))
    for _, one, other in sorted(links):
        joined = [*groups[one], *groups[other]]
        if groups[one] is groups[other] or not _is_one_place(graph, joined):
            continue
        for node in joined:
            groups[node] = joined
    return sorted({tuple(sorted(nodes)) for nodes in groups.values()})


def _is_one_place(graph: SkeletonGraph, nodes: Sequence[int]) -> bool:
    """Tell whether no two nodes are much farther apart than the largest of their discs reaches."""
    points = np.array([graph.nodes[node].point_px for node in nodes])
    gap = np.hypot(*(points[:, None] - points[None]).T).max()
    return bool(gap <= _PLACE_SIZE * max(graph.nodes[node].radius_px for node in nodes))


def _split_loop(
    graph: SkeletonGraph,
    k: int,
    groups: Sequence[tuple[int, ...]],
    kinds: dict[int, PlaceKind],
) -> None:
    """Split a branch that leads from a place back to it into three, at two corners.

    One corner would not do: were the two ways out of the place one path, the path would come back
    to it.
    """
    branch = graph.branches[k]
    group = next((nodes for nodes in groups if branch.tail in nodes), ())
    if branch.head not in group or _is_within(graph, branch, group):
        return
    steps = branch.steps_px
    for share in (2 / 3, 1 / 3):
        i = int(np.searchsorted(steps, share * steps[-1]))
        node, k, _ = graph.split(k, i)
        kinds[node] = "corner"


def _is_within(graph: SkeletonGraph, branch: Branch, group: Sequence[int]) -> bool:
    """Tell whether a branch never leaves the discs of the nodes of a place."""
    inside = np.zeros(len(branch.points_px), bool)
    for node in group:
        gap = np.hypot(*(branch.points_px - graph.nodes[node].point_px).T)
        inside |= gap <= graph.nodes[node].radius_px
    return bool(inside.all())


def _settle_in_room(graph: SkeletonGraph, polygon_px: Array, kinds: dict[int, PlaceKind]) -> None:
    """Put a place into a room that holds none, where the skeleton is farthest from its walls."""
    contour = np.asarray(polygon_px, np.float32).reshape(-1, 1, 2)
    if len(contour) < 3:
        return
    low, high = contour.min(axis=(0, 1)), contour.max(axis=(0, 1))
    if any(holds_point(polygon_px, graph.nodes[node].point_px) for node in kinds):
        return
    best: tuple[float, int, int] | None = None
    for k, branch in graph.branches.items():
        points = branch.points_px
        near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        for i in near[:: max(1, len(near) // 60)].tolist():
            if not 2 < i < len(points) - 3:
                continue
            depth = cv2.pointPolygonTest(contour, (float(points[i, 0]), float(points[i, 1])), True)
            if depth > 0 and (best is None or depth > best[0]):
                best = depth, k, i
    if best is not None:
        node, _, _ = graph.split(best[1], best[2])
        kinds[node] = "room"


def holds_point(polygon_px: Array, point_px: tuple[float, float]) -> bool:
    """Tell whether a polygon (n, 2) holds a point."""
    contour = np.asarray(polygon_px, np.float32).reshape(-1, 1, 2)
    return cv2.pointPolygonTest(contour, (float(point_px[0]), float(point_px[1])), False) >= 0
