"""Grids as grey images: what a cell may be, and how grey levels are read.

Every grid in this package is an image as one sees it: row 0 at the top, columns to the right,
occupied dark, free light, unknown in between. A :class:`Frame` carries pixels to metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Grey levels written, those of ROS map files."""

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Cells:
    """The three kinds of cells of a grid, as (H, W) masks that cover it without overlap."""

    occupied: Mask
    free: Mask
    unknown: Mask


def classify(image: Image, *, occupied_below: int = 89, free_above: int = 205) -> Cells:
    """Read a grey image as occupied, free and unknown cells.

    Parameters
    ----------
    image : (H, W) uint8; dark occupied, light free.
    occupied_below, free_above : grey levels; the defaults are ROS map_server's 0.65 and 0.196.

    Examples
    --------
    >>> classify(np.array([[0, 127, 205, 255]], np.uint8)).unknown.tolist()
    [[False, True, True, False]]
    """
    occupied = image < occupied_below
    free = image > free_above
    return Cells(occupied, free, ~(occupied | free))


@dataclass(frozen=True)
class Frame:
    """Where a grid lies in a metric frame (x right, y up in the image).

    Attributes
    ----------
    left_m, top_m : coordinates of the upper left corner of the image, metres.
    resolution_m : side of a cell, metres.
    """

    left_m: float
    top_m: float
    resolution_m: float

    def to_pixels(self, points_m: Array) -> Array:
        """Carry points (..., 2) in metres to (column, row) pixels; cell centres are integers."""
        scaled = (points_m - np.array([self.left_m, self.top_m])) / self.resolution_m
        return np.asarray(scaled * np.array([1.0, -1.0]) - 0.5)

    def to_metres(self, points_px: Array) -> Array:
        """Carry (column, row) pixel coordinates (..., 2) to metres."""
        scaled = (np.asarray(points_px, float) + 0.5) * self.resolution_m
        return np.asarray(scaled * np.array([1.0, -1.0]) + np.array([self.left_m, self.top_m]))
