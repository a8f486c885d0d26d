"""Ways straight across the open middle of a hall, where the skeleton goes a long way round it."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from perception.floor_space import FloorSpace
from perception.geometry import Array
from perception.region import Index
from perception.skeleton import OPEN, Branch
from perception.skeleton_graph import SkeletonGraph

DETOUR = (1.5, 2.0)
"""A way is a great detour if it is longer than this times the straight line and so many metres."""

_STEP_M = 0.5
_MOST_POINTS = 1200
_LEAST_M = 1.0
_FARTHEST_M = 30.0
_SLACK_PX = 1.5
_NO_LENGTH_PX = 1e-6
_LOOKS = 65


@dataclass(frozen=True, eq=False)
class _Rim:
    """Points along the rims of halls.

    Attributes
    ----------
    branch, point : (n,) where on the skeleton they lie; the first or last point of a branch stands
        for the node there.
    is_node : (n,) whether they are nodes.
    at_px : (n, 2) the same in the crop.
    way_px : (n, n) lengths of the ways between them along the skeleton.
    """

    branch: Index
    point: Index
    is_node: NDArray[np.bool_]
    at_px: Array
    way_px: Array


def add_crossings(graph: SkeletonGraph, space: FloorSpace, *, midline_m: float) -> None:
    """Join points on the rim of the open middle of a hall by straight lines across it.

    Where the way along the skeleton is a great detour; first between junctions, the nearest first,
    then wherever there is one left, the greatest first. No two cross, so the graph stays planar.

    Parameters
    ----------
    midline_m : M; the open middle is further than this from every wall.

    Source
    ------
    Ours; so the ways of a hall become a spanner of it (Peleg and Schaeffer 1989). Beeson 2008,
    6.1.1, has the robot follow the walls of such a hall.
    """
    resolution = space.resolution_m
    rim = _sample_rim(graph, resolution)
    if len(rim.at_px) < 2:
        return
    distance = _measure_clearance(space)
    wide = (distance >= midline_m / resolution - _SLACK_PX) & space.region.inside
    chosen = _choose(rim, wide, resolution)
    nodes = _settle(graph, rim, sorted({k for pair in chosen for k in pair}))
    for one, other in chosen:
        ends = rim.at_px[[one, other]]
        points = np.linspace(ends[0], ends[1], max(round(math.dist(*ends)), 3))
        columns, rows = np.round(points).astype(np.int64).T
        nowhere = np.full(len(points), OPEN)
        radius = distance[rows, columns].astype(float)
        graph.add(Branch(nodes[one], nodes[other], points, radius, nowhere, nowhere))
    for node in list(graph.at):
        graph.join_at(node)


def _measure_clearance(space: FloorSpace) -> NDArray[np.float32]:
    free = np.ones(space.region.inside.shape, np.uint8)
    free[space.region.walls[:, 1], space.region.walls[:, 0]] = 0
    return np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, 5), np.float32)


def _sample_rim(graph: SkeletonGraph, resolution_m: float) -> _Rim:
    """Return the nodes along open space, and points of the branches between them."""
    vertex = {node: k for k, node in enumerate(graph.at)}
    count = len(vertex)
    rims = {k: (b.left == OPEN) | (b.right == OPEN) for k, b in graph.branches.items()}
    whole = sum(float(graph.branches[k].steps_px[-1]) for k, rim in rims.items() if rim.any())
    apart = max(_STEP_M / resolution_m, whole / _MOST_POINTS)
    links: dict[tuple[int, int], float] = defaultdict(lambda: math.inf)
    found: dict[int, tuple[int, int]] = {}
    for k, branch in graph.branches.items():
        steps, rim = branch.steps_px, rims[k]
        chain = [(0.0, vertex[branch.tail]), (float(steps[-1]), vertex[branch.head])]
        for (_, at), i in zip(chain, (0, len(steps) - 1), strict=True):
            if rim[i]:
                found.setdefault(at, (k, i))
        size = int(steps[-1] / apart) if rim.any() else 0
        for way in np.linspace(0, steps[-1], size + 1)[2:-2].tolist():
            i = int(np.searchsorted(steps, way))
            if rim[i]:
                found[count] = k, i
                chain.insert(-1, (float(steps[i]), count))
                count += 1
        for (start, one), (stop, other) in itertools.pairwise(chain):
            link = min(one, other), max(one, other)
            links[link] = min(links[link], stop - start + _NO_LENGTH_PX)
    index, where = np.array(list(found), np.int64), np.array(list(found.values()), np.int64)
    where = where.reshape(-1, 2)
    points = np.array([graph.branches[k].points_px[i] for k, i in where.tolist()]).reshape(-1, 2)
    ends = np.array(list(links), np.int64).reshape(-1, 2)
    ways = coo_array((list(links.values()), (ends[:, 0], ends[:, 1])), shape=(count, count))
    between: Array = np.zeros((len(index), len(index)))
    if len(index):
        between[:] = dijkstra(ways.tocsr(), directed=False, indices=index)[:, index]
    return _Rim(where[:, 0], where[:, 1], index < len(vertex), points, between)


def _choose(rim: _Rim, wide: NDArray[np.bool_], resolution_m: float) -> list[tuple[int, int]]:
    """Return which points of the rims to join, hall by hall."""
    count = len(rim.at_px)
    straight = np.hypot(*(rim.at_px[:, None] - rim.at_px[None]).transpose(2, 0, 1))
    far = (straight > _LEAST_M / resolution_m) & (straight <= _FARTHEST_M / resolution_m)
    limit = DETOUR[0] * straight + DETOUR[1] / resolution_m
    one, other = np.nonzero(np.triu(far & (rim.way_px > limit)))
    seen = _see(rim.at_px[one], rim.at_px[other], wide)
    one, other = one[seen], other[seen]
    pairs = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    _, hall = connected_components(pairs, directed=False)
    chosen = list[tuple[int, int]]()
    for k in np.unique(hall[one]).tolist():
        own, within = np.flatnonzero(hall == k), hall[one] == k
        ways, gaps = rim.way_px[np.ix_(own, own)], straight[np.ix_(own, own)]
        a, b = np.searchsorted(own, one[within]), np.searchsorted(own, other[within])
        found = _choose_in_hall(
            rim.at_px[own], rim.is_node[own], ways, gaps, (a, b), 1 / resolution_m
        )
        chosen += [(int(own[i]), int(own[j])) for i, j in found]
    return chosen


def _choose_in_hall(
    at_px: Array,
    is_node: NDArray[np.bool_],
    way: Array,
    straight: Array,
    pairs: tuple[Index, Index],
    metre_px: float,
) -> list[tuple[int, int]]:
    """Return which of the pairs of points of a rim to join; the ways become shorter with each."""
    one, other = pairs
    chosen = list[tuple[int, int]]()
    while len(one):
        gap = straight[one, other]
        nodes = is_node[one] & is_node[other]
        if nodes.any():
            best = int(np.argmin(np.where(nodes, gap, np.inf)))
        else:
            best = int(np.argmax(way[one, other] / (gap + _LEAST_M * metre_px)))
        i, j = int(one[best]), int(other[best])
        chosen.append((i, j))
        for a, b in ((i, j), (j, i)):
            np.minimum(way, way[:, a, None] + gap[best] + way[None, b], out=way)
        left = way[one, other] > DETOUR[0] * gap + DETOUR[1] * metre_px
        left &= ~_cross(at_px[one], at_px[other], at_px[i], at_px[j])
        one, other = one[left], other[left]
    return chosen


def _see(one: Array, other: Array, wide: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which straight lines lead through the open middle of a hall only."""
    seen = np.ones(len(one), bool)
    shares = np.random.default_rng(0).permutation(np.linspace(0.0, 1.0, _LOOKS))
    for some in np.split(shares, [4, 16]):
        at = np.flatnonzero(seen)
        points = one[at, None] + some[:, None] * (other[at] - one[at])[:, None]
        columns, rows = np.round(points).astype(np.int64).transpose(2, 0, 1)
        seen[at] = wide[rows, columns].all(axis=1)
    return seen


def _cross(one: Array, other: Array, a: Array, b: Array) -> NDArray[np.bool_]:
    """Tell which segments cross that from a to b between their ends."""

    def turn(p: Array, q: Array, r: Array) -> Array:
        return np.asarray(
            (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
            - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
        )

    apart = turn(one, other, a) * turn(one, other, b) < 0
    return np.asarray(apart & (turn(a, b, one) * turn(a, b, other) < 0))


def _settle(graph: SkeletonGraph, rim: _Rim, points: list[int]) -> dict[int, int]:
    """Split the branches of the skeleton at some points of the rim; return the node of each."""
    nodes: dict[int, int] = {}
    inner: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for k in points:
        branch, i = graph.branches[int(rim.branch[k])], int(rim.point[k])
        if i in (0, len(branch.points_px) - 1):
            nodes[k] = branch.tail if i == 0 else branch.head
        else:
            inner[int(rim.branch[k])].append((i, k))
    for number, found in inner.items():
        for i, k in sorted(found, reverse=True):
            tags = graph.tags.pop(number, set())
            nodes[k], number, rest = graph.split(number, i)
            graph.tags[number] |= tags
            graph.tags[rest] |= tags
    return nodes
