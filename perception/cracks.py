"""Cracks: the edges between neighbouring cells of different faces, of which skeletons are made.

Each cell has a face, the wall arc nearest to it or an open space; the line that parts two faces
runs along the edges between their cells. Here the edges are found, with the point on each where
both walls are equally far, and followed from junction to junction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array
from perception.kernels import Kernels
from perception.region import Index, Region

OPEN = -1
"""Stands for the index of a wall cell on the side of a branch where there is no wall within M."""


@dataclass(frozen=True, eq=False)
class Field:
    """Nearest wall, distance and face of each cell in the window that holds a region.

    Attributes
    ----------
    left, top : column and row of the window's first cell.
    distance : (h, w) from each cell to the nearest wall cell, in cells.
    label : (h, w) number of the nearest wall cell in the distance transform.
    wall_of_label : (n,) index into ``Region.walls`` by that number.
    face : (h, w) face of each cell, 0 outside the region.
    first_open : faces from this number on are open spaces, those before it arcs of wall.
    level : distance from the walls at which the skeleton runs in open spaces, in cells.
    """

    left: int
    top: int
    distance: NDArray[np.float32]
    label: NDArray[np.int32]
    wall_of_label: NDArray[np.int32]
    face: NDArray[np.uint16] | NDArray[np.int32]
    first_open: int
    level: float


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges between neighbouring cells, each (n,).

    Attributes
    ----------
    x, y : first cell.
    is_down : whether the second cell lies below the first, or else to its right.
    wall_a, wall_b : index into ``Region.walls`` of the wall cell nearest to the first, the second.
    open_a, open_b : whether the first, the second is in an open space, farther than M from walls.
    """

    x: Index
    y: Index
    is_down: NDArray[np.bool_]
    wall_a: Index
    wall_b: Index
    open_a: NDArray[np.bool_]
    open_b: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Cracks:
    """Edges between two cells of different faces: corners they join, and what lies beside them.

    Attributes
    ----------
    corners : (n, 2) numbers of the corners of cells that each joins.
    points_px : (n, 2) where both walls are equally far.
    radius_px : (n,) distance from the walls there.
    left, right : (n,) wall cell on either side, looking from corner 0 to corner 1; OPEN for none.
    """

    corners: Index
    points_px: Array
    radius_px: Array
    left: Index
    right: Index


def measure_field(region: Region, midline_px: float, kernels: Kernels | None = None) -> Field:
    """Measure how far the walls of a region are, and which is nearest.

    Parameters
    ----------
    midline_px : M.
    kernels : compiled loops to do it with, if any.
    """
    left, top, width, height = cv2.boundingRect(region.inside.view(np.uint8))
    inside = region.inside[top : top + height, left : left + width]
    walls = region.walls - np.array([left, top])
    distance, label, wall_of_label = find_nearest_walls(walls, inside.shape)
    first_open = int(region.arc.max()) + 2
    level = midline_px - region.radius_px - 0.5
    kind = np.uint16 if first_open + inside.size // 9 < 2**16 else np.int32
    face_of_label = (region.arc + 1).astype(kind)[wall_of_label]
    if kernels is not None:
        face = kernels.spread_faces(face_of_label, label, inside)
    else:
        face = np.take(face_of_label, label, mode="clip")
        face *= inside
    _mark_open(face, inside, distance, level, first_open)
    return Field(left, top, distance, label, wall_of_label, face, first_open, level)


