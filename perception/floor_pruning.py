"""Pruning the skeleton of a whole floor to what leads somewhere."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from perception.floor_space import FloorSpace, measure_wall
from perception.geometry import Array
from perception.skeleton import OPEN, Branch
from perception.skeleton_graph import SkeletonGraph

LEAST_SHARE = 3.2
"""A leaf that stands for less wall than this times its clearance is a corner of a room."""

LEAST_DEPTH_M = 0.6
"""A leaf must lead so far beyond the disc of the junction at its base."""

THING_M = 1.5
"""One goes around a free-standing thing smaller than this on its wider side only."""


def prune_floor(graph: SkeletonGraph, space: FloorSpace, *, robot_radius_m: float) -> None:
    """Cut away the leaves that stand for a corner, a niche or a narrow gap.

    A leaf is cut back to where the wall it stands for, from the nearest wall on its one side
    around it to that on the other, is long for the clearance; one that ends where the robot does
    not fit through, to where it was widest before. What is cut back to its base goes; shortest
    first.

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
    worth = np.flatnonzero(wall >= LEAST_SHARE * radius)
    keep = int(worth[-1]) + 1 if len(worth) else 0
    if keep and radius[keep - 1] < limit_px:
        narrowest = np.minimum.accumulate(radius[:keep])
        again = np.flatnonzero(radius[:keep] > narrowest + np.maximum(3.0, 0.2 * narrowest))
        if not len(again):
            return 0
        last = radius[again[0] : keep]
        keep = int(again[0]) + int(np.flatnonzero(last >= 0.97 * last.max())[-1]) + 1
    return keep


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


def open_loops(graph: SkeletonGraph, space: FloorSpace, things_m: Array) -> None:
    """Remove the narrower way around each free-standing thing, furniture most likely.

    A thing stays if one of the ways around it is tagged: it is a piece of wall beside a door.

    Parameters
    ----------
    things_m : (arcs, 2) long and short side of each wall contour.
    """
    beside: dict[int, set[int]] = defaultdict(set)
    for k in graph.branches:
        for arc in _list_arcs(graph.branches[k], space):
            beside[arc].add(k)
    small: Sequence[int] = np.flatnonzero(things_m[:, 0] < THING_M).tolist()
    for arc in sorted(small, key=lambda arc: float(things_m[arc, 0])):
        ways = [k for k in beside[arc] if k in graph.branches]
        if any(graph.tags[k] for k in ways):
            continue
        ways.sort(key=lambda k: float(graph.branches[k].radius_px.min()))
        for k in ways:
            branch = graph.branches[k]
            if branch.tail == branch.head:
                k = _halve_loop(graph, k)
            elif not graph.are_linked(branch.tail, branch.head, k):
                continue
            for made in graph.remove(k):
                for other in _list_arcs(graph.branches[made], space):
                    beside[other].add(made)
            break


def _halve_loop(graph: SkeletonGraph, k: int) -> int:
    """Split a loop at the point farthest from its base; return the narrower half."""
    branch = graph.branches[k]
    i = int(np.searchsorted(branch.steps_px, 0.5 * float(branch.steps_px[-1])))
    _, one, two = graph.split(k, min(max(i, 1), len(branch.points_px) - 2))
    return min((one, two), key=lambda half: float(graph.branches[half].radius_px.min()))


def _list_arcs(branch: Branch, space: FloorSpace) -> list[int]:
    """Return the wall contours that lie beside at least half of a branch."""
    found = list[int]()
    for side in (branch.left, branch.right):
        walls = side[side != OPEN]
        if len(walls):
            count = np.bincount(space.region.arc[walls])
            found += np.flatnonzero(count >= 0.5 * len(side)).tolist()
    return found
