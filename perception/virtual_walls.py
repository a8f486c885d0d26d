"""Obstacles on either side of a skeleton, real ones and virtual ones in open spaces.

Where a skeleton follows a wall at the distance M there is nothing on its other side, and at a
concave corner nothing that could anchor a gateway. Beeson 2008, 6.3.2, takes all free cells out of
reach of the skeleton for obstacles there. Testing each cell against each point cost its author
four times the rest; here the reach is painted, disc by disc, and only its outline is looked at,
and only if a side that is searched for anchors is open.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from perception.cracks import OPEN
from perception.grid import Mask
from perception.region import Index, Region
from perception.skeleton import Branch

_TANGENT = 4
_SAG_PX = 0.4
"""How far the outline of the painted discs may lie inside that of all discs."""


@dataclass(frozen=True, eq=False)
class Sides:
    """The nearest obstacles on the left and on the right of the points of a branch.

    Attributes
    ----------
    left, right : (n,) index into ``cells``; OPEN where there is none.
    cells : (m, 2) columns and rows of the obstacles: the walls of the region, then virtual ones.
    arc : (m,) which stretch of wall each belongs to; neighbours on one are neighbours here.
    real : how many of the cells are walls; the others are virtual.
    """

    left: Index
    right: Index
    cells: Index
    arc: Index
    real: int


@dataclass(frozen=True, eq=False)
class VirtualWalls:
    """The outline of the reach of a skeleton.

    Attributes
    ----------
    cells : (m, 2) columns and rows, outline after outline.
    arc : (m,) number of the outline.
    usable : (m,) which have free space out of reach beside them.
    """

    cells: Index
    arc: Index
    usable: Mask


def see_walls(branch: Branch, region: Region) -> Sides:
    """Return the real obstacles beside a branch."""
    return Sides(branch.left, branch.right, region.walls, region.arc, len(region.walls))


def outline_reach(branches: Iterable[Branch], region: Region) -> VirtualWalls:
    """Find the outline of all that lies within the Voronoi radius of some skeleton point.

    Source
    ------
    Beeson 2008, 6.3.2, of which this is a cheaper form.
    """
    reach = np.zeros(region.inside.shape, np.uint8)
    for branch in branches:
        every = max(int(math.sqrt(8.0 * _SAG_PX * float(branch.radius_px.min()))), 1)
        points = np.round(branch.points_px[::every]).astype(int).tolist()
        radii = np.ceil(branch.radius_px[::every]).astype(int).tolist()
        for (x, y), radius in zip(points, radii, strict=True):
            cv2.circle(reach, (x, y), radius, 1, cv2.FILLED)
    reach &= region.inside.view(np.uint8)
    beyond = (region.inside & (reach == 0)).view(np.uint8)
    near = cv2.dilate(beyond, np.ones((3, 3), np.uint8))
    outlines = cv2.findContours(reach, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)[0]
    parts = [np.asarray(outline, np.int64).reshape(-1, 2) for outline in outlines]
    cells = np.concatenate([*parts, np.zeros((0, 2), np.int64)])
    arc = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return VirtualWalls(cells, arc, near[cells[:, 1], cells[:, 0]] > 0)


def see_virtual_walls(
    branch: Branch, region: Region, virtual: VirtualWalls, area: tuple[int, int]
) -> Sides:
    """Return the obstacles beside a branch, virtual ones where a side is open.

    Parameters
    ----------
    area : [first, last) of the points that matter; elsewhere open sides stay open.
    """
    first, last = area
    left, right = branch.left.copy(), branch.right.copy()
    usable = np.flatnonzero(virtual.usable)
    centre = branch.points_px[(first + last) // 2]
    far = 3.0 * float(branch.radius_px[first:last].max())
    offset = virtual.cells[usable] - centre
    usable = usable[np.abs(offset).max(axis=1) <= far]
    if len(usable):
        for side, sign in ((left, -1.0), (right, 1.0)):
            points = np.flatnonzero(side[first:last] == OPEN) + first
            if len(points):
                found = _find_nearest(branch, points, virtual.cells[usable], sign)
                near = found != OPEN
                side[points[near]] = len(region.walls) + usable[found[near]]
    arc = virtual.arc + int(region.arc.max(initial=0)) + 1
    return Sides(
        left,
        right,
        np.concatenate([region.walls, virtual.cells]),
        np.concatenate([region.arc, arc]),
        len(region.walls),
    )


def _find_nearest(branch: Branch, points: Index, cells: Index, sign: float) -> Index:
    """Return which of some cells is nearest on one side of each point; OPEN for none."""
    size = len(branch.points_px)
    ahead, behind = np.minimum(points + _TANGENT, size - 1), np.maximum(points - _TANGENT, 0)
    tangent = (branch.points_px[ahead] - branch.points_px[behind]).astype(np.float32)
    place, obstacle = branch.points_px[points].astype(np.float32), cells.astype(np.float32)
    gap_x = obstacle[:, 0] - place[:, :1]
    gap_y = obstacle[:, 1] - place[:, 1:]
    wrong_side = sign * (tangent[:, :1] * gap_y - tangent[:, 1:] * gap_x) <= 0
    gap_x *= gap_x
    gap_y *= gap_y
    gap_x += gap_y
    gap_x[wrong_side] = np.inf
    best = gap_x.argmin(axis=1)
    return np.where(np.isfinite(gap_x[np.arange(len(points)), best]), best, OPEN)


def is_open(branch: Branch, area: tuple[int, int]) -> bool:
    """Tell whether a side of a branch is open somewhere in an area [first, last)."""
    part = slice(*area)
    return bool((branch.left[part] == OPEN).any() or (branch.right[part] == OPEN).any())
