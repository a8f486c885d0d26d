"""Which ranges of a lidar log are returns, and which mean "nothing was hit"."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array

_NEAR = 0.98
"""From this share of the maximum on, a reading means no return."""


def mask_no_returns(ranges_m: Any, announced_max_m: float | None = None) -> NDArray[np.float32]:  # noqa: ANN401
    """Return the ranges with NaN where there was no return.

    Parameters
    ----------
    ranges_m : (n, b) metres, as found in a log.
    announced_max_m : maximum range that the log states, if it states one. It is not believed
        when more than 1 % of the readings lie beyond it.

    Returns
    -------
    (n, b) float32, metres; NaN for zero, negative, infinite and not-a-number readings and for
    those at or near the maximum of the sensor.

    Examples
    --------
    >>> mask_no_returns([[1.0, 0.0, 29.95, 30.0]], announced_max_m=30.0).tolist()
    [[1.0, nan, nan, nan]]
    """
    ranges = np.array(ranges_m, float)
    with np.errstate(invalid="ignore"):
        ranges[~(np.isfinite(ranges) & (ranges > 0) & (ranges < 1e4))] = np.nan
    limits = [limit for limit in (find_saturation(ranges),) if limit is not None]
    if announced_max_m is not None and np.isfinite(announced_max_m) and announced_max_m > 0:
        beyond = np.count_nonzero(ranges > 1.05 * announced_max_m)
        if beyond <= 0.01 * np.count_nonzero(np.isfinite(ranges)):
            limits.append(announced_max_m)
    if limits:
        with np.errstate(invalid="ignore"):
            ranges[ranges >= _NEAR * min(limits)] = np.nan
    return ranges.astype(np.float32)


def find_saturation(ranges_m: Array) -> float | None:
    """Find the range that a sensor reports when nothing was hit, from the readings alone.

    Such a reading is a spike at the upper end: one value (to 1 cm) that is far more frequent
    than those below it, with next to nothing beyond. Where several values are (error codes just
    below the maximum), the lowest of them is returned. None if there is no spike.

    Parameters
    ----------
    ranges_m : any shape, metres; NaN is left out.

    Source
    ------
    Ours.

    Examples
    --------
    >>> walls = np.linspace(1.0, 12.0, 200)
    >>> find_saturation(np.append(walls, np.full(30, 81.91)))
    81.91
    >>> find_saturation(walls) is None
    True
    """
    values = ranges_m[np.isfinite(ranges_m)]
    if not values.size:
        return None
    centimetres, counts = np.unique(np.rint(100 * values).astype(np.int64), return_counts=True)
    total = np.cumsum(counts)
    for index in np.flatnonzero(counts >= 3)[::-1]:
        value, count = int(centimetres[index]), int(counts[index])
        # Readings beyond are few, or the spike is no upper end and lower ones are none either.
        beyond = total[-1] - total[np.searchsorted(centimetres, 1.03 * value, "right") - 1]
        if beyond > max(2, 0.001 * total[-1]):
            return None
        if _is_spike(centimetres, total, value, count):
            return _lowest_spike(centimetres, counts, total, value)
    return None


def _count_between(centimetres: Any, total: Any, low: float, high: float) -> int:  # noqa: ANN401
    """Count the readings with low <= centimetres < high."""
    ends = np.searchsorted(centimetres, [low, high], "left")
    padded = np.concatenate([[0], total])
    return int(padded[ends[1]] - padded[ends[0]])


def _is_spike(centimetres: Any, total: Any, value: int, count: int) -> bool:  # noqa: ANN401
    """Tell whether one value stands out over the readings below it, of which there are some."""
    if _count_between(centimetres, total, 0, 0.97 * value) < 0.1 * total[-1]:
        return False
    isolated = _count_between(centimetres, total, 0.5 * value, 0.97 * value) == 0
    width = max(0.17 * value, 1.0)
    density = _count_between(centimetres, total, 0.8 * value, 0.97 * value) / width
    return isolated or (count >= 20 and count >= 20 * max(density, 0.05))


def _lowest_spike(centimetres: Any, counts: Any, total: Any, value: int) -> float:  # noqa: ANN401
    """Return the lowest spike within 5 % below ``value``, metres."""
    near = (centimetres >= 0.95 * value) & (centimetres <= value)
    spikes = [
        int(c)
        for c, k in zip(centimetres[near], counts[near], strict=True)
        if k >= 20 and _is_spike(centimetres, total, int(c), int(k))
    ]
    return min([*spikes, value]) / 100
