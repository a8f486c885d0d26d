"""The level of a floor map: which of its gateways count as ways, and what is left without them."""

from __future__ import annotations

import math
from collections import Counter, defaultdict, deque
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from perception.constrictions import Constriction
from perception.errors import InputError
from perception.gateway_kinds import GatewayKind
from perception.skeleton import Branch
from perception.skeleton_graph import SkeletonGraph

FloorDoors = Literal["keep", "ignore"]

WAY_ON_M = 20.0
"""What lies behind a door is a part of the floor, not a room, if its ways are at least so long."""

DOOR_WIDTH_M = 2.0
"""Mouths no wider than this are closed with the doors."""

_STUB_M = 2.0

_Part = tuple[int, int]
"""A stretch of a branch between two cuts, or (node, -1); standing for all that hangs together."""
_Sides = tuple[_Part, _Part]


def choose_closed(
    graph: SkeletonGraph,
    constrictions: Sequence[Constriction],
    kinds: Sequence[GatewayKind | None],
    resolution_m: float,
    *,
    doors: FloorDoors,
    min_gateway_m: float,
) -> set[int]:
    """Return the numbers of the constrictions that are not passed.

    Parameters
    ----------
    graph : the skeleton, branches numbered as in the constrictions.
    doors : "ignore" closes doors, and mouths as narrow where nothing else leads on; those stay that
        join long ways to each other, as corridors, the fewest that do.
    min_gateway_m : constrictions narrower than this are closed.

    Raises
    ------
    InputError : ``doors`` is something else, or the width is none.

    Source
    ------
    Ours; Beeson 2008, 5.3, has doors as gateways that may be left out.
    """
    if doors not in ("keep", "ignore"):
        raise InputError(f"doors={doors!r}: expected 'keep' or 'ignore'")
    if not (math.isfinite(min_gateway_m) and min_gateway_m >= 0):
        raise InputError(f"min_gateway_m is {min_gateway_m}; expected metres, zero or more")
    closed = {k for k, c in enumerate(constrictions) if c.width_m < min_gateway_m}
    if doors == "keep":
        return closed
    doors_of_rooms = closed | {k for k, kind in enumerate(kinds) if kind == "door"}
    mouths = {
        k
        for k, (c, kind) in enumerate(zip(constrictions, kinds, strict=True))
        if kind == "mouth" and c.width_m <= DOOR_WIDTH_M
    }
    sides, _ = _find_sides(graph, constrictions, doors_of_rooms | mouths)
    degree = Counter(part for pair in sides.values() for part in set(pair))
    found = doors_of_rooms | {k for k in mouths if min(degree[part] for part in sides[k]) == 1}
    sides, length = _find_sides(graph, constrictions, found)
    large = {part for part, size in length.items() if size * resolution_m >= WAY_ON_M}
    return found - _join_parts({k: sides[k] for k in found - closed}, large)


def _find_sides(
    graph: SkeletonGraph, constrictions: Sequence[Constriction], closed: set[int]
) -> tuple[dict[int, _Sides], dict[_Part, float]]:
    """Return the parts of the skeleton on both sides of what is closed, and their lengths (px)."""
    cuts: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for k in closed:
        cuts[constrictions[k].branch].append((constrictions[k].point, k))
    root: dict[_Part, _Part] = {}

    def find(item: _Part) -> _Part:
        while root.setdefault(item, item) != item:
            item = root[item]
        return item

    sides: dict[int, _Sides] = {}
    pieces = list[tuple[_Part, float]]()
    for number, branch in graph.branches.items():
        steps, own = branch.steps_px, sorted(cuts[number])
        ends = [0, *(point for point, _ in own), len(steps) - 1]
        names = [(number, j) for j in range(len(ends) - 1)]
        root[find(names[0])] = find((branch.tail, -1))
        root[find(names[-1])] = find((branch.head, -1))
        for j, name in enumerate(names):
            pieces.append((name, float(steps[ends[j + 1]] - steps[ends[j]])))
        sides |= {k: (names[j], names[j + 1]) for j, (_, k) in enumerate(own)}
    length: dict[_Part, float] = defaultdict(float)
    for name, size in pieces:
        length[find(name)] += size
    return {k: (find(one), find(other)) for k, (one, other) in sides.items()}, length


def _join_parts(sides: Mapping[int, _Sides], large: set[_Part]) -> set[int]:
    """Return the doors that join the large parts, by one way each, through the fewest doors."""
    opened, waiting = set[int](), set(large)
    while waiting:
        joined = {min(waiting)}
        while joined:
            waiting -= joined
            way = _find_way(sides, joined, waiting)
            if not way:
                break
            opened |= set(way)
            joined |= {part for k in way for part in sides[k]}
    return opened


def _find_way(sides: Mapping[int, _Sides], starts: set[_Part], goals: set[_Part]) -> list[int]:
    """Return the doors from one of the starts to the nearest goal; none if there is no way."""
    came: dict[_Part, tuple[int, _Part] | None] = dict.fromkeys(starts)
    queue = deque(sorted(starts))
    while queue:
        here = queue.popleft()
        if here in goals:
            way, step = list[int](), came[here]
            while step is not None:
                way.append(step[0])
                step = came[step[1]]
            return way
        for k, (one, other) in sorted(sides.items()):
            if here in (one, other):
                beyond = other if here == one else one
                if beyond not in came:
                    came[beyond] = (k, here)
                    queue.append(beyond)
    return []


def close_gateways(
    graph: SkeletonGraph,
    constrictions: Sequence[Constriction],
    closed: set[int],
    resolution_m: float,
    *,
    start_px: tuple[float, float] | None = None,
) -> None:
    """Cut the skeleton at constrictions and keep one part.

    Parameters
    ----------
    start_px : the part nearest to this point is kept; by default the one with most skeleton.
    """
    cuts: dict[int, set[int]] = defaultdict(set)
    for k in closed:
        cuts[constrictions[k].branch].add(constrictions[k].point)
    ends = set[int]()
    for number, points in cuts.items():
        ends |= graph.cut(number, sorted(points))
    for node in list(graph.at):
        graph.join_at(node)
    near = None
    if start_px is not None:
        gap = {k: _measure_gap(b, start_px) for k, b in graph.branches.items()}
        near = min(gap, key=lambda k: gap[k], default=None)
    graph.keep_largest(near)
    for node in ends:
        for k in list(graph.at.get(node, ())):
            if not graph.is_leaf(k):
                continue
            outward = graph.orient_leaf(k)
            reach = (float(outward.steps_px[-1]) - float(outward.radius_px[0])) * resolution_m
            if outward.head == node and reach < _STUB_M:
                graph.remove(k)


def _measure_gap(branch: Branch, point_px: tuple[float, float]) -> float:
    return float(np.hypot(*(branch.points_px - point_px).T).min())
