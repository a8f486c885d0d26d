"""The local perceptual map (LPM): a bounded occupancy grid that scrolls with the robot.

Source: Beeson 2008, section 4.1 (the scrolling LPM); log-odds update as usual in occupancy
grids; the weights and the range cap are ours, measured on recorded corridor logs.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array, transform_points
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame, Image

HIT, MISS = 1.4, -0.7
LOWEST, HIGHEST = -4.0, 5.0
CALLED_AT = 0.3
"""A cell is called occupied above this log-odds and free below its negative."""

FAR_SHARE = 0.75
"""Share of the range cap beyond which a beam is said to reach far."""

_SHIFT = 4  # fractional bits of the polygon corners handed to OpenCV


class OccupancyGrid:
    """A log-odds occupancy grid at a fixed place in its metric frame.

    Parameters
    ----------
    frame : where the grid lies. shape : (rows, columns).
    range_cap_m : returns beyond it clear the space up to it and mark nothing.
    """

    def __init__(self, frame: Frame, shape: tuple[int, int], range_cap_m: float = 12.0) -> None:
        self.frame = frame
        self.range_cap_m = range_cap_m
        self.log_odds: NDArray[np.float32] = np.zeros(shape, np.float32)

    def add_scan(self, pose: Array, ranges_m: NDArray[np.float32], angles_rad: Array) -> None:
        """Add one scan.

        Parameters
        ----------
        pose : (3,) pose of the laser in the frame of the grid; m, m, rad.
        ranges_m : (b,) metres, NaN for no return; a beam without return clears nothing, unless the
            beams on both sides of the gap reach far (it then looks down a long corridor).
        angles_rad : (b,) beam directions in the laser frame.
        """
        ranges = np.nan_to_num(_bridge_far_gaps(ranges_m, self.range_cap_m), nan=0.0)
        hit = (ranges > 0) & (ranges < self.range_cap_m)
        reach = np.minimum(ranges, self.range_cap_m)
        directions = np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
        ends = self._pixels(pose, directions * reach[:, None])
        short = np.maximum(reach - 0.5 * self.frame.resolution_m, 0.0)
        outline = self._pixels(pose, directions * short[:, None])
        if angles_rad[-1] - angles_rad[0] < 1.9 * np.pi:  # not a full circle: close at the laser
            outline = np.vstack([outline, self._pixels(pose, np.zeros((1, 2)))])
        rows, columns = self.log_odds.shape
        low = np.floor(outline.min(0)).astype(int) - 1
        high = np.ceil(outline.max(0)).astype(int) + 2
        x0, y0 = max(low[0], 0), max(low[1], 0)
        x1, y1 = min(high[0], columns), min(high[1], rows)
        if x0 >= x1 or y0 >= y1:
            return
        seen = np.zeros((y1 - y0, x1 - x0), np.uint8)
        corners = np.round((outline - np.array([x0, y0])) * (1 << _SHIFT)).astype(np.int32)
        cv2.fillPoly(seen, [corners], 1, shift=_SHIFT)
        window = self.log_odds[y0:y1, x0:x1]
        cells = np.round(ends[hit]).astype(int) - np.array([x0, y0])
        inside = (cells >= 0).all(1) & (cells[:, 0] < x1 - x0) & (cells[:, 1] < y1 - y0)
        marked = np.zeros_like(seen, dtype=bool)
        marked[cells[inside, 1], cells[inside, 0]] = True
        window[(seen > 0) & ~marked] += MISS
        window[marked] += HIT
        np.clip(window, LOWEST, HIGHEST, out=window)

    def image(self) -> Image:
        """Return the grid as a grey image (rows, columns)."""
        image = np.full(self.log_odds.shape, UNKNOWN, np.uint8)
        image[self.log_odds < -CALLED_AT] = FREE
        image[self.log_odds > CALLED_AT] = OCCUPIED
        return image

    def _pixels(self, pose: Array, points: Array) -> Array:
        return self.frame.to_pixels(transform_points(pose, points))


def _bridge_far_gaps(ranges_m: NDArray[np.float32], cap_m: float) -> Array:
    """Let beams without return, between beams that reach far, reach the cap."""
    ranges = ranges_m.astype(float)
    lost = np.isnan(ranges)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(np.int8)))
    for first, last in edges.reshape(-1, 2):
        inside = first > 0 and last < len(ranges)
        if inside and min(ranges[first - 1], ranges[last]) > FAR_SHARE * cap_m:
            ranges[first:last] = cap_m
    return ranges


class LocalMap(OccupancyGrid):
    """The scrolling LPM: a square window whose axes are those of the drive frame.

    The window follows the robot in whole cells, so nothing is resampled; what scrolls out is
    forgotten. The robot is always within one cell of the centre.

    Parameters
    ----------
    size_m, resolution_m : side of the window and of a cell, metres.

    Source
    ------
    Beeson 2008, section 4.1; 15 m and 10 cm are what served best on recorded corridor logs.
    """

    def __init__(
        self, size_m: float = 15.0, resolution_m: float = 0.1, range_cap_m: float = 12.0
    ) -> None:
        cells = round(size_m / resolution_m)
        cells += 1 - cells % 2
        half = cells * resolution_m / 2
        super().__init__(Frame(-half, half, resolution_m), (cells, cells), range_cap_m)

    @property
    def centre_m(self) -> Array:
        """The centre of the window in the drive frame, metres."""
        half = self.log_odds.shape[0] * self.frame.resolution_m / 2
        return np.array([self.frame.left_m + half, self.frame.top_m - half])

    def scroll_to(self, point_m: Array) -> None:
        """Move the window, in whole cells, so that ``point_m`` lies in its middle cell."""
        resolution = self.frame.resolution_m
        dx, dy = np.round((np.asarray(point_m)[:2] - self.centre_m) / resolution).astype(int)
        if dx == 0 and dy == 0:
            return
        moved = np.zeros_like(self.log_odds)
        size = len(moved)
        if abs(dx) < size and abs(dy) < size:
            rows, columns = (
                slice(max(dy, 0), size + min(dy, 0)),
                slice(max(-dx, 0), size - max(dx, 0)),
            )
            from_rows = slice(max(-dy, 0), size - max(dy, 0))
            from_columns = slice(max(dx, 0), size + min(dx, 0))
            moved[rows, columns] = self.log_odds[from_rows, from_columns]
        self.log_odds = moved
        self.frame = Frame(
            self.frame.left_m + dx * resolution, self.frame.top_m + dy * resolution, resolution
        )

    def shrink_to(self, size_m: float) -> LocalMap:
        """Return a copy of the middle of the window, as wide as told [m]."""
        part = LocalMap(size_m, self.frame.resolution_m, self.range_cap_m)
        if len(part.log_odds) > len(self.log_odds):
            raise InputError(
                f"the LPM is smaller than {size_m} m; nothing is known beyond its border"
            )
        cut = (len(self.log_odds) - len(part.log_odds)) // 2
        inner = slice(cut, cut + len(part.log_odds))
        part.log_odds = self.log_odds[inner, inner].copy()
        left, top, resolution = self.frame.left_m, self.frame.top_m, self.frame.resolution_m
        part.frame = Frame(left + cut * resolution, top - cut * resolution, resolution)
        return part

    def update(self, pose: Array, ranges_m: NDArray[np.float32], angles_rad: Array) -> None:
        """Scroll to the robot and add one scan taken there (see :meth:`add_scan`)."""
        self.scroll_to(pose[:2])
        self.add_scan(pose, ranges_m, angles_rad)
