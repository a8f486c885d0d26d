"""The inner loops of the skeleton, written out cell by cell, for numba to compile.

The array form in :mod:`perception.cracks` is what runs without the extra ``fast``; both give the
same numbers to the last bit (tested), so nothing but time depends on which one runs.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

WORTH_IT = 300
"""After so many grids in one process, loading the compiled loops has paid for itself."""


def spread_faces(face_of_label: Ints, label: NDArray[np.int32], inside: NDArray[np.bool_]) -> Ints:
    """Give each cell inside a region the face of its label, others 0; see ``cracks.measure_field``.

    Parameters
    ----------
    face_of_label : (n,) by label. label, inside : (h, w).
    """
    height, width = label.shape
    face = np.empty((height, width), face_of_label.dtype)
    for y in range(height):
        for x in range(width):
            face[y, x] = face_of_label[label[y, x]] * inside[y, x]
    return face


def cross_faces(
    face: NDArray[Any],
    label: NDArray[np.int32],
    wall_of_label: NDArray[np.int32],
    distance: NDArray[np.float32],
    walls: Ints,
    left: int,
    top: int,
    first_open: int,
    level: float,
    grown: float,
    columns: int,
) -> tuple[Ints, Floats]:
    """Find the edges between neighbouring cells of two faces; see ``cracks.find_cracks``.

    Returns
    -------
    (n, 4) integers: two corners, the wall on the left and on the right (-1: open); and (n, 3)
    floats: x, y, radius.
    """
    height, width = face.shape
    count = 0
    for y in range(height):
        for x in range(width):
            own = face[y, x]
            if own > 0:
                if x + 1 < width and face[y, x + 1] > 0 and face[y, x + 1] != own:
                    count += 1
                if y + 1 < height and face[y + 1, x] > 0 and face[y + 1, x] != own:
                    count += 1
    numbers = np.empty((count, 4), np.int64)
    values = np.empty((count, 3), np.float64)
    k = 0
    for down in range(2):
        for y in range(height - down):
            for x in range(width - 1 + down):
                by, bx = y + down, x + 1 - down
                own, other = face[y, x], face[by, bx]
                if own == other or own == 0 or other == 0:
                    continue
                wall_a, wall_b = wall_of_label[label[y, x]], wall_of_label[label[by, bx]]
                gx, gy = x + left, y + top
                ax, ay = gx - walls[wall_a, 0], gy - walls[wall_a, 1]
                cx, cy = gx - walls[wall_b, 0], gy - walls[wall_b, 1]
                slope = 2 * (ay - cy) if down else 2 * (ax - cx)
                gap = cx * cx + cy * cy - ax * ax - ay * ay
                open_a, open_b = own >= first_open, other >= first_open
                share = 0.5
                if slope != 0:
                    share = gap / slope
                if open_a or open_b:
                    far_a, far_b = np.float64(distance[y, x]), np.float64(distance[by, bx])
                    span = 1.0 if far_a == far_b else far_b - far_a
                    share = (level - far_a) / span
                share = min(max(share, 0.0), 1.0)
                px, py = gx + share * (1 - down), gy + share * down
                wall = wall_b if open_a else wall_a
                dx, dy = px - walls[wall, 0], py - walls[wall, 1]
                values[k, 0], values[k, 1] = px, py
                values[k, 2] = np.sqrt(dx * dx + dy * dy) + grown
                corner = (gy + down) * columns + gx + 1 - down
                numbers[k, 0], numbers[k, 1] = corner, corner + (1 if down else columns)
                side_a, side_b = -1 if open_a else wall_a, -1 if open_b else wall_b
                numbers[k, 2] = side_a if down else side_b
                numbers[k, 3] = side_b if down else side_a
                k += 1
    return numbers, values


def follow_chains(beyond: Ints, node: Ints) -> tuple[Ints, Ints]:
    """Follow cracks from node to node, then round what is left; see ``cracks.walk_chains``.

    Returns
    -------
    The ends by which cracks are entered, chain after chain, and where each chain begins in them.
    """
    size = len(node)
    seen = np.zeros(size // 2, np.bool_)
    path = np.empty(size // 2, np.int64)
    first = np.empty(size // 2 + 1, np.int64)
    filled, chains = 0, 0
    for turn in range(2):
        for start in range(0, size, turn + 1):
            if (turn == 0 and node[start] < 0) or seen[start >> 1]:
                continue
            first[chains] = filled
            chains += 1
            end = start
            while True:
                path[filled] = end
                filled += 1
                seen[end >> 1] = True
                end = beyond[end ^ 1]
                if end < 0 or end >> 1 == start >> 1:
                    break
    first[chains] = filled
    return path[:filled], first[: chains + 1]


class Kernels:
    """The loops, compiled.

    Attributes
    ----------
    spread_faces, cross_faces, follow_chains : the functions above.
    """

    def __init__(self) -> None:
        import numba

        compile_ = numba.njit(cache=True)
        self.spread_faces: Any = compile_(spread_faces)
        self.cross_faces: Any = compile_(cross_faces)
        self.follow_chains: Any = compile_(follow_chains)


class _Choice:
    """Whether compiled loops are used, and how many grids were seen without them."""

    wanted: bool | None = None
    seen: int = 0
    loaded: Kernels | None = None


def has_numba() -> bool:
    """Tell whether the extra ``fast`` is installed."""
    return importlib.util.find_spec("numba") is not None


def use_numba(wanted: bool | None) -> None:
    """Use compiled loops from now on, or never; None: once enough grids make it worth loading them.

    Raises
    ------
    InputError : they are wanted, but numba is not installed.
    """
    if wanted and not has_numba():
        raise InputError("numba is not installed; install the extra: pip install 'hssh[fast]'")
    _Choice.wanted = wanted


def get_kernels() -> Kernels | None:
    """Return the compiled loops if they are to be used for the next grid."""
    _Choice.seen += 1
    wanted = _Choice.wanted
    if wanted is None:
        wanted = _Choice.seen > WORTH_IT and has_numba()
        if _Choice.seen > WORTH_IT:
            _Choice.wanted = wanted
    if not wanted:
        return None
    if _Choice.loaded is None:
        _Choice.loaded = Kernels()
    return _Choice.loaded
