"""A scan log in memory: what any reader (CARMEN, bags, the simulator) hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array


@dataclass(frozen=True)
class ScanLog:
    """Lidar scans of one drive, in order.

    Attributes
    ----------
    source : where it came from, for messages.
    times_s : (n,) seconds; order counts where the clock does not.
    ranges_m : (n, b) float32 metres; NaN where there was no return.
    angles_rad : (b,) beam directions in the frame of the laser, counter-clockwise, x forward.
    odometry : (n, 3) raw odometry pose of the laser at each scan, own frame; None if absent.
    corrected : (n, 3) pose corrected by some mapper, as found in the log; None if absent.
    truth : (n, 3) true pose, from the simulator only.
    notices : remarks of the reader that the user should see.
    """

    source: str
    times_s: Array
    ranges_m: NDArray[np.float32]
    angles_rad: Array
    odometry: Array | None = None
    corrected: Array | None = None
    truth: Array | None = None
    notices: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.ranges_m)

    def beam_points(self, index: int, cap_m: float = np.inf) -> Array:
        """Return the (k, 2) end points of the returns of one scan, laser frame, metres."""
        ranges = self.ranges_m[index].astype(float)
        keep = np.isfinite(ranges) & (ranges < cap_m)
        r, a = ranges[keep], self.angles_rad[keep]
        return np.column_stack([r * np.cos(a), r * np.sin(a)])
