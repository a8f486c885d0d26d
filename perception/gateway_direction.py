"""The direction in which a path leaves through a gateway.

*fit* (the default, ours) fits a straight line to the walls beside the path or to the sub-cell
skeleton; *heading* is the mean heading to the neighbouring points of the skeleton, as published.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from perception.cracks import OPEN
from perception.geometry import Array
from perception.grid import Mask
from perception.region import Index, Region
from perception.skeleton import Branch


@dataclass(frozen=True)
class Line:
    """A straight line fitted to points.

    Attributes
    ----------
    heading_rad : its direction, atan2(dy, dx) in pixel axes.
    residual_px : root mean square of the distances from it.
    length_px : how far the points reach along it.
    """

    heading_rad: float
    residual_px: float
    length_px: float

    @property
    def is_straight(self) -> bool:
        """Whether the points lie close to it."""
        return self.residual_px <= 0.45 + 0.035 * self.length_px


def _fit_line(points: Array) -> Line | None:
    """Fit a line to points in order; None for fewer than three."""
    if len(points) < 3:
        return None
    step = points[-1] - points[0]
    heading, residual = _find_axis(points - points.sum(axis=0) / len(points), step)
    length = abs(float(step[0]) * math.cos(heading) + float(step[1]) * math.sin(heading))
    return Line(heading, residual, length)


def _find_axis(centred: Array, step: Array) -> tuple[float, float]:
    """Return the main axis of centred points, turned to go with a step, and their rms off it."""
    (xx, xy), (_, yy) = (centred.T @ centred).tolist()
    heading = 0.5 * math.atan2(2 * xy, xx - yy)
    least = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
    if float(step[0]) * math.cos(heading) + float(step[1]) * math.sin(heading) < 0:
        heading = math.remainder(heading + math.pi, 2 * math.pi)
    return heading, math.sqrt(max(least, 0.0) / len(centred))


def fit_direction(branch: Branch, region: Region, place: int) -> Line:
    """Fit the direction of the path at a point of its skeleton, outward.

    The walls beside the path outward are asked first; then the skeleton outward, as long as it is
    straight and does not look at the end of a wall; then the skeleton on both sides, and inward.

    Source
    ------
    Ours, for the headings of a thinned skeleton are off by 4 degrees (Beeson 2008, Figure 6.33).
    """
    points, radius = branch.points_px, float(branch.radius_px[place])
    first = max(branch.within(place, radius)[0] - 1, min(1, place))
    _, last = branch.within(place, 2.0 * radius)
    vague = (~_is_firm(branch, region, (place, last))).nonzero()[0]
    sure, short = last, 0.0
    if len(vague):
        sure = place + int(vague[0])
        short = max(2.0 * radius - math.dist(points[last - 1], points[place]), 0.0)
    around = (first, max(last, place + 1))
    fits: tuple[Callable[[], Line | None], ...] = (
        lambda: _fit_walls(branch, region, (place, last), radius, short),
        lambda: _fit_line(points[place:sure]),
        lambda: _fit_walls(branch, region, around, radius, short),
        lambda: _fit_line(points[first : max(sure, place + 1)]),
        lambda: _fit_line(points[first : place + 1]),
    )
    found: list[Line] = []
    for fit in fits:
        line = fit()
        if line is None:
            continue
        if line.is_straight and line.length_px >= 0.8 * radius:
            return line
        found.append(line)
    if found:
        return min(found, key=lambda line: (line.residual_px + 0.5) / max(line.length_px, 1.0))
    x, y = (points[-1] - points[0]).tolist()
    return Line(math.atan2(y, x), 1.0, 1.0)


def _fit_walls(
    branch: Branch, region: Region, window: tuple[int, int], radius_px: float, extend_px: float
) -> Line | None:
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
        wall = region.walls.take(seen, axis=0).astype(float)
        centred.append(wall - wall.sum(axis=0) / len(wall))
    if not centred:
        return None
    heading, residual = _find_axis(np.concatenate(centred), step)
    axis = np.array([math.cos(heading), math.sin(heading)])
    along = [wall @ axis for wall in centred]
    reach = max(float(way.max() - way.min()) for way in along)
    if reach < 0.8 * radius_px:
        return None
    return Line(heading, residual, reach)


def _see_wall(side: Index, region: Region, extend: int) -> Index:
    """Return the wall cells seen on one side, and ``extend`` more in the direction of travel."""
    side = side[side != OPEN]
    seen = list_distinct(side)
    if len(seen) < 2 or extend < 1:
        return seen
    ahead = int(side[-1])
    middle = len(side) // 2
    sign = 1 if ahead > int(np.partition(side, middle)[middle]) else -1
    more = ahead + sign * np.arange(1, extend + 1)
    more = more[(more >= 0) & (more < len(region.arc))]
    more = more[region.arc[more] == region.arc[ahead]]
    return list_distinct(np.concatenate([seen, more]))


def list_distinct(numbers: Index) -> Index:
    """Return the different ones of some integers that lie close together, in order."""
    if not len(numbers):
        return numbers
    least = int(numbers.min())
    return np.asarray(np.bincount(numbers - least).nonzero()[0] + least)


def _is_firm(branch: Branch, region: Region, window: tuple[int, int]) -> Mask:
    """Tell for each point whether its walls are seen there, not only their ends."""
    part = slice(*window)
    left, right = branch.left[part], branch.right[part]
    firm = (left == OPEN) | (region.tip_distance.take(left) > 1)
    return np.asarray(firm & ((right == OPEN) | (region.tip_distance.take(right) > 1)))


def mean_heading(branch: Branch, place: int) -> float:
    """Return the mean heading outward at a point of a branch, weighted by distance.

    Source
    ------
    Beeson 2008, Algorithm 6.3: inner and outer neighbours within the Voronoi radius. A mean of
    headings weighted by distances is the direction of the sum of the steps.
    """
    step = branch.points_px - branch.points_px[place]
    near = np.hypot(*step.T) <= branch.radius_px[place]
    outer, inner = near.copy(), near.copy()
    outer[: place + 1], inner[place:] = False, False
    x, y = (step[outer].sum(axis=0) - step[inner].sum(axis=0)).tolist()
    if not (x or y):
        x, y = (branch.points_px[-1] - branch.points_px[0]).tolist()
    return math.atan2(y, x)