def find_nearest_walls(
    walls: Index, shape: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
    """Find for each cell of a grid how far the nearest wall cell is, and which it is.

    Parameters
    ----------
    walls : (n, 2) columns and rows of the wall cells.
    shape : (h, w) of the grid.

    Returns
    -------
    (h, w) distance in cells; (h, w) number of the nearest wall cell in the distance transform; and
    the index into ``walls`` by that number.
    """
    column, row = walls.T
    source = np.ones(shape, np.uint8)
    source[row, column] = 0
    found = cv2.distanceTransformWithLabels(source, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    distance, label = np.asarray(found[0], np.float32), np.asarray(found[1], np.int32)
    own = label[row, column]
    wall_of_label = np.zeros(int(own.max()) + 1, np.int32)
    wall_of_label[own] = np.arange(len(own))
    return distance, label, wall_of_label


def _mark_open(
    face: NDArray[Any],
    inside: NDArray[np.bool_],
    distance: NDArray[np.float32],
    level: float,
    first_open: int,
) -> None:
    """Give the spaces at least M from every wall faces of their own, where they are deep enough."""
    deep = distance >= np.float32(1.3 * level)
    deep &= inside
    if not deep.any():
        return
    wide = distance >= np.float32(level)
    wide &= inside
    spaces = np.asarray(cv2.connectedComponents(wide.view(np.uint8), connectivity=4)[1], np.int32)
    deep_ones = np.unique(spaces[deep & wide])
    number = np.zeros(int(spaces.max()) + 1, face.dtype)
    number[deep_ones] = first_open + np.arange(len(deep_ones))
    open_ = np.take(number, spaces, mode="clip")
    np.copyto(face, open_, where=open_ > 0)


def find_cracks(region: Region, field: Field, kernels: Kernels | None = None) -> Cracks:
    """Find the edges between neighbouring cells of two faces, and the sub-cell crossing there.

    Parameters
    ----------
    kernels : compiled loops to do it with, if any.
    """
    if kernels is not None:
        return _run_kernel(region, field, kernels)
    width = field.face.shape[1]
    right, down = _find_edges(field.face)
    first = np.concatenate([right, down])
    is_down = np.zeros(len(first), bool)
    is_down[len(right) :] = True
    second = first + np.where(is_down, width, 1)
    y, x = np.divmod(first, width)
    face, label = field.face.ravel(), field.label.ravel()
    edges = Edges(
        x + field.left,
        y + field.top,
        is_down,
        field.wall_of_label[label[first]].astype(np.int64),
        field.wall_of_label[label[second]].astype(np.int64),
        face[first] >= field.first_open,
        face[second] >= field.first_open,
    )
    open_share: float | Array = 0.5
    if edges.open_a.any() or edges.open_b.any():
        distance = field.distance.ravel()
        far_a, far_b = distance[first].astype(float), distance[second].astype(float)
        open_share = (field.level - far_a) / np.where(far_b == far_a, 1.0, far_b - far_a)
    return place_cracks(region, edges, open_share, region.radius_px + 0.5)


def place_cracks(
    region: Region, edges: Edges, open_share: float | Array, margin_px: float
) -> Cracks:
    """Find where along each edge's crossing the skeleton runs, and what lies on its sides.

    Parameters
    ----------
    open_share : where it runs between an open space and what is beside it, () or (n,), as a share
        of the way from the first cell to the second; two walls are equally far from it.
    margin_px : how far from the true walls the cells called walls reach.
    """
    x, y, is_down, open_a, open_b = edges.x, edges.y, edges.is_down, edges.open_a, edges.open_b
    wall_x, wall_y = region.walls.T
    ax, ay = x - wall_x[edges.wall_a], y - wall_y[edges.wall_a]
    bx, by = x - wall_x[edges.wall_b], y - wall_y[edges.wall_b]
    slope = 2 * np.where(is_down, ay - by, ax - bx)
    gap = bx * bx + by * by - ax * ax - ay * ay
    share = np.where(slope == 0, 0.5, gap / np.where(slope == 0, 1, slope))
    share = np.where(open_a | open_b, open_share, share)
    share = np.minimum(np.maximum(share, 0.0), 1.0)
    step_x, step_y = ~is_down + 0, is_down + 0
    px, py = x + share * step_x, y + share * step_y
    wall = np.where(open_a, edges.wall_b, edges.wall_a)
    dx, dy = px - wall_x[wall], py - wall_y[wall]
    side_a, side_b = np.where(open_a, OPEN, edges.wall_a), np.where(open_b, OPEN, edges.wall_b)
    columns = region.inside.shape[1] + 1
    corner = (y + step_y) * columns + x + step_x
    # looking down along an edge between left and right neighbours, the second lies on the left
    return Cracks(
        np.stack([corner, corner + np.where(is_down, 1, columns)], 1),
        np.stack([px, py], 1),
        np.sqrt(dx * dx + dy * dy) + margin_px,
        np.where(is_down, side_a, side_b),
        np.where(is_down, side_b, side_a),
    )


def _run_kernel(region: Region, field: Field, kernels: Kernels) -> Cracks:
    numbers, values = kernels.cross_faces(
        field.face,
        field.label,
        field.wall_of_label,
        field.distance,
        region.walls,
        field.left,
        field.top,
        field.first_open,
        field.level,
        region.radius_px + 0.5,
        region.inside.shape[1] + 1,
    )
    return Cracks(numbers[:, :2], values[:, :2], values[:, 2], numbers[:, 2], numbers[:, 3])


def _find_edges(face: NDArray[Any]) -> tuple[Index, Index]:
    """Return the flat indices of cells whose right neighbour, or lower one, has another face."""
    inside = face > 0
    right = np.zeros(face.shape, bool)
    np.not_equal(face[:, :-1], face[:, 1:], out=right[:, :-1])
    right[:, :-1] &= inside[:, :-1]
    right[:, :-1] &= inside[:, 1:]
    down = np.not_equal(face[:-1], face[1:])
    down &= inside[:-1]
    down &= inside[1:]
    return np.flatnonzero(right), np.flatnonzero(down)


def link_cracks(corners: Index) -> tuple[Index, Index]:
    """Tell where the ends of cracks meet.

    Parameters
    ----------
    corners : (n, 2) corners that each crack joins; its ends have the numbers 2 k and 2 k + 1.

    Returns
    -------
    For each end, the end of the other crack it meets, -1 at a node; and its node, -1 where exactly
    two meet.
    """
    ends = corners.ravel()
    order = np.argsort(ends, kind="stable")
    place = ends[order]
    same = np.zeros(len(ends) + 1, bool)
    same[1:-1] = place[1:] == place[:-1]
    pair = np.flatnonzero(same[1:-1] & ~same[:-2] & ~same[2:])
    beyond, node = np.full(len(ends), -1, np.int64), ends.copy()
    one, two = order[pair], order[pair + 1]
    beyond[one], beyond[two] = two, one
    node[one] = node[two] = -1
    return beyond, node


def walk_chains(following: list[int], nodes: list[int]) -> Iterator[tuple[Index, int, int]]:
    """Follow cracks from node to node, then round what is left over.

    Parameters
    ----------
    following : for each end of a crack (2 k and 2 k + 1), the end of another crack it meets; -1 at
        a node.
    nodes : for each end, its node; -1 if it is not at one.

    Yields
    ------
    (ends at which the cracks are entered, first end, last end) of each chain; a ring has no nodes.
    """
    seen = bytearray(len(nodes) // 2)
    starts = [k for k, node in enumerate(nodes) if node >= 0]
    for start in [*starts, *range(0, len(nodes), 2)]:
        if seen[start >> 1]:
            continue
        path, end = list[int](), start
        while True:
            path.append(end)
            seen[end >> 1] = 1
            last = end ^ 1
            end = following[last]
            if end < 0 or end >> 1 == start >> 1:
                break
        yield np.array(path), start, last
