"""Pruning a skeleton to what joins the exits, and finding the robot on it."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np

from perception.geometry import Array
from perception.grid import Mask
from perception.region import Exit, Region
from perception.skeleton import Branch, Node, Skeleton


def prune(skeleton: Skeleton, region: Region, *, min_depth_px: float) -> Skeleton:
    """Keep what joins the exits, on the part that the robot can reach.

    Branches to dead ends go; so do exits whose branch does not reach ``min_depth_px`` beyond the
    disc of its junction. Real loops stay. With one exit only, the branch to the dead end stays
    (it is cut at the robot later).

    Source
    ------
    Beeson 2008, 6.1.1 (frontier-based pruning); the depth rule is ours.
    """
    pruned = _component(skeleton, region)
    _drop_small_loops(pruned)
    _join_all(pruned)
    while True:
        leaf = _leaf_to_drop(pruned, region, min_depth_px)
        if leaf is None:
            return pruned
        pruned.branches.remove(leaf)
        _join_all(pruned)
        _drop_small_loops(pruned)
        _join_all(pruned)


def _component(skeleton: Skeleton, region: Region) -> Skeleton:
    """Return the connected part of the skeleton that the robot reaches first."""
    if not skeleton.branches:
        return Skeleton()
    parent = {node: node for node in skeleton.nodes}

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    for branch in skeleton.branches:
        parent[root(branch.tail)] = root(branch.head)
    if len({root(node) for node in skeleton.nodes}) == 1:
        return Skeleton(dict(skeleton.nodes), list(skeleton.branches))
    groups: dict[int, int] = {}
    for branch in skeleton.branches:
        size = len(branch.points_px)
        groups[root(branch.tail)] = groups.get(root(branch.tail), 0) + size
    branches = [b for b in skeleton.branches if groups[root(b.tail)] > 4]
    if not branches:
        branches = skeleton.branches
    index, _ = find_closest(Skeleton(skeleton.nodes, branches), region, region.start)
    home = root(branches[index].tail)
    kept = [branch for branch in branches if root(branch.tail) == home]
    return Skeleton({n: skeleton.nodes[n] for n in skeleton.nodes if root(n) == home}, kept)


def _leaf_to_drop(skeleton: Skeleton, region: Region, min_depth_px: float) -> Branch | None:
    """Return the next branch that leads nowhere; None if all lead somewhere."""
    degree = skeleton.degree()
    shallow: list[tuple[float, int]] = []
    for k, branch in enumerate(skeleton.branches):
        for leaf, base in ((branch.tail, branch.head), (branch.head, branch.tail)):
            if degree[leaf] != 1 or degree[base] < 3:
                continue
            if skeleton.nodes[leaf].exit is None:
                return branch
            if min_depth_px <= 0:
                continue
            exit_ = region.exits[skeleton.nodes[leaf].exit or 0]
            depth = _depth(branch, skeleton.nodes[base], exit_)
            if depth < min_depth_px:
                shallow.append((depth, k))
    if not shallow:
        return None
    exits = sum(1 for n in skeleton.nodes if degree[n] == 1 and skeleton.nodes[n].exit is not None)
    return skeleton.branches[min(shallow)[1]] if exits > 1 else None


def _depth(branch: Branch, base: Node, exit_: Exit) -> float:
    """Return how far one sees beyond the disc of a junction through the exit of a branch."""
    return max(
        _reach_beyond(base, branch.points_px), _reach_beyond(base, exit_.cells.astype(float))
    )


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
            reach = _reach_beyond(base, exit_.cells.astype(float))
            if exit_.width_px < 1.4 * base.radius_px and reach < min_depth_px:
                found.append(number)
    return sorted(set(found))


def _drop_small_loops(skeleton: Skeleton, size: int = 12) -> None:
    """Drop loops and double branches too small to go around anything."""
    kept: list[Branch] = []
    short: set[tuple[int, int]] = set()
    for branch in sorted(skeleton.branches, key=lambda b: len(b.points_px)):
        key = (min(branch.tail, branch.head), max(branch.tail, branch.head))
        if len(branch.points_px) < size:
            if branch.tail == branch.head or key in short:
                continue
            short.add(key)
        kept.append(branch)
    skeleton.branches = kept


def _join_all(skeleton: Skeleton) -> None:
    """Join the two branches that meet in a node of degree two; forget nodes without branches."""
    at: dict[int, list[Branch]] = {node: [] for node in skeleton.nodes}
    for branch in skeleton.branches:
        at[branch.tail].append(branch)
        at[branch.head].append(branch)
    for node in list(skeleton.nodes):
        ends = at[node]
        if not ends:
            del skeleton.nodes[node]
        elif len(ends) == 2 and ends[0] is not ends[1]:
            one, two = ends
            first = one if one.head == node else one.reversed()
            joined = first.joined(two if two.tail == node else two.reversed())
            skeleton.branches = [b for b in skeleton.branches if b is not one and b is not two]
            skeleton.branches.append(joined)
            for end, old in ((joined.tail, one), (joined.head, two)):
                at[end] = [b for b in at[end] if b is not old] + [joined]
            del skeleton.nodes[node]
            del at[node]


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
