"""What a search may spend: work, counted the same on every machine, and seconds as a safety net.

Work is counted in units of about one way to take a visit weighed (some 20 microseconds of one
core); so the same input gives the same answer however loaded the machine is, unless the seconds
run out first.

Source: ours.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

_WORK_PER_VISIT = 2_000
_WORK_AT_LEAST = 40_000
_WORK_WITHOUT_SLIPS = 1_000_000
_SECONDS = 60.0
_SECONDS_PER_VISIT = 0.15


class Budget:
    """Work and seconds of one search.

    Parameters
    ----------
    count_work : tells the work done since the tree was made.
    work : units to spend; None for no limit.
    seconds : of wall time; None for no limit.
    """

    def __init__(
        self, count_work: Callable[[], int], work: float | None, seconds: float | None
    ) -> None:
        self._count_work = count_work
        self._work = math.inf if work is None else work
        self._seconds = math.inf if seconds is None else seconds
        self._start_work = count_work()
        self._start_s = time.monotonic()

    def is_spent(self, share: float = 1.0) -> bool:
        """Return whether a share of the work or of the seconds is spent."""
        return (
            self._count_work() - self._start_work >= share * self._work
            or time.monotonic() - self._start_s >= share * self._seconds
        )

    def allot(self, work: float) -> Callable[[], bool]:
        """Return a test that tells when a part of the budget, or all of it, is spent."""
        end = self._count_work() + work
        return lambda: self._count_work() >= end or self.is_spent()


def tell_rest(end: float | None) -> float | None:
    """Return the seconds until an instant (``time.monotonic``), 0 once it is over; None for ever.

    Examples
    --------
    >>> tell_rest(None), tell_rest(time.monotonic() - 1)
    (None, 0.0)
    """
    return None if end is None else max(end - time.monotonic(), 0.0)


def allow_seconds(visits: int) -> float:
    """Return the seconds of wall time after which a search of so many visits is ended by default.

    A safety net: a search of so many visits ends before, unless the machine is busy.

    Examples
    --------
    >>> allow_seconds(100), allow_seconds(2000)
    (60.0, 300.0)
    """
    return max(_SECONDS, _SECONDS_PER_VISIT * visits)


def tell_seconds() -> str:
    """Return in words what :func:`allow_seconds` allows.

    Examples
    --------
    >>> tell_seconds()
    '60, or 0.15 a visit if that is more'
    """
    return f"{_SECONDS:g}, or {_SECONDS_PER_VISIT:g} a visit if that is more"


def allow_work(visits: int, slip: float) -> int:
    """Return the units of work that a search of so many visits may spend by default.

    Where no travel slips, wrong maps are refuted and most searches end long before.

    Examples
    --------
    >>> allow_work(70, 0.05) < allow_work(150, 0.05) < allow_work(150, 0.0) < allow_work(2000, 0.0)
    True
    """
    if slip == 0:
        return max(_WORK_WITHOUT_SLIPS, _WORK_PER_VISIT * visits)
    return max(_WORK_AT_LEAST, _WORK_PER_VISIT * visits)
