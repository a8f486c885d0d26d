"""Which constrictions are doors, and the evidence for it.

A door is a gap in a wall that goes on in line beyond the gap, and one has to go a long way round
if one does not pass it; a gap between pieces of furniture has neither.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.constrictions import Constriction
from perception.floor_space import FloorSpace
from perception.geometry import Array
from perception.grid import Mask
from perception.skeleton import Branch, Skeleton

_FAN_RAD = np.deg2rad(np.arange(-15, 16, 3))
_ALONG_M = np.arange(0.1, 2.01, 0.05)
_NEAR_M = 0.9
_BESIDE_M = (0.4, 0.55)
_SLACK_M = 0.1
_SEARCH_M = 40.0
_WALL_THICK_M = 0.45


@dataclass(frozen=True)
class DoorRule:
    """What makes a constriction a door.

    Attributes
    ----------
    width_m : doors are no wider.
    detour_m : the way round is longer.
    area_m2 : the space behind, if there is no way round, is larger.
    thing_m : neither end is a free-standing thing smaller than this, unless it is a piece of wall.
    block_m : if an end is a free-standing thing shorter than the first of these and thicker than
        the second, a table or a group of seats, a wall goes on in line for the share
    block_in_line : of the first 2 m beyond an end.
    opening, in_line_near : either it opens so many times wider on both sides, and a wall goes on in
        line for this share of the first 0.8 m beyond an end;
    sure_opening, sure_width_m, sure_in_line, sure_detour_m, sure_thick_m : even if an end is a
        short piece of wall, no thicker than the last: it opens so many times wider on both sides,
        is no wider than this, a wall goes on in line for this share of the first 2 m and of the
        first 0.8 m, and the way round is longer than this.
    wide_opening, space_m, in_line : or it opens so many times wider, into spaces this wide, and a
        wall goes on in line for this share of the first 2 m beyond an end.

    Source
    ------
    Ours, measured on annotated floors; see tests/bench/bench_floor_maps.py.
    """

    width_m: float = 2.0
    detour_m: float = 10.0
    area_m2: float = 1.0
    thing_m: float = 2.0
    block_m: tuple[float, float] = (5.5, 0.9)
    block_in_line: float = 0.8
    opening: float = 1.55
    in_line_near: float = 0.5
    sure_opening: float = 1.7
    sure_width_m: float = 1.5
    sure_in_line: float = 0.9
    sure_detour_m: float = 5.0
    sure_thick_m: float = 0.55
    wide_opening: float = 1.25
    space_m: float = 1.9
    in_line: float = 0.85


@dataclass(frozen=True, eq=False)
class DoorEvidence:
    """What speaks for doors, one row a constriction.

    Attributes
    ----------
    in_line, in_line_near : (n,) share of the first 2 m, and 0.8 m, beyond the better end where a
        wall goes on in line with the gap and none crosses it.
    detour_m : (n,) length of the shortest way from one side to the other; infinite if none.
    area_m2 : (n,) the smaller of the spaces on its two sides; infinite if there is a way round.
    thing_m : (n, 2, 2) long and short side of the wall contour that each end lies on.
    """

    in_line: Array
    in_line_near: Array
    detour_m: Array
    area_m2: Array
    thing_m: Array


def find_doors(
    constrictions: Sequence[Constriction], evidence: DoorEvidence, rule: DoorRule | None = None
) -> NDArray[np.bool_]:
    """Tell of each constriction whether it is a door."""
    rule = rule or DoorRule()
    width = np.array([c.width_m for c in constrictions])
    opening = np.array([c.opening for c in constrictions])
    narrow = (opening >= rule.opening) & (evidence.in_line_near >= rule.in_line_near)
    wide = (opening >= rule.wide_opening) & (opening * width >= rule.space_m)
    door = narrow | (wide & (evidence.in_line >= rule.in_line))
    door &= (width <= rule.width_m) & ~find_things(evidence, rule.thing_m)
    door &= ~_find_blocks(evidence, rule.block_m) | (evidence.in_line >= rule.block_in_line)
    door &= evidence.detour_m >= rule.detour_m
    sure = (opening >= rule.sure_opening) & (width <= rule.sure_width_m)
    sure &= np.minimum(evidence.in_line, evidence.in_line_near) >= rule.sure_in_line
    sure &= evidence.detour_m >= rule.sure_detour_m
    sure &= ~_find_blocks(evidence, (rule.thing_m, rule.sure_thick_m))
    return np.asarray((door | sure) & (evidence.area_m2 >= rule.area_m2))


def _find_blocks(evidence: DoorEvidence, size_m: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell whether an end lies on a free-standing thing shorter and thicker than this."""
    long, short = evidence.thing_m[..., 0], evidence.thing_m[..., 1]
    return np.asarray(((long < size_m[0]) & (short > size_m[1])).any(axis=1))


def find_things(evidence: DoorEvidence, size_m: float) -> NDArray[np.bool_]:
    """Tell whether an end lies on a free-standing thing smaller than this, no piece of wall."""
    long, short = evidence.thing_m[..., 0], evidence.thing_m[..., 1]
    thing = (long < size_m) & ((short > _WALL_THICK_M) | (long < 0.6 * size_m))
    return np.asarray(thing.any(axis=1))


