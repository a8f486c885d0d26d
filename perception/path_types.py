"""Path types: by which control law a directed local-path is followed, or why it ends.

Beeson 2008 names five (5.2.2, footnote, and chapter 10) and leaves them to be built; the control
laws are those of Kuipers & Byun 1991, 4.3: follow the midline, move along an object on the left or
on the right. Defined here, all "ours":

* ``MIDLINE``: leaving through the gateway, there is a wall within M on both sides.
* ``LEFTWALL``, ``RIGHTWALL``: there is one on the left (right) only, looking away from the place.
* ``DEADEND``: whoever goes straight on into the place from the other side meets a wall before any
  other gateway, and near the place: further travel is blocked.
* ``NONE``: straight on lies another gateway, a frontier, or open space without a wall in reach:
  nothing blocks, but no control law applies.

Where the evidence is mixed the type is not told (an empty text), since two visits that tell
different types of one place contradict each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from perception.cracks import OPEN
from perception.geometry import Array
from perception.region import Region
from perception.skeleton import Branch

if TYPE_CHECKING:
    from perception.gateways import Gateway

PATH_TYPES = ("MIDLINE", "LEFTWALL", "RIGHTWALL", "DEADEND", "NONE")
"""The types; the first three go with alpha 1, the others with alpha 0."""

_STEADY = 0.8
_LOOK_RADII = 2.0
_SPREAD_RAD = math.radians(8.0)
_IN_REACH = 1.3


def tell_path_type(branch: Branch, place: int) -> str:
    """Return the type of the path along a branch, from a point of it outward; "" if mixed.

    Parameters
    ----------
    branch : outward. place : index of the point where the path begins.
    """
    _, last = branch.within(place, _LOOK_RADII * float(branch.radius_px[place]))
    left, right = branch.left[place:last] != OPEN, branch.right[place:last] != OPEN
    size = last - place
    both = np.count_nonzero(left & right)
    counts = {
        "MIDLINE": both,
        "LEFTWALL": np.count_nonzero(left) - both,
        "RIGHTWALL": np.count_nonzero(right) - both,
    }
    best = max(counts, key=lambda name: counts[name])
    return best if counts[best] >= _STEADY * size else ""


def tell_end_types(
    gateways: Sequence[Gateway],
    base_px: Array,
    region: Region,
    midline_px: float,
    wanted: Sequence[int] | None = None,
) -> tuple[str, ...]:
    """Return for each gateway what lies straight on behind the place: DEADEND, NONE, "" if mixed.

    Parameters
    ----------
    gateways : of one place. base_px : (k, 2) its base points.
    midline_px : M; a wall further than 1.3 M from the place is out of reach.
    wanted : indices of those that it is to be told of, all by default; "" for the others.
    """
    wanted = range(len(gateways)) if wanted is None else wanted
    found = [""] * len(gateways)
    if not wanted:
        return tuple(found)
    height, width = region.inside.shape
    centre = np.array([gateways[k].centre_px for k in wanted])
    outward = np.array([gateways[k].outward_rad for k in wanted])
    heading = (outward[:, None] + math.pi + _SPREAD_RAD * np.array([-1.0, 0.0, 1.0])).ravel()
    reach = _IN_REACH * midline_px
    span = float(np.hypot(*(centre[:, None] - base_px[None]).transpose(2, 0, 1)).min(axis=1).max())
    step = np.arange(0.0, span + 2.0 * reach, 0.8)
    start = np.repeat(centre, 3, axis=0)
    column = np.rint(start[:, :1] + np.cos(heading)[:, None] * step).astype(np.int64)
    row = np.rint(start[:, 1:] + np.sin(heading)[:, None] * step).astype(np.int64)
    outside = (column < 0) | (row < 0) | (column >= width) | (row >= height)
    np.clip(column, 0, width - 1, out=column)
    np.clip(row, 0, height - 1, out=row)
    stops = ~region.inside[row, column] | outside
    last = np.where(stops.any(axis=1), stops.argmax(axis=1) - 1, -2)
    for place, k in enumerate(wanted):
        kinds = set()
        for ray in range(3 * place, 3 * place + 3):
            i = int(last[ray])
            if i < 0:  # starts in a wall, or meets none
                kinds.add("" if i == -1 else "NONE")
                continue
            cell = int(column[ray, i]), int(row[ray, i])
            way = float(heading[ray]), float(step[i])
            kinds.add(_judge(k, gateways, way, cell, base_px, region, reach))
        if len(kinds) == 1:
            found[k] = kinds.pop()
    return tuple(found)


def _judge(
    k: int,
    gateways: Sequence[Gateway],
    way: tuple[float, float],
    cell: tuple[int, int],
    base_px: Array,
    region: Region,
    reach_px: float,
) -> str:
    """Return what a ray from a gateway, of some heading and length, ends at."""
    c, r = cell
    if region.exit_of_cell[max(r - 2, 0) : r + 3, max(c - 2, 0) : c + 3].any():
        return "NONE"
    if any(
        _crosses(other, gateways[k].centre_px, way) for j, other in enumerate(gateways) if j != k
    ):
        return "NONE"
    near = any(math.hypot(x - c, y - r) <= reach_px for x, y in base_px.tolist())
    return "DEADEND" if near else "NONE"


def _crosses(gateway: Gateway, start: tuple[float, float], way: tuple[float, float]) -> bool:
    """Tell whether a ray of some heading and length passes through a gateway."""
    heading, length = way
    dx, dy = math.cos(heading), math.sin(heading)
    (ax, ay), (bx, by) = gateway.ends_px
    ex, ey = bx - ax, by - ay
    across = dx * ey - dy * ex
    if abs(across) < 1e-9:
        return False
    ox, oy = ax - start[0], ay - start[1]
    at, along = (ox * ey - oy * ex) / across, (ox * dy - oy * dx) / across
    return 0 < at <= length and 0 <= along <= 1
