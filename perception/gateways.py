"""Gateways: where a place ends and its paths begin.

Two published ways of choosing where on an arm the gateway lies: *anchor* (the default, with virtual
obstacles in open spaces) and *constriction*. Two ways of finding its direction: *fit* (the default,
ours) and *heading* (as published); see :mod:`perception.gateway_direction`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from perception.core import Arm
from perception.cracks import OPEN
from perception.errors import InputError
from perception.gateway_direction import fit_direction, mean_heading
from perception.geometry import Array
from perception.grid import Mask
from perception.path_types import tell_path_type
from perception.region import Index, Region
from perception.skeleton import Branch
from perception.virtual_walls import Sides, VirtualWalls, is_open, see_virtual_walls, see_walls

Method = Literal["anchor", "constriction"]
Direction = Literal["fit", "heading"]
Point = tuple[float, float]

_LEADS_FAR = 2.0
"""Beyond this multiple of the least depth, a branch is the surer the farther it leads."""

_AT_EDGE = 0.1
"""Share of a search area; the reach of an anchor may begin so far beyond the edge of the core."""

_VIRTUAL_NEIGHBOURS = 4
"""Cells of a virtual outline this near on it are one anchor; it is rougher than a wall."""


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
    anchor_px : the wall point that fixed it, if one did; it may be virtual.
    path_type : of the directed local-path that leaves here; see :mod:`perception.path_types`.
    opposite_type : of its opposite, where that cannot be travelled: ``"DEADEND"`` or ``"NONE"``.
    neck_px : width of the narrowest spot from here to as far beyond as the gateway is wide.
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
    path_type: str = ""
    opposite_type: str = ""
    neck_px: float = math.inf


def find_gateway(
    arm: Arm,
    region: Region,
    *,
    method: Method = "anchor",
    direction: Direction = "fit",
    virtual: VirtualWalls | None = None,
    min_frontier_px: float = 0.0,
    min_depth_px: float = 0.0,
) -> Gateway:
    """Find the gateway on an arm.

    Parameters
    ----------
    arm : a branch out of the core; see :func:`perception.core.find_core`.
    method : ``"anchor"``: beside the wall point that defines most of the skeleton near the edge of
        the core; or ``"constriction"``: at the narrowest point there.
    direction : ``"fit"`` or ``"heading"``; see :mod:`perception.gateway_direction`.
    virtual : obstacles to be anchored to where there is no wall, if any.
    min_frontier_px, min_depth_px : the limits the confidence is measured against.

    Raises
    ------
    InputError : there is no such method or direction.

    Source
    ------
    Beeson 2008, Algorithms 6.2 to 6.5. Ours: neighbouring wall cells count as one anchor, since
    the corner of a wall is several cells of a grid; a wall point that defines less than 15 % of
    the search area anchors nothing (the gateway is then at the edge of the core); where its reach
    ends at the edge but for a few cells, the few cells do not count; *fit*.
    """
    for value, known, what in (
        (method, Method, "gateway method"),
        (direction, Direction, "way to find a direction"),
    ):
        if value not in get_args(known):
            choice = " or ".join(repr(name) for name in get_args(known))
            raise InputError(f"there is no {what} {value!r}; choose {choice}")
    branch, edge = arm.branch, arm.edge
    area = _search_area(branch, edge)
    sides, anchor = see_walls(branch, region), None
    if method == "anchor":
        if virtual is not None and is_open(branch, area):
            sides = see_virtual_walls(branch, region, virtual, area)
        anchor, place = _place_by_anchor(sides, branch.points_px, edge, area)
    else:
        place = _place_by_constriction(branch, edge, area)
    place = _settle(branch, region, place, area)
    point = None
    if anchor is not None:
        point = float(sides.cells[anchor, 0]), float(sides.cells[anchor, 1])
    if direction == "fit":
        heading = fit_direction(branch, region, place).heading_rad
    else:
        heading = _turn_to_anchor(branch, place, point, mean_heading(branch, place))
    return _as_gateway(arm, place, heading, point, min_frontier_px, min_depth_px)


def needs_virtual_walls(arms: Sequence[Arm]) -> bool:
    """Tell whether an arm lies beside open space where its gateway is searched for."""
    return any(
        is_open(arm.branch, (0, len(arm.branch.left)))
        and is_open(arm.branch, _search_area(arm.branch, arm.edge))
        for arm in arms
    )


def _search_area(branch: Branch, edge: int) -> tuple[int, int]:
    """Return [first, last) of the points within the Voronoi radius of the edge of the core."""
    first, last = branch.within(edge, float(branch.radius_px[edge]))
    return min(max(first, 1), edge), last


def _place_by_constriction(branch: Branch, edge: int, area: tuple[int, int]) -> int:
    """Return the narrowest point of the search area, of equals the one nearest to the edge."""
    radius = branch.radius_px[area[0] : area[1]]
    narrow = np.flatnonzero(radius <= radius.min() + 0.25) + area[0]
    return int(narrow[np.argmin(np.abs(narrow - edge))])


def _place_by_anchor(
    sides: Sides, points: Array, edge: int, area: tuple[int, int]
) -> tuple[int | None, int]:
    """Return the anchor (index of an obstacle) and the point its reach ends at or begins with."""
    first, last = area
    best: tuple[int, int] | None = None  # points held, anchor
    for side in (sides.left, sides.right):
        seen = side[first:last]
        seen = seen[seen != OPEN]
        if not len(seen):
            continue
        count, least = _count_held(seen, sides.arc)
        most = int(count.max())
        if best is None or most > best[0]:
            ties = (count == most).nonzero()[0] + least
            gap = np.hypot(*(sides.cells[ties] - points[edge]).T)
            best = most, int(ties[np.argmin(gap)])
    if best is None or best[0] < max(4, 0.15 * (last - first)):
        return None, edge
    anchor = best[1]
    held = _held_by(sides, anchor, area)
    wanted = (~held if held[edge - first] else held).nonzero()[0] + first
    inner, outer = wanted[wanted < edge], wanted[wanted > edge]
    near = _AT_EDGE * (last - first)
    if len(outer) and outer[0] - edge <= near and not (len(inner) and edge - inner[-1] <= near):
        return anchor, int(outer[0])
    if len(inner):
        return anchor, int(inner[-1])
    return anchor, int(outer[0]) if len(outer) else edge


def _count_held(seen: Index, arc: Index) -> tuple[Index, int]:
    """Count how many points see each obstacle or one of its neighbours, from the least one on."""
    least = int(seen.min())
    own = np.bincount(seen - least)
    count = own.copy()
    if len(own) > 1:
        span = arc[least : least + len(own)]
        same = span[1:] == span[:-1]
        count[1:] += own[:-1] * same
        count[:-1] += own[1:] * same
    count[own == 0] = 0
    return count, least


def _held_by(sides: Sides, anchor: int, area: tuple[int, int]) -> Mask:
    """Tell for each point of an area whether the anchor is the nearest obstacle on a side."""
    first, last = area
    held = np.zeros(last - first, bool)
    near = _VIRTUAL_NEIGHBOURS if anchor >= sides.real else 1
    for side in (sides.left[first:last], sides.right[first:last]):
        held |= (
            (np.abs(side - anchor) <= near)
            & (side != OPEN)
            & (sides.arc.take(side) == sides.arc[anchor])
        )
    return held


def _turn_to_anchor(branch: Branch, place: int, anchor: Point | None, heading_rad: float) -> float:
    """Return the direction across the line from an anchor, beside open space only."""
    if anchor is None or OPEN not in (branch.left[place], branch.right[place]):
        return heading_rad
    x, y = branch.points_px[place].tolist()
    across = math.atan2(anchor[1] - y, anchor[0] - x) + math.pi / 2
    if math.cos(across - heading_rad) < 0:
        across += math.pi
    return math.remainder(across, 2 * math.pi)


def _settle(branch: Branch, region: Region, place: int, area: tuple[int, int]) -> int:
    """Move to where the line between the two nearest walls crosses the skeleton, until at rest."""
    first, last = area
    x, y = branch.points_px[first:last].T
    for _ in range(6):
        left, right = int(branch.left[place]), int(branch.right[place])
        if OPEN in (left, right):
            return place
        (ax, ay), (bx, by) = region.walls[[left, right]].tolist()
        dx, dy = bx - ax, by - ay
        if not (dx or dy):
            return place
        off_x, off_y = x - ax, y - ay
        across = np.abs(off_y * dx - off_x * dy) / math.hypot(dx, dy)
        along = off_x * dx + off_y * dy
        across[(along < 0) | (along > dx * dx + dy * dy)] = np.inf
        found = first + int(across.argmin())
        if found == place or not np.isfinite(across[found - first]):
            return place
        place = found
    return place


def _as_gateway(
    arm: Arm,
    place: int,
    heading_rad: float,
    anchor: Point | None,
    min_frontier_px: float,
    min_depth_px: float,
) -> Gateway:
    """Put the gateway across its direction."""
    branch = arm.branch
    x, y = (float(v) for v in branch.points_px[place])
    radius = float(branch.radius_px[place])
    dx, dy = math.cos(heading_rad), math.sin(heading_rad)
    ends = ((x + dy * radius, y - dx * radius), (x - dy * radius, y + dx * radius))
    depth = arm.depth_px - float(branch.steps_px[place]) if arm.depth_px else 0.0
    ahead = branch.steps_px[place:] - branch.steps_px[place]
    neck = 2 * float(branch.radius_px[place:][ahead <= 2 * radius].min())
    kind = "midline"
    if branch.left[place] == OPEN or branch.right[place] == OPEN:
        kind = "rightwall" if branch.left[place] == OPEN else "leftwall"
    return Gateway(
        (x, y),
        ends,
        heading_rad,
        2 * radius,
        arm.frontier_px,
        max(depth, 0.0),
        rate_way(arm.frontier_px, max(depth, 0.0), min_frontier_px, min_depth_px),
        kind,
        anchor,
        tell_path_type(branch, place),
        neck_px=neck,
    )


def rate_way(
    frontier_px: float, depth_px: float, min_frontier_px: float, min_depth_px: float
) -> float:
    """Return how sure it is that a way leads out: how far frontier and depth exceed their limits.

    A narrow frontier raises no doubt about a way that is known to lead far.

    Parameters
    ----------
    frontier_px, depth_px : of the way; a frontier of 0 is that of a loop, which leads back here.
    min_frontier_px, min_depth_px : the limits, at which the odds are even; 0 for none.

    Returns
    -------
    0.25 (both at their limits) to 1.

    Source
    ------
    Ours.

    Examples
    --------
    >>> rate_way(0.0, 9.0, 4.0, 8.0), rate_way(4.0, 40.0, 0.0, 8.0) > 0.99, rate_way(4, 8, 4, 8)
    (1.0, True, 0.25)
    """
    if frontier_px <= 0:
        return 1.0
    far = max(depth_px / min_depth_px - _LEADS_FAR, 0.0) if min_depth_px > 0 else 0.0
    width_px = frontier_px + far * min_frontier_px
    sure = 1.0
    for value, limit in ((width_px, min_frontier_px), (depth_px, min_depth_px)):
        if limit > 0:
            sure *= 1.0 - 0.5 * math.exp(-2.0 * max(value / limit - 1.0, 0.0))
    return sure
