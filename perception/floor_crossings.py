"""Ways straight across the open middle of a hall, where the skeleton goes a long way round it."""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np

from perception.floor_space import FloorSpace
from perception.geometry import Array
from perception.skeleton import OPEN, Branch
from perception.skeleton_graph import SkeletonGraph

DETOUR = (1.5, 2.0)
"""A way is a great detour if it is longer than this times the straight line and so many metres."""

_FARTHEST_M = 40.0
_SLACK_PX = 1.5

Segment = tuple[Array, Array]


def add_crossings(graph: SkeletonGraph, space: FloorSpace, *, midline_m: float) -> None:
    """Join junctions on the rim of the open middle of a hall by straight lines across it.

    Only where the way along the skeleton is a great detour; shortest first, and no two cross, so
    the graph stays planar.

    Parameters
    ----------
    midline_m : M; the open middle is further than this from every wall.

    Source
    ------
    Ours. Beeson 2008, 6.1.1, has the robot follow the walls of such a hall.
    """
    rim = [node for node in sorted(graph.at) if _is_on_rim(graph, node)]
    if len(rim) < 2:
        return
    resolution = space.resolution_m
    free = np.ones(space.region.inside.shape, np.uint8)
    free[space.region.walls[:, 1], space.region.walls[:, 0]] = 0
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)
    wide = (distance >= midline_m / resolution - _SLACK_PX) & space.region.inside
    pairs = []
    for one, other in itertools.combinations(rim, 2):
        length = math.dist(graph.nodes[one].point_px, graph.nodes[other].point_px)
        if 1.0 < length * resolution <= _FARTHEST_M:
            pairs.append((length, one, other))
    made = list[Segment]()
    for length, one, other in sorted(pairs):
        ends = np.array([graph.nodes[one].point_px, graph.nodes[other].point_px])
        points = np.linspace(ends[0], ends[1], max(round(length), 3))
        columns, rows = np.round(points).astype(np.int64).T
        if not wide[rows, columns].all():
            continue
        straight = length * resolution
        way = graph.measure_way(one, other) * resolution
        if way <= DETOUR[0] * straight + DETOUR[1]:
            continue
        if any(_cross(ends, line) for line in made):
            continue
        made.append((ends[0], ends[1]))
        nowhere = np.full(len(points), OPEN)
        radius = distance[rows, columns].astype(float)
        graph.add(Branch(one, other, points, radius, nowhere, nowhere))


def _is_on_rim(graph: SkeletonGraph, node: int) -> bool:
    """Tell whether a node is a junction with open space on a side of one of its branches."""
    if graph.degree(node) < 3:
        return False
    for k in graph.at[node]:
        branch = graph.branches[k]
        for end, at in ((branch.tail, slice(0, 3)), (branch.head, slice(-3, None))):
            if end == node and OPEN in (*branch.left[at].tolist(), *branch.right[at].tolist()):
                return True
    return False


def _cross(ends: Array, line: Segment) -> bool:
    """Tell whether two segments cross between their ends."""

    def turn(a: Array, b: Array, c: Array) -> float:
        return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    (a, b), (c, d) = (ends[0], ends[1]), line
    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0