def gather_evidence(
    space: FloorSpace, skeleton: Skeleton, constrictions: Sequence[Constriction]
) -> DoorEvidence:
    """Measure what speaks for doors."""
    ends = np.array([c.ends_px for c in constrictions], float).reshape(-1, 2, 2)
    in_line, near = _measure_in_line(space, ends)
    ways = _measure_ways(skeleton, constrictions, space.resolution_m)
    sides = measure_things(space)
    arc = space.region.arc
    things = [
        [
            sides[arc[skeleton.branches[c.branch].left[c.point]]],
            sides[arc[skeleton.branches[c.branch].right[c.point]]],
        ]
        for c in constrictions
    ]
    return DoorEvidence(
        in_line.max(axis=1), near.max(axis=1), ways[:, 0], ways[:, 1], np.array(things)
    )


def _measure_in_line(space: FloorSpace, ends: Array) -> tuple[Array, Array]:
    """Return for each end (n, 2) the share of 2 m and of 0.8 m beyond it where a wall goes on."""
    wall = _thicken(space.occupied, _SLACK_M / space.resolution_m)
    line = _sample(wall, ends, 0.0, space.resolution_m)
    beside = []
    for sign in (1, -1):
        near, far = (sign * offset for offset in _BESIDE_M)
        beside.append(
            _sample(wall, ends, near, space.resolution_m)
            | _sample(wall, ends, far, space.resolution_m)
        )
    good = line & ~(beside[0] & beside[1])  # a wall on both sides crosses the line
    close = good[..., _ALONG_M < _NEAR_M]
    return good.mean(axis=-1).max(axis=-1), close.mean(axis=-1).max(axis=-1)


def _sample(wall: Mask, ends: Array, offset_m: float, resolution_m: float) -> NDArray[np.bool_]:
    """Return (n, 2, angles, steps) whether there is wall along lines beyond each end."""
    height, width = wall.shape
    along = ends - ends[:, ::-1]
    angle = np.arctan2(along[..., 1], along[..., 0])[..., None, None] + _FAN_RAD[:, None]
    way, offset = _ALONG_M / resolution_m, offset_m / resolution_m
    x = ends[..., 0, None, None] + np.cos(angle) * way - np.sin(angle) * offset
    y = ends[..., 1, None, None] + np.sin(angle) * way + np.cos(angle) * offset
    column, row = np.round(x).astype(np.int64), np.round(y).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    hit = wall[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)] & inside
    return np.asarray(hit)


def _thicken(mask: Mask, by_px: float) -> Mask:
    side = 2 * max(1, math.floor(by_px)) + 1
    shape = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.dilate(mask.view(np.uint8), shape).astype(bool)


def measure_things(space: FloorSpace) -> Array:
    """Return the long and the short side (m) of the rectangle around each wall contour."""
    region = space.region
    cuts = np.flatnonzero(np.diff(region.arc)) + 1
    sides = []
    for points in np.split(region.walls, cuts):
        _, (w, h), _ = cv2.minAreaRect(points.astype(np.float32))
        sides.append([max(w, h) * space.resolution_m, min(w, h) * space.resolution_m])
    return np.array(sides)


_Links = dict[int, list[tuple[int, float, int, float]]]
"""By node: (node at the other end, length in m, branch, area in m2)."""


def _measure_ways(
    skeleton: Skeleton, constrictions: Sequence[Constriction], resolution_m: float
) -> Array:
    """Return (n, 2) the way round each constriction (m), and the space behind it (m2)."""
    links: _Links = defaultdict(list)
    for k, branch in enumerate(skeleton.branches):
        length = float(branch.steps_px[-1]) * resolution_m
        area = _measure_area(branch, slice(None), resolution_m)
        links[branch.tail].append((branch.head, length, k, area))
        links[branch.head].append((branch.tail, length, k, area))
    return np.array([_measure_way(skeleton, c, links, resolution_m) for c in constrictions])


def _measure_area(branch: Branch, part: slice, resolution_m: float) -> float:
    """Return roughly the area along a part of a branch, m2."""
    points = branch.points_px[part]
    if len(points) < 2:
        return 0.0
    step = np.hypot(*np.diff(points, axis=0).T)
    return float((2.0 * branch.radius_px[part][1:] * step).sum()) * resolution_m**2


def _measure_way(
    skeleton: Skeleton, c: Constriction, links: _Links, resolution_m: float
) -> tuple[float, float]:
    branch = skeleton.branches[c.branch]
    steps = branch.steps_px * resolution_m
    if branch.tail == branch.head:
        return float(steps[-1]), math.inf
    before = _measure_area(branch, slice(0, c.point + 1), resolution_m)
    after = _measure_area(branch, slice(c.point, None), resolution_m)
    way, area = _walk(links, branch.tail, branch.head, c.branch)
    if math.isfinite(way):
        return way + float(steps[-1]), math.inf
    if math.isfinite(area):
        return math.inf, area + before
    _, area = _walk(links, branch.head, branch.tail, c.branch)
    return math.inf, area + after


def _walk(links: _Links, start: int, goal: int, without: int) -> tuple[float, float]:
    """Return the way to the goal, and the area of all that can be reached if that is not far."""
    way = {start: 0.0}
    queue = [(0.0, start)]
    done, used = set[int](), set[int]()
    area = 0.0
    while queue:
        here, node = heapq.heappop(queue)
        if node in done:
            continue
        done.add(node)
        if node == goal:
            return here, math.inf
        if here > _SEARCH_M:
            return math.inf, math.inf
        for other, length, k, part in links[node]:
            if k == without:
                continue
            if k not in used:
                used.add(k)
                area += part
            if here + length < way.get(other, math.inf):
                way[other] = here + length
                heapq.heappush(queue, (here + length, other))
    return math.inf, area
