"""Looking along straight lines through the free cells of a grid."""

from __future__ import annotations

import numpy as np

from perception.geometry import Array
from perception.grid import Mask
from perception.region import Index


def look_along(starts_px: Array, headings_rad: Array, free: Mask) -> tuple[Index, Index, Mask]:
    """Return the cells along looks out of some points, and which of them are free.

    Parameters
    ----------
    starts_px : (n, 2) columns and rows. headings_rad : (n, k) or (k,) where to look from each,
        atan2(dy, dx) in pixel axes.
    free : (H, W) mask of the free cells.

    Returns
    -------
    Columns, rows and whether they are free, each (n, k, steps), one step a cell; off the grid all
    is free.

    Source
    ------
    Ours.

    Examples
    --------
    >>> free = np.zeros((3, 6), bool)
    >>> free[1, :4] = True
    >>> measure_looks(look_along(np.array([[1.0, 1.0]]), np.array([0.0, np.pi]), free)[2])
    array([[3., 6.]])
    """
    headings = np.broadcast_to(headings_rad, (len(starts_px), np.shape(headings_rad)[-1]))
    ahead = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    steps = np.arange(0.0, float(max(free.shape)))
    points = starts_px[:, None, None] + steps[:, None] * ahead[:, :, None]
    x, y = np.rint(points).astype(np.int64).transpose(3, 0, 1, 2)
    height, width = free.shape
    off = (x < 0) | (y < 0) | (x >= width) | (y >= height)
    on = off | free[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    return x, y, on


def measure_looks(on: Mask) -> Array:
    """Return how many steps each look (..., steps) goes on before the first cell that is not free.

    Source
    ------
    Ours.
    """
    return np.asarray(np.where(on.all(axis=-1), on.shape[-1], np.argmin(on, axis=-1)), float)
