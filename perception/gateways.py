"""Gateways: where a place ends and its paths begin.

Two ways of choosing where on an arm the gateway lies, *constriction* and *anchor*; one way of
finding its line and its outward direction, by a straight fit to the sub-cell skeleton.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.core import Arm
from perception.errors import InputError
from perception.geometry import Array
from perception.grid import Mask
from perception.region import Index, Region
from perception.skeleton import OPEN, Branch

Method = Literal["anchor", "constriction"]
Point = tuple[float, float]


@dataclass(frozen=True)
class Gateway:
    """The boundary between a place and the space beyond, in pixels: x right, y down.

    Attributes
    ----------
    centre_px : middle of the gateway.
    ends_px : its two ends, the left one first, looking outward.
    outward_rad : direction away from the place, atan2(dy, dx) in pixel axes (clockwise as seen).
    width_px : its length.
    frontier_px : width of the widest exit that its branch reaches.
    depth_px : length of the branch beyond it, to the farthest exit.
    confidence : 0..1, how sure it is that a path leaves here.
    kind : ``"midline"`` between two walls, ``"leftwall"`` or ``"rightwall"`` along one (the wall
        lies on that side looking outward).
    anchor_px : the wall point that fixed it, if one did.
    """

    centre_px: Point
    ends_px: tuple[Point, Point]
    outward_rad: float
    width_px: float
    frontier_px: float = 0.0
    depth_px: float = 0.0
    confidence: float = 1.0
    kind: str = "midline"
    anchor_px: Point | None = None


def find_gateway(
    arm: Arm,
    region: Region,
    *,
    method: Method = "anchor",
    min_frontier_px: float = 0.0,
    min_depth_px: float = 0.0,
) -> Gateway:
    """Find the gateway on an arm.

    Parameters
    ----------
    arm : a branch out of the core; see :func:`perception.core.find_core`.
    method : ``"anchor"`` (the wall point that defines most of the skeleton near the edge of the
        core) or ``"constriction"`` (the narrowest point there).
    min_frontier_px, min_depth_px : the limits the confidence is measured against.

    Raises
    ------
    InputError : there is no such method.

    Source
    ------
    Beeson 2008, Algorithms 6.2 to 6.5; the fitted direction is ours.
    """
    branch, edge = arm.branch, arm.edge
    area = _search_area(branch, edge)
    anchor: int | None = None
    if method == "anchor":
        anchor, place = _place_by_anchor(branch, region, edge, area)
    elif method == "constriction":
        place = _place_by_constriction(branch, edge, area)
    else:
        raise InputError(
            f"there is no gateway method {method!r}; choose 'anchor' or 'constriction'"
        )
    place = _settle(branch, region, place, area)
    direction = _fit_direction(branch, region, place)
    return _as_gateway(arm, region, place, direction, anchor, min_frontier_px, min_depth_px)


def _search_area(branch: Branch, edge: int) -> tuple[int, int]:
    """Return [first, last) of the points within the Voronoi radius of the edge of the core."""
    gap = np.hypot(*(branch.points_px - branch.points_px[edge]).T)
    far = np.flatnonzero(gap > branch.radius_px[edge])
    before, after = far[far < edge], far[far > edge]
    first = int(before[-1]) + 1 if len(before) else 1
    last = int(after[0]) if len(after) else len(gap)
    return min(first, edge), max(last, edge + 1)


def _place_by_constriction(branch: Branch, edge: int, area: tuple[int, int]) -> int:
    """Return the narrowest point of the search area, of equals the one nearest to the edge."""
    radius = branch.radius_px[area[0] : area[1]]
    narrow = np.flatnonzero(radius <= radius.min() + 0.25) + area[0]
    return int(narrow[np.argmin(np.abs(narrow - edge))])


def _place_by_anchor(
    branch: Branch, region: Region, edge: int, area: tuple[int, int]
) -> tuple[int | None, int]:
    """Return the anchor (index of a wall cell) and the point its reach ends at or begins with."""
    first, last = area
    best: tuple[int, int] | None = None
    for side in (branch.left, branch.right):
        walls = side[first:last]
        walls = walls[walls != OPEN]
        if not len(walls):
            continue
        value, count = np.unique(walls, return_counts=True)
        near = np.abs(value[:, None] - value[None]) <= 1
        near &= region.arc[value][:, None] == region.arc[value][None]
        total = near @ count
        top = int(total.argmax())
        if best is None or total[top] > best[0]:
            best = int(total[top]), int(value[top])
    if best is None or best[0] < max(4, 0.15 * (last - first)):
        return None, edge
    anchor = best[1]
    held = _held_by(branch, region, anchor)[first:last]
    wanted = np.flatnonzero(~held if held[edge - first] else held) + first
    inner, outer = wanted[wanted < edge], wanted[wanted > edge]
    if len(inner):
        return anchor, int(inner[-1])
    return anchor, int(outer[0]) if len(outer) else edge


def _held_by(branch: Branch, region: Region, anchor: int) -> Mask:
    """Tell for each point whether the anchor is its nearest wall on the left or on the right."""
    sides = np.stack([branch.left, branch.right])
    held = (np.abs(sides - anchor) <= 1) & (sides != OPEN)
    held &= region.arc[sides] == region.arc[anchor]
    return np.asarray(held.any(axis=0))


def _settle(branch: Branch, region: Region, place: int, area: tuple[int, int]) -> int:
    """Move to where the line between the two nearest walls crosses the skeleton, until at rest."""
    first, last = area
    points = branch.points_px[first:last]
    for _ in range(6):
        left, right = int(branch.left[place]), int(branch.right[place])
        if OPEN in (left, right):
            return place
        a, b = region.walls[left].astype(float), region.walls[right].astype(float)
        line = b - a
        length = float(np.hypot(*line))
        if length < 1e-9:
            return place
        across = np.abs((points - a) @ np.array([-line[1], line[0]])) / length
        along = (points - a) @ line / length**2
        across[(along < 0) | (along > 1)] = np.inf
        found = first + int(across.argmin())
        if found == place or not np.isfinite(across[found - first]):
            return place
        place = found
    return place


@dataclass(frozen=True)
class _Line:
    heading_rad: float
    residual_px: float
    length_px: float

    @property
    def is_straight(self) -> bool:
        return self.residual_px <= 0.45 + 0.035 * self.length_px


def _fit_line(points: Array) -> _Line | None:
    """Fit a line to points in order; None for fewer than three."""
    if len(points) < 3:
        return None
    step = points[-1] - points[0]
    heading, residual = _find_axis(points - points.sum(axis=0) / len(points), step)
    length = abs(float(step[0]) * math.cos(heading) + float(step[1]) * math.sin(heading))
    return _Line(heading, residual, length)


def _find_axis(centred: Array, step: Array) -> tuple[float, float]:
    """Return the main axis of centred points, turned to go with a step, and their rms off it."""
    (xx, xy), (_, yy) = (centred.T @ centred).tolist()
    heading = 0.5 * math.atan2(2 * xy, xx - yy)
    least = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
    if float(step[0]) * math.cos(heading) + float(step[1]) * math.sin(heading) < 0:
        heading = math.remainder(heading + math.pi, 2 * math.pi)
    return heading, math.sqrt(max(least, 0.0) / len(centred))


def _fit_direction(branch: Branch, region: Region, place: int) -> _Line:
    """Fit the direction of the path at a point of its skeleton.

    The walls beside the path outward are asked first; then the skeleton outward, as long as it is
    straight and does not look at the end of a wall; then the skeleton on both sides, and inward.
    """
    points, radius = branch.points_px, float(branch.radius_px[place])
    gap = np.hypot(*(points - points[place]).T)
    firm = _is_firm(branch, region)
    first = place - int(np.argmax((gap[place::-1] > radius) | (place == 0)))
    first = first if first < place else 0
    first = max(first, min(1, place))
    far = np.flatnonzero(gap[place:] > 2.0 * radius)
    last = place + (int(far[0]) if len(far) else len(points) - place)
    vague = np.flatnonzero(~firm[place:last])
    sure = place + int(vague[0]) if len(vague) else last
    short = max(2.0 * radius - float(gap[last - 1]), 0.0) if len(vague) else 0.0
    around = (first, max(last, place + 1))
    fits: tuple[Callable[[], _Line | None], ...] = (
        lambda: _fit_walls(branch, region, (place, last), radius, short),
        lambda: _fit_line(points[place:sure]),
        lambda: _fit_walls(branch, region, around, radius, short),
        lambda: _fit_line(points[first : max(sure, place + 1)]),
        lambda: _fit_line(points[first : place + 1]),
    )
    found: list[_Line] = []
    for fit in fits:
        line = fit()
        if line is None:
            continue
        if line.is_straight and line.length_px >= 0.8 * radius:
            return line
        found.append(line)
    if found:
        return min(found, key=lambda line: (line.residual_px + 0.5) / max(line.length_px, 1.0))
    step = points[-1] - points[0]
    return _Line(math.atan2(step[1], step[0]), 1.0, 1.0)


def _fit_walls(
    branch: Branch, region: Region, window: tuple[int, int], radius_px: float, extend_px: float
) -> _Line | None:
    """Fit one direction to the walls on the left and on the right of a stretch of branch.

    A wall that the stretch looks at in one point only, a corner, says nothing about it. Where the
    branch ends early, the walls are followed further, by ``extend_px``.
    """
    first, last = window
    if last - first < 2:
        return None
    step = branch.points_px[last - 1] - branch.points_px[first]
    centred = []
    for side in (branch.left[first:last], branch.right[first:last]):
        seen = _see_wall(side, region, round(extend_px))
        if len(seen) < 3:
            continue
        wall = region.walls[seen].astype(float)
        centred.append(wall - wall.mean(axis=0))
    if not centred:
        return None
    heading, residual = _find_axis(np.concatenate(centred), step)
    axis = np.array([math.cos(heading), math.sin(heading)])
    reach = max(float(np.ptp(wall @ axis)) for wall in centred)
    if reach < 0.8 * radius_px:
        return None
    return _Line(heading, residual, reach)


def _see_wall(side: Index, region: Region, extend: int) -> Index:
    """Return the wall cells seen on one side, and ``extend`` more in the direction of travel."""
    side = side[side != OPEN]
    seen = np.unique(side)
    if len(seen) < 2 or extend < 1:
        return seen
    ahead = int(side[-1])
    sign = 1 if ahead > int(np.median(side)) else -1
    more = ahead + sign * np.arange(1, extend + 1)
    more = more[(more >= 0) & (more < len(region.arc))]
    more = more[region.arc[more] == region.arc[ahead]]
    return np.union1d(seen, more)


def _is_firm(branch: Branch, region: Region) -> Mask:
    """Tell for each point whether its walls are seen there, not only their ends."""
    firm = np.ones(len(branch.points_px), bool)
    for side in (branch.left, branch.right):
        firm &= (side == OPEN) | (region.tip_distance[side] > 1)
    return firm


def _as_gateway(
    arm: Arm,
    region: Region,
    place: int,
    line: _Line,
    anchor: int | None,
    min_frontier_px: float,
    min_depth_px: float,
) -> Gateway:
    """Put the gateway across its direction."""
    branch = arm.branch
    x, y = (float(v) for v in branch.points_px[place])
    radius = float(branch.radius_px[place])
    dx, dy = math.cos(line.heading_rad), math.sin(line.heading_rad)
    ends = ((x + dy * radius, y - dx * radius), (x - dy * radius, y + dx * radius))
    depth = arm.depth_px - float(branch.steps_px[place]) if arm.depth_px else 0.0
    kind = "midline"
    if branch.left[place] == OPEN or branch.right[place] == OPEN:
        kind = "rightwall" if branch.left[place] == OPEN else "leftwall"
    point = None if anchor is None else region.walls[anchor]
    return Gateway(
        (x, y),
        ends,
        line.heading_rad,
        2 * radius,
        arm.frontier_px,
        max(depth, 0.0),
        _confide(arm, max(depth, 0.0), min_frontier_px, min_depth_px),
        kind,
        None if point is None else (float(point[0]), float(point[1])),
    )


def _confide(arm: Arm, depth_px: float, min_frontier_px: float, min_depth_px: float) -> float:
    """Return how far frontier and depth are above their limits, as 0.5 (at one) to 1."""
    if arm.frontier_px <= 0:
        return 1.0  # a loop: it leads back here
    sure = 1.0
    for value, limit in ((arm.frontier_px, min_frontier_px), (depth_px, min_depth_px)):
        if limit > 0:
            sure *= 1.0 - 0.5 * math.exp(-2.0 * max(value / limit - 1.0, 0.0))
    return sure
