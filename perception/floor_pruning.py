"""Pruning the skeleton of a whole floor to what leads somewhere."""

from __future__ import annotations

import heapq
import math
from collections import defaultdict

import cv2
import numpy as np

from perception.floor_space import FloorSpace, measure_wall
from perception.geometry import Array
from perception.skeleton import OPEN, Branch
from perception.skeleton_graph import SkeletonGraph

LEAST_SHARE = 3.2
"""A leaf that stands for less wall than this times its clearance is a corner of a room."""

LEAST_DEPTH_M = 0.6
"""A leaf must lead so far beyond the disc of the junction at its base."""

THING_M = 2.0
"""One goes around a free-standing thing smaller than this on its wider side only."""

LEAST_ROUND_M = 25.0
"""A room with one way out is gone round if the round is at least so long."""

GAP_M = 0.8
"""Free-standing things closer than this are one."""

MOST_DETOUR = (1.5, 2.0)
"""Unless the way around is longer than this times the way saved, and so many metres."""


def prune_floor(graph: SkeletonGraph, space: FloorSpace, *, robot_radius_m: float) -> None:
    """Cut away the leaves that stand for a corner, a niche or a narrow gap.

    A leaf is cut back to where the wall it stands for, from the nearest wall on its one side
    around it to that on the other, is long for the clearance; where it ends in a gap that the
    robot does not fit through, the gap is taken for wall. What is cut back to its base goes;
    shortest first.

    Source
    ------
    Ours: a right-angled corner stands for twice the clearance, the end of a corridor for four
    times and more.
    """
    limit = robot_radius_m / space.resolution_m + 2.5
    queue = [(len(b.points_px), k) for k, b in graph.branches.items() if graph.is_leaf(k)]
    heapq.heapify(queue)
    while queue:
        _, k = heapq.heappop(queue)
        if k not in graph.branches or not graph.is_leaf(k):
            continue
        outward = graph.orient_leaf(k)
        keep = _count_kept(outward, space, limit)
        if keep > 0.5 * float(outward.radius_px[0]):
            graph.shorten_leaf(k, keep)
            continue
        for made in graph.remove(k):
            if graph.is_leaf(made):
                heapq.heappush(queue, (len(graph.branches[made].points_px), made))


def _count_kept(outward: Branch, space: FloorSpace, limit_px: float) -> int:
    """Return how many points of a leaf, from its base, lead somewhere."""
    radius = outward.radius_px
    both = (outward.left != OPEN) & (outward.right != OPEN)
    wall = np.full(len(radius), np.inf)
    wall[both] = measure_wall(space, outward.left[both], outward.right[both])
    leads = np.ones(len(radius), bool)
    if both[-1] and radius[-1] < limit_px:
        wall[both] = np.minimum(wall, _measure_to_gap(outward, space))[both]
        leads = radius >= limit_px
    worth = np.flatnonzero(leads & (wall >= LEAST_SHARE * radius))
    return int(worth[-1]) + 1 if len(worth) else 0


def _measure_to_gap(outward: Branch, space: FloorSpace) -> Array:
    """Return the wall a leaf stands for at each point, were the gap at its tip closed."""
    wall = np.full(len(outward.radius_px), 2.0 * float(outward.radius_px[-1]))
    for side in (outward.left, outward.right):
        at = space.region.walls[side].astype(float)
        wall += np.hypot(*(at - at[-1]).T)
    return wall


def prune_shallow(graph: SkeletonGraph, resolution_m: float) -> None:
    """Remove leaves that hardly leave the disc of the junction at their base; tagged ones stay."""
    queue = [(len(b.points_px), k) for k, b in graph.branches.items() if graph.is_leaf(k)]
    heapq.heapify(queue)
    while queue:
        _, k = heapq.heappop(queue)
        if k not in graph.branches or not graph.is_leaf(k) or graph.tags[k]:
            continue
        outward = graph.orient_leaf(k)
        base = graph.nodes[outward.tail]
        reach = float(np.hypot(*(outward.points_px - base.point_px).T).max())
        if (reach - base.radius_px) * resolution_m >= LEAST_DEPTH_M:
            continue
        for made in graph.remove(k):
            if graph.is_leaf(made):
                heapq.heappush(queue, (len(graph.branches[made].points_px), made))


def open_loops(graph: SkeletonGraph, space: FloorSpace) -> None:
    """Remove the narrower way around each free-standing thing, furniture most likely.

    And half of a short round through the open middle of a room that has no other way out.
    Smallest things first; two things with no way left between them are one. A thing stays if one
    of the ways around it is tagged, it is a piece of wall beside a door; and so does a way that
    saves a great detour.
    """
    _cut_rounds(graph, LEAST_ROUND_M / space.resolution_m)
    things = _Things(graph, space)
    queue = [(size, k) for k, size in enumerate(things.sizes_m) if size < THING_M]
    heapq.heapify(queue)
    while queue:
        size, thing = heapq.heappop(queue)
        if things.root[thing] != thing or things.sizes_m[thing] != size:
            continue
        ways = things.list_ways(thing)
        if any(graph.tags[k] for k in ways):
            continue
        ways.sort(key=lambda k: float(graph.branches[k].radius_px.min()))
        for k in ways:
            branch = graph.branches[k]
            if branch.tail == branch.head:
                k = _halve_loop(graph, k)
            elif not _is_near(graph, k, space.resolution_m):
                continue
            one = things.remove_way(k, thing)
            if things.sizes_m[one] < THING_M:
                heapq.heappush(queue, (things.sizes_m[one], one))
            break


