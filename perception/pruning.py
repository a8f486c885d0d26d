"""Pruning a skeleton to what joins the exits, and finding the robot on it."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np

from perception.geometry import Array
from perception.grid import Mask
from perception.region import Exit, Region
from perception.sight import look_along, measure_looks
from perception.skeleton import Node, Skeleton
from perception.skeleton_graph import SkeletonGraph

_LOOK_RAD = np.radians([-20.0, -10.0, 0.0, 10.0, 20.0])
"""Directions in which one looks on through an exit, from straight on, seen from its junction."""

_TINY, _SPECK = 12, 4
"""Points of a loop too small to go around anything, and of a part of the skeleton that is none."""


def prune(skeleton: Skeleton, region: Region, *, min_depth_px: float) -> Skeleton:
    """Keep what joins the exits, on the part that the robot can reach.

    Branches to dead ends go; so do exits whose branch does not reach ``min_depth_px`` beyond the
    disc of its junction, nor are seen to go on so far. Real loops stay. With one exit only, the
    branch to the dead end stays (it is cut at the robot later).

    Source
    ------
    Beeson 2008, 6.1.1 (frontier-based pruning); the depth rule is ours.
    """
    graph = SkeletonGraph(skeleton)
    _keep_reached(graph, region)
    graph.drop_tiny_loops(_TINY)
    while True:
        leaf = _choose_leaf(graph, region, min_depth_px)
        if leaf is None:
            return graph.to_skeleton()
        graph.remove(leaf)
        graph.drop_tiny_loops(_TINY)


def _keep_reached(graph: SkeletonGraph, region: Region) -> None:
    """Keep the connected part that the robot reaches first; specks do not count."""
    parts = graph.list_parts()
    if len(parts) < 2:
        return
    large = [part for part in parts if graph.count_points(part) > _SPECK] or parts
    numbers = sorted(k for part in large for k in part)
    reachable = Skeleton(graph.nodes, [graph.branches[k] for k in numbers])
    index, _ = find_closest(reachable, region, region.start)
    graph.keep_largest(numbers[index])


def _choose_leaf(graph: SkeletonGraph, region: Region, min_depth_px: float) -> int | None:
    """Return the number of the next branch that leads nowhere; None if all lead somewhere.

    Of dead ends the shortest goes first: where two are left, the longer one is the place's own.
    """
    degree = graph.degrees()
    exits, dead, open_ = 0, list[tuple[int, int]](), list[tuple[int, int, Exit]]()
    for k, branch in graph.branches.items():
        for leaf, base in ((branch.tail, branch.head), (branch.head, branch.tail)):
            if degree[leaf] != 1:
                continue
            number = graph.nodes[leaf].exit
            exits += number is not None
            if degree[base] >= 3 and number is None:
                dead.append((len(branch.points_px), k))
            elif degree[base] >= 3 and number is not None:
                open_.append((k, base, region.exits[number]))
    if dead or exits < 2 or min_depth_px <= 0:
        return min(dead)[1] if dead else None
    depths = [
        (_depth(graph.nodes[b], exit_, region, min_depth_px, graph.branches[k].points_px), k)
        for k, b, exit_ in open_
    ]
    depth, k = min(depths, default=(math.inf, -1))
    return k if depth < min_depth_px else None


def _depth(
    base: Node, exit_: Exit, region: Region, enough_px: float, points_px: Array | None = None
) -> float:
    """Return how far one sees beyond the disc of a junction through the exit of a branch.

    Once it is known to be enough, or where sight is not asked for, it is how far the exit and the
    points (n, 2) of the branch reach.
    """
    depth = _reach_beyond(base, exit_.cells.astype(float))
    if points_px is not None:
        depth = max(depth, _reach_beyond(base, points_px))
    if depth >= enough_px or region.seen is None:
        return depth
    return max(depth, _see_beyond(base, exit_, region.seen))


def _see_beyond(base: Node, exit_: Exit, seen: Mask) -> float:
    """Return how far beyond the disc of a junction one sees, straight on through an exit."""
    cells = exit_.cells.astype(float)
    away = cells - base.point_px
    headings = np.arctan2(away[:, 1], away[:, 0])[:, None] + _LOOK_RAD
    _, _, on = look_along(cells, headings, seen)
    last = np.maximum(measure_looks(on) - 1.0, 0.0)
    ahead = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    return _reach_beyond(base, (cells[:, None] + last[..., None] * ahead).reshape(-1, 2))


def _reach_beyond(base: Node, points: Array) -> float:
    """Return how far the farthest of some points lies beyond the disc of a node."""
    return float(np.hypot(*(points - base.point_px).T).max()) + 0.5 - base.radius_px


def find_side_gaps(skeleton: Skeleton, region: Region, *, min_depth_px: float) -> list[int]:
    """Return the exits that are gaps in the wall along a path, not ends of it.

    Such an exit is narrower than the path it opens from, and one does not see ``min_depth_px``
    beyond the path's edge through it. At the border of the grid one cannot know.

    Source
    ------
    Ours.
    """
    degree, found = skeleton.degree(), []
    for branch in skeleton.branches:
        for node, outward in ((branch.head, 1), (branch.tail, -1)):
            number = skeleton.nodes[node].exit
            if degree[node] != 1 or number is None:
                continue
            exit_ = region.exits[number]
            if exit_.at_border:
                continue
            radius, points = branch.radius_px[::-outward], branch.points_px[::-outward]
            gap = np.hypot(*(points - points[0]).T)
            window = radius[gap <= 3.0 * float(np.median(radius))]
            middle = int(np.argmax(window >= 0.95 * window.max()))
            base = Node((float(points[middle, 0]), float(points[middle, 1])), float(radius[middle]))
            reach = _depth(base, exit_, region, min_depth_px)
            if exit_.width_px < 1.4 * base.radius_px and reach < min_depth_px:
                found.append(number)
    return sorted(set(found))


def find_closest(
    skeleton: Skeleton, region: Region, place_px: tuple[float, float]
) -> tuple[int, int]:
    """Find the point of a skeleton nearest to a place by a way through the region.

    Returns
    -------
    Index of the branch, and of the point on it.

    Source
    ------
    Beeson 2008, 6.1.1: the nearest point that has a path to the robot through free space.
    """
    points = skeleton.points_px
    gap = points - place_px
    distance = np.einsum("ij,ij->i", gap, gap)
    nearest = int(distance.argmin())
    if _is_seen(region.inside, place_px, points[nearest]):
        return _locate(skeleton, nearest)
    for k in np.argsort(distance, kind="stable")[:30]:
        if _is_seen(region.inside, place_px, points[k]):
            return _locate(skeleton, int(k))
    return _locate(skeleton, _search(region.inside, place_px, points))


def _locate(skeleton: Skeleton, k: int) -> tuple[int, int]:
    for index, branch in enumerate(skeleton.branches):
        if k < len(branch.points_px):
            return index, k
        k -= len(branch.points_px)
    raise IndexError(k)


def _is_seen(inside: Mask, place_px: tuple[float, float], point: Array) -> bool:
    steps = int(np.abs(point - place_px).max()) + 2
    line = np.linspace(np.asarray(place_px, float), point, steps).round().astype(int)
    height, width = inside.shape
    x, y = np.clip(line[:, 0], 0, width - 1), np.clip(line[:, 1], 0, height - 1)
    return bool(inside[y, x].all())


def _search(inside: Mask, place_px: tuple[float, float], points: Array) -> int:
    """Return the point reached first by a wave through the region (8 neighbours, Dijkstra)."""
    passable = np.pad(inside.T, 1).tobytes()  # a border of walls: no neighbour is outside
    height = len(inside) + 2

    def number(x: float, y: float) -> int:
        return (round(x) + 1) * height + round(y) + 1

    goal = {number(x, y): k for k, (x, y) in enumerate(points.tolist())}
    moves = [
        (dx * height + dy, 1.41 if dx and dy else 1.0)
        for dx, dy in itertools.product((-1, 0, 1), repeat=2)
        if dx or dy
    ]
    start = number(*place_px)
    best = {start: 0.0}
    queue = [(0.0, start)]
    while queue:
        cost, cell = heapq.heappop(queue)
        if cell in goal:
            return goal[cell]
        if cost > best[cell]:
            continue
        for move, step in moves:
            other = cell + move
            if passable[other] and cost + step < best.get(other, math.inf):
                best[other] = cost + step
                heapq.heappush(queue, (cost + step, other))
    return int(np.argmin(np.hypot(*(points - place_px).T)))
