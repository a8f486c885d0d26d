"""The space a robot can pass in a grid, its walls as arcs, and its exits.

The contour of the passable region falls into stretches of wall and stretches of frontier
(unknown cells or the border of the grid). A frontier wide enough is an *exit*; exits cut the
contour into *wall arcs*. Everything above works on these arcs: the skeleton that joins the exits
is where the nearest wall changes from one arc to another.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array
from perception.grid import Cells, Mask

Index = NDArray[np.int64]
_FULL = np.ones((3, 3), np.uint8)
_DEEP_SHARE = 12.0


@dataclass(frozen=True, eq=False)
class Exit:
    """A stretch of frontier through which the region may be left.

    Attributes
    ----------
    centre_px : (x, y) of the middle of the stretch.
    width_px : its width between the walls, the robot's own radius given back on both sides.
    cells : (n, 2) columns and rows of its cells, in order.
    at_border : whether it touches the border of the grid.
    """

    centre_px: tuple[float, float]
    width_px: float
    cells: Index
    at_border: bool


@dataclass(frozen=True, eq=False)
class Region:
    """The passable cells joined to the robot, and their walls.

    Attributes
    ----------
    inside : (H, W) mask of the cells.
    start : (column, row) of the cell of the region that stands for the robot.
    walls : (n, 2) columns and rows of the wall cells of the contour, in contour order.
    arc : (n,) which wall arc each belongs to, from 0; neighbours on an arc are neighbours here.
    tip_distance : (n,) cells along the contour to the nearest end of the arc.
    exits : the exits, by index.
    exit_of_cell : (H, W) int32, index of the exit + 1 on frontier cells of the contour, else 0.
    radius_px : how far the walls were grown before the contour was taken.
    seen : (H, W) mask of the cells one sees through, if exits lead as far as one sees; else None.
    """

    inside: Mask
    start: tuple[int, int]
    walls: Index
    arc: Index
    tip_distance: Index
    exits: tuple[Exit, ...]
    exit_of_cell: NDArray[np.int32]
    radius_px: float
    seen: Mask | None = None


def find_region(
    cells: Cells,
    robot_px: tuple[float, float],
    *,
    radius_px: float,
    min_frontier_px: float,
    island_px: float,
    way_px: Array | None = None,
    by_sight: bool = False,
) -> Region:
    """Find the region a robot can pass, from where it stands.

    Parameters
    ----------
    cells : the grid; see :func:`perception.grid.classify`.
    robot_px : (column, row) of the robot.
    radius_px : obstacles are grown by it.
    min_frontier_px : frontiers narrower than this are walls; so is unknown space that a square of
        this side does not fit into, which is filled as free.
    island_px : groups of cells that are not free, do not touch the border and are smaller than
        this in both directions become free.
    way_px : (n, 2) columns and rows the robot drove by, in order, if it did: where it has been it
        can pass, however narrow that looks.
    by_sight : exits shall lead as far as one sees through them, not as far as the robot can pass.

    Raises
    ------
    InputError : the robot is outside the grid or deep in a wall, or no passable cell is near it.

    Source
    ------
    Beeson 2008, 6.1.1: islands, bleeding, exits; the arcs are ours.
    """
    occupied, unknown = _clean(cells, radius_px, min_frontier_px, island_px)
    inside, start = _reach(occupied, unknown, radius_px, robot_px, way_px)
    bled = max(radius_px - 1.0, 0.0)
    near_wall = _touches(occupied, 2 * round(bled) + 3)
    frontier = _touches(unknown, 5, border=True) & ~near_wall
    contours = _find_contours(inside, island_px)
    region = _cut_contours(contours, inside, start, frontier, bled, min_frontier_px)
    return replace(region, seen=cells.free) if by_sight else region


def close_exits(region: Region, numbers: list[int]) -> Region:
    """Return the region with some of its exits taken for walls."""
    frontier = region.exit_of_cell > 0
    for number in numbers:
        cells = region.exits[number].cells
        frontier[cells[:, 1], cells[:, 0]] = False
    contours = _find_contours(region.inside, 0.0)
    closed = _cut_contours(contours, region.inside, region.start, frontier, region.radius_px, 0.0)
    return replace(closed, seen=region.seen)


def _clean(
    cells: Cells, radius_px: float, min_frontier_px: float, island_px: float
) -> tuple[Mask, Mask]:
    """Return the occupied and the unknown cells without slivers and islands."""
    occupied, unknown = cells.occupied, cells.unknown
    side = (round(min_frontier_px) - 1) // 2 * 2 + 1  # odd: an even opening would shift
    if side > 1 and unknown.any():
        padded = cv2.copyMakeBorder(
            unknown.view(np.uint8), side, side, side, side, cv2.BORDER_CONSTANT, value=1
        )
        opened = cv2.morphologyEx(padded, cv2.MORPH_OPEN, np.ones((side, side), np.uint8))
        unknown = opened[side:-side, side:-side].astype(bool)
    solid = (occupied | unknown).view(np.uint8)
    join = max(1, round(radius_px / 2)) if _stands_free(occupied, unknown) else 1
    islands = _find_islands(_grow(solid, 2 * join + 1), island_px + 2 * join)
    if islands is not None:
        occupied, unknown = occupied & ~islands, unknown & ~islands
    return occupied, unknown


def _find_islands(solid: NDArray[np.uint8], most_px: float) -> Mask | None:
    """Return the groups of set cells off the border that are smaller than that both ways."""
    found, hierarchy = cv2.findContours(solid, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    if not found:
        return None
    height, width = solid.shape
    islands = []
    for contour, link in zip(found, hierarchy[0].tolist(), strict=True):
        if link[3] >= 0:
            continue
        x, y, w, h = cv2.boundingRect(contour)
        inner = x > 0 and y > 0 and x + w < width and y + h < height
        if inner and max(w, h) < most_px:
            islands.append(contour)
    if not islands:
        return None
    mask = np.zeros(solid.shape, np.uint8)
    cv2.drawContours(mask, islands, -1, 1, cv2.FILLED)
    return mask.view(bool)


def _stands_free(occupied: Mask, unknown: Mask) -> bool:
    """Tell whether the walls have free space on both sides, so that only wall joins wall.

    Then pieces of wall closer together than the robot are one obstacle. Where unknown space lies
    behind the walls it joins their pieces, and what is left near them is dirt.
    """
    count = np.count_nonzero(occupied)
    if not unknown.any():
        return bool(count > 0)
    backed = occupied & _grow(unknown.view(np.uint8), 3).view(bool)
    return bool(np.count_nonzero(backed) < 0.2 * count)


def _reach(
    occupied: Mask,
    unknown: Mask,
    radius_px: float,
    robot_px: tuple[float, float],
    way_px: Array | None,
) -> tuple[Mask, tuple[int, int]]:
    """Return the cells joined to the robot by a way its body fits, and its cell there.

    A way is a chain of cells whose neighbours are all passable; the neighbours belong to the
    region too, so that its two walls are never one.
    """
    wide = np.asarray(cv2.erode((~(occupied | unknown)).view(np.uint8), _FULL), np.uint8)
    if radius_px > 1.5:
        distance = cv2.distanceTransform((~occupied).view(np.uint8), cv2.DIST_L2, 5)
        wide[np.asarray(distance < radius_px)] = 0
    if way_px is not None and len(way_px) > 1:
        way = np.zeros_like(wide)
        corners = np.rint(way_px).astype(np.int32)
        cv2.polylines(way, [corners], isClosed=False, color=1, lineType=cv2.LINE_4)
        wide[(way > 0) & ~unknown] = 1
    start = _stand(wide, occupied, robot_px, radius_px)
    cv2.floodFill(wide, None, start, 2, flags=4)
    return _grow((wide == 2).view(np.uint8), 3).view(bool), start


def _stand(
    wide: NDArray[np.uint8], occupied: Mask, robot_px: tuple[float, float], radius_px: float
) -> tuple[int, int]:
    """Return the passable cell nearest to the robot that no wall hides from it.

    Somebody beside the robot may make its place look occupied; it is not deep in a wall, though.
    """
    height, width = wide.shape
    column, row = float(robot_px[0]), float(robot_px[1])
    if not (-0.5 <= column <= width - 0.5 and -0.5 <= row <= height - 0.5):
        raise InputError(
            f"the robot at column {robot_px[0]:g}, row {robot_px[1]:g} is outside the image of "
            f"{width} x {height} cells; give a place inside it"
        )
    x, y = min(max(round(column), 0), width - 1), min(max(round(row), 0), height - 1)
    if wide[y, x]:
        return x, y
    rows, columns = np.nonzero(wide)
    order = np.argsort((rows - y) ** 2 + (columns - x) ** 2)[:400]
    own = int(occupied[y, x])
    deepest = max(2.0 * radius_px, min(width, height) / _DEEP_SHARE)
    for k in order:
        target = int(columns[k]), int(rows[k])
        deep = math.hypot(target[0] - x, target[1] - y)
        if own and deep > deepest:
            raise InputError(
                f"the robot at column {x}, row {y} stands in a wall, {deep:.0f} cells from free "
                "space; give a place that is free"
            )
        steps = max(abs(target[0] - x), abs(target[1] - y)) + 1
        line_x = np.linspace(x, target[0], steps).round().astype(int)
        line_y = np.linspace(y, target[1], steps).round().astype(int)
        if np.count_nonzero(np.diff(occupied[line_y, line_x].astype(np.int8)) > 0) == 0 and (
            not own or not occupied[line_y[-1], line_x[-1]]
        ):
            return target
    raise InputError(
        f"the robot at column {x}, row {y} stands in no free space wide enough for it; "
        "give another place, or a smaller robot radius"
    )


def _grow(mask: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """Return the cells within a square of the given odd side about set cells."""
    return np.asarray(cv2.dilate(mask, np.ones((side, side), np.uint8)), np.uint8)


def _touches(mask: Mask, side: int, *, border: bool = False) -> Mask:
    """Return the cells near the mask, within a disc (or at the border of the grid)."""
    shape = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)) if side > 3 else _FULL
    near = np.asarray(cv2.dilate(mask.view(np.uint8), shape), np.uint8).view(bool)
    if border:
        near[0], near[-1], near[:, 0], near[:, -1] = True, True, True, True
    return near


def _find_contours(inside: Mask, island_px: float) -> list[Index]:
    """Return the contours of the region, each (n, 2); fill holes that are islands after all."""
    found, hierarchy = cv2.findContours(
        inside.view(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    contours = []
    for k, contour in enumerate(found):
        points = np.asarray(contour, np.int64).reshape(-1, 2)
        if hierarchy[0][k][3] >= 0 and np.ptp(points, axis=0).max() - 1 < island_px:
            cv2.drawContours(inside.view(np.uint8), found, k, 1, cv2.FILLED)
        else:
            contours.append(points)
    return contours


def _cut_contours(
    contours: list[Index],
    inside: Mask,
    start: tuple[int, int],
    frontier: Mask,
    radius_px: float,
    min_frontier_px: float,
) -> Region:
    """Cut the contours of the region at its frontiers into wall arcs and exits."""
    exit_of_cell = np.zeros(inside.shape, np.int32)
    walls: list[Index] = []
    arcs: list[Index] = []
    tips: list[Index] = []
    exits: list[Exit] = []
    arc_count = 0
    for points in contours:
        open_ = frontier[points[:, 1], points[:, 0]]
        cells, open_ = _settle_runs(points, open_, radius_px, min_frontier_px)
        for first, last in _runs(open_):
            run = cells[first:last]
            if open_[first]:
                exits.append(_as_exit(run, radius_px, inside.shape))
                exit_of_cell[run[:, 1], run[:, 0]] = len(exits)
                continue
            lone = open_.any() and len(_runs(open_)) == 2
            for part in np.array_split(run, 2) if lone and len(run) > 1 else [run]:
                walls.append(part)
                arcs.append(np.full(len(part), arc_count))
                position = np.arange(len(part))
                end = np.minimum(position, position[::-1])
                tips.append(end if open_.any() else np.full(len(part), len(part)))
                arc_count += 1
    empty: list[Index] = [np.zeros(0, np.int64)]
    return Region(
        inside,
        start,
        np.concatenate(walls or [np.zeros((0, 2), np.int64)]),
        np.concatenate(arcs or empty),
        np.concatenate(tips or empty),
        tuple(exits),
        exit_of_cell,
        radius_px,
    )


def _runs(flags: Mask) -> list[tuple[int, int]]:
    """Return [first, last) of each stretch of equal flags."""
    if not len(flags):
        return []
    cuts = np.flatnonzero(flags[1:] != flags[:-1]) + 1
    bounds = [0, *cuts.tolist(), len(flags)]
    return list(itertools.pairwise(bounds))


def _settle_runs(
    points: Index, open_: Mask, radius_px: float, min_frontier_px: float
) -> tuple[Index, Mask]:
    """Turn specks of wall in a frontier into frontier, and narrow frontiers into wall.

    The points are rotated so that no stretch runs over the end of the list.
    """
    speck = 2 * radius_px + max(2.0, 0.3 * min_frontier_px)
    points, open_ = _rotate(points, open_)
    for wall_first in (True, False):
        if open_.all() or not open_.any():
            break
        changed = False
        for first, last in _runs(open_):
            if open_[first] == wall_first:
                continue
            extent = _extent(points[first:last])
            if wall_first:
                flip = extent < speck and last - first < 2 * speck + 4
            else:
                width = max(extent, 0.5 * (last - first)) + 2 * radius_px + 2
                flip = width < max(min_frontier_px, 5.0)  # narrower: steps of a slanting wall
            if flip:
                open_[first:last] = wall_first
                changed = True
        if changed:
            points, open_ = _rotate(points, open_)
    return points, open_


def _rotate(points: Index, open_: Mask) -> tuple[Index, Mask]:
    """Return both lists, copied, so that no stretch of equal flags runs over their end."""
    turn = 0
    if len(open_) and open_[0] == open_[-1]:
        turns = np.flatnonzero(open_[1:] != open_[:-1])
        turn = int(turns[0]) + 1 if len(turns) else 0
    return (
        np.concatenate([points[turn:], points[:turn]]),
        np.concatenate([open_[turn:], open_[:turn]]),
    )


def _extent(points: Index) -> float:
    """Return the distance between the ends of a stretch, ends included."""
    (ax, ay), (bx, by) = points[0].tolist(), points[-1].tolist()
    return math.hypot(bx - ax, by - ay) + 1.0


def _as_exit(run: Index, radius_px: float, shape: tuple[int, int]) -> Exit:
    middle = run[len(run) // 2].astype(float)
    at_border = bool((run == 0).any() or (run == np.array(shape)[::-1] - 1).any())
    width = _extent(run) + 2 * radius_px + 2
    return Exit((float(middle[0]), float(middle[1])), width, run, at_border)