def _cut_rounds(graph: SkeletonGraph, least_px: float) -> None:
    """Cut loops along the open middle of a room that are shorter than this."""
    for k, branch in list(graph.branches.items()):
        if branch.tail != branch.head or graph.tags[k] or float(branch.steps_px[-1]) >= least_px:
            continue
        if max((branch.left == OPEN).mean(), (branch.right == OPEN).mean()) > 0.5:
            graph.remove(_halve_loop(graph, k))


class _Things:
    """The wall contours of a floor, and what they are joined to when ways between them go."""

    def __init__(self, graph: SkeletonGraph, space: FloorSpace) -> None:
        self.graph, self.arc = graph, space.region.arc
        cuts = np.flatnonzero(np.diff(self.arc)) + 1
        self.points = np.split(space.region.walls.astype(float), cuts)
        self.resolution_m = space.resolution_m
        self.sizes_m = [self._measure(points) for points in self.points]
        self.root = list(range(len(self.points)))
        self._join_near(space)
        self.beside: dict[int, set[int]] = defaultdict(set)
        for k in graph.branches:
            self._add(k)

    def _measure(self, points: Array) -> float:
        low, high = points.min(axis=0), points.max(axis=0)
        if float((high - low).max()) * self.resolution_m > 4 * THING_M:
            return math.inf
        return float(max(cv2.minAreaRect(points.astype(np.float32))[1])) * self.resolution_m

    def _join_near(self, space: FloorSpace) -> None:
        """Take small things so close that nothing leads between them for one."""
        small = [k for k, size in enumerate(self.sizes_m) if size < 4 * THING_M]
        if not small:
            return
        mask = np.zeros(space.region.inside.shape, np.uint8)
        for k in small:
            x, y = self.points[k].astype(np.int64).T
            mask[y, x] = 1
        side = max(round(GAP_M / self.resolution_m), 1)
        _, labels = cv2.connectedComponents(cv2.dilate(mask, np.ones((side, side), np.uint8)))
        groups: dict[int, list[int]] = defaultdict(list)
        for k in small:
            x, y = self.points[k][0].astype(np.int64).tolist()
            groups[int(labels[y, x])].append(k)
        for members in groups.values():
            one = members[0]
            for k in members[1:]:
                self.root[k] = one
            if len(members) > 1:
                self.points[one] = np.concatenate([self.points[k] for k in members])
                self.sizes_m[one] = self._measure(self.points[one])

    def _find(self, arc: int) -> int:
        while self.root[arc] != arc:
            arc = self.root[arc]
        return arc

    def _add(self, k: int) -> None:
        for arc in self._list_sides(k):
            self.beside[arc].add(k)

    def _list_sides(self, k: int) -> set[int]:
        """Return the things that lie beside at least half of a branch."""
        branch = self.graph.branches[k]
        found = set[int]()
        for side in (branch.left, branch.right):
            arcs, count = np.unique(self.arc[side[side != OPEN]], return_counts=True)
            share: dict[int, int] = defaultdict(int)
            for arc, n in zip(arcs.tolist(), count.tolist(), strict=True):
                share[self._find(arc)] += n
            found |= {arc for arc, n in share.items() if n >= 0.5 * len(side)}
        return found

    def list_ways(self, thing: int) -> list[int]:
        """Return the branches that lead past a thing, and something else on the other side."""
        own = {k for k in self.beside[thing] if k in self.graph.branches}
        self.beside[thing] = own
        return sorted(own)

    def remove_way(self, k: int, thing: int) -> int:
        """Remove a branch beside a thing; return what the thing is part of then."""
        joined = self._list_sides(k) | {thing}
        one = max(joined, key=lambda arc: self.sizes_m[arc])
        for made in self.graph.remove(k):
            self._add(made)
        for arc in joined - {one}:
            self.root[arc] = one
            self.beside[one] |= self.beside[arc]
        if len(joined) > 1 and self.sizes_m[one] < THING_M:
            self.points[one] = np.concatenate([self.points[arc] for arc in joined])
            self.sizes_m[one] = self._measure(self.points[one])
        return one


def _is_near(graph: SkeletonGraph, k: int, resolution_m: float) -> bool:
    """Tell whether the way round a branch is not much longer than the branch."""
    branch = graph.branches[k]
    own = float(branch.steps_px[-1]) * resolution_m
    way = graph.measure_way(branch.tail, branch.head, k) * resolution_m
    return way <= MOST_DETOUR[0] * own + MOST_DETOUR[1]


def _halve_loop(graph: SkeletonGraph, k: int) -> int:
    """Split a loop at the point farthest from its base; return the narrower half."""
    branch = graph.branches[k]
    i = int(np.searchsorted(branch.steps_px, 0.5 * float(branch.steps_px[-1])))
    _, one, two = graph.split(k, min(max(i, 1), len(branch.points_px) - 2))
    return min((one, two), key=lambda half: float(graph.branches[half].radius_px.min()))
