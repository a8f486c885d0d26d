"""Surfaces seen by a lidar, and the reference for matching they make: tree and fields."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from perception.errors import InputError
from perception.geometry import Array, transform_points

CELL_M = 0.05
"""Cell of the likelihood field, metres."""
FIELD_SIGMA_M = 0.06
"""Width of the likelihood around a surface in the search, metres."""
COARSE = 4
"""Cells of the fine field that a step of the coarse search spans."""


@dataclass(frozen=True)
class Surface:
    """Points on walls and things, with the direction in which each surface faces.

    Attributes
    ----------
    points : (n, 2) metres.
    normals : (n, 2) unit vectors towards the side the lidar was on; NaN where none could be fitted.
    spacing_m : (n,) distance to the next points of the same surface.
    """

    points: Array
    normals: Array
    spacing_m: Array

    def __len__(self) -> int:
        return len(self.points)

    def moved(self, pose: Any) -> Surface:  # noqa: ANN401
        """Return the surface in the frame in which ``pose`` (3,) is given."""
        turn = np.array([0.0, 0.0, np.asarray(pose, float)[2]])
        return Surface(
            transform_points(pose, self.points),
            transform_points(turn, self.normals),
            self.spacing_m,
        )


def fit_normals(points: Any, *, reach: int = 3) -> Surface:  # noqa: ANN401
    """Fit a line through each scan point and its neighbours along the scan.

    Parameters
    ----------
    points : (n, 2) end points of one scan in beam order, laser frame, metres.
    reach : how many neighbours on each side are looked at.

    Returns
    -------
    The points with normals that look at the laser. A normal is NaN where fewer than two neighbours
    are near (15 % of the range, at least 0.2 m) or where they do not lie on a line.

    Source
    ------
    Ours; total least squares over a window of beams.

    Examples
    --------
    >>> wall = np.column_stack([np.full(9, 2.0), np.linspace(-0.4, 0.4, 9)])
    >>> fit_normals(wall).normals[4].round(3).tolist()
    [-1.0, 0.0]
    """
    points = _check_points(points)
    n = len(points)
    if n == 0:
        return Surface(points, points.copy(), np.zeros(0))
    offsets = np.arange(-reach, reach + 1)
    index = np.arange(n)[:, None] + offsets
    inside = (index >= 0) & (index < n)
    delta = points[np.clip(index, 0, n - 1)] - points[:, None]
    distance = np.hypot(delta[..., 0], delta[..., 1])
    ranges = np.hypot(points[:, 0], points[:, 1])
    near = inside & (distance < np.maximum(0.2, 0.15 * ranges)[:, None])
    weight = near.astype(float)
    count = weight.sum(1)
    mean = (weight[..., None] * delta).sum(1) / count[:, None]
    centred = (delta - mean[:, None]) * near[..., None]
    sxx, syy = (centred[..., 0] ** 2).sum(1), (centred[..., 1] ** 2).sum(1)
    sxy = (centred[..., 0] * centred[..., 1]).sum(1)
    angle = 0.5 * np.arctan2(2 * sxy, sxx - syy)
    normals = np.column_stack([-np.sin(angle), np.cos(angle)])
    normals *= np.where((normals * points).sum(1) > 0, -1.0, 1.0)[:, None]
    spread = np.hypot(sxx - syy, 2 * sxy)
    major, minor = 0.5 * (sxx + syy + spread), 0.5 * (sxx + syy - spread)
    flat = (count >= 3) & (minor < 0.05 * major) & (minor < count * 0.03**2)
    normals[~flat] = np.nan
    spacing = np.sqrt(major / np.maximum(count, 1.0))
    return Surface(points, normals, spacing)


@dataclass(frozen=True)
class Reference:
    """What a scan is matched to: the surfaces of some scans with known poses, in one frame.

    Search trees and likelihood fields are made at first use and kept, so use one reference for
    many scans where that is possible.
    """

    surface: Surface

    @cached_property
    def lines(self) -> Surface:
        """The points that have a normal."""
        s = self.surface
        keep = np.isfinite(s.normals[:, 0])
        return Surface(s.points[keep], s.normals[keep], s.spacing_m[keep])

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree over :attr:`lines`."""
        return cKDTree(self.lines.points, balanced_tree=False, compact_nodes=False)

    @cached_property
    def origin(self) -> Array:
        """Lower left corner (2,) of the likelihood fields, metres."""
        return np.asarray(self.surface.points.min(0) - self._margin_m)

    @property
    def _margin_m(self) -> float:
        return 4 * FIELD_SIGMA_M

    @cached_property
    def fine(self) -> NDArray[np.float32]:
        """Likelihood field, cells of ``CELL_M``: 1 on a surface, 0 far from any; rows along y."""
        cells = np.floor((self.surface.points - self.origin) / CELL_M).astype(np.intp)
        pad = int(np.ceil(2 * self._margin_m / CELL_M)) + COARSE
        shape = cells.max(0) + pad
        free = np.ones((int(shape[1]), int(shape[0])), np.uint8)
        free[cells[:, 1], cells[:, 0]] = 0
        # far walls are hit here and there only: without the strokes between, near and dense
        # stretches of a wall would draw the scan towards them
        sparse = self.lines.spacing_m > CELL_M
        middle, normal = self.lines.points[sparse], self.lines.normals[sparse]
        half = (
            0.5
            * self.lines.spacing_m[sparse, None]
            * np.column_stack([normal[:, 1], -normal[:, 0]])
        )
        ends = np.stack([middle - half, middle + half], axis=1) - self.origin
        cv2.polylines(free, list(np.floor(ends / CELL_M).astype(np.int32)), False, 0)
        distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5) * np.float32(CELL_M)
        field = np.exp(-0.5 * (distance / np.float32(FIELD_SIGMA_M)) ** 2)
        return np.asarray(field, np.float32)

    @cached_property
    def coarse(self) -> NDArray[np.float32]:
        """Upper bound of :attr:`fine` within ``COARSE`` cells, same grid."""
        side = 2 * COARSE + 1
        return np.asarray(cv2.dilate(self.fine, np.ones((side, side), np.uint8)), np.float32)


def _check_points(points: Any) -> Array:  # noqa: ANN401
    array = np.asarray(points, float)
    if array.ndim != 2 or array.shape[1] != 2 or not np.isfinite(array).all():
        raise InputError(
            f"scan points: expected finite metres of shape (n, 2), found shape {array.shape}; "
            "drop the beams without a return first"
        )
    return array
