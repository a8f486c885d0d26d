"""Minimal unsatisfiable subsets and minimal repairs, over any oracle of consistency.

An oracle says whether a set of literals can hold together. What is consistent stays so with fewer
literals; nothing else is asked of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Generic, TypeVar

L = TypeVar("L", bound=Hashable)


_DUAL_LIMIT = 2_000


class OutOfTimeError(Exception):
    """The budget ran out inside an oracle."""


@dataclass
class Conflicts(Generic[L]):
    """Conflicts, smallest first, and repairs; ``complete`` if these are all there are."""

    conflicts: list[frozenset[L]] = field(default_factory=list)
    repairs: list[frozenset[L]] = field(default_factory=list)
    complete: bool = True


def shrink_conflict(
    literals: Sequence[L], consistent: Callable[[frozenset[L]], bool]
) -> frozenset[L]:
    """Return one minimal inconsistent subset of inconsistent literals, early ones preferred.

    Source
    ------
    QuickXplain (Junker 2004), as a divide and conquer over the order of preference.

    Examples
    --------
    >>> sorted(shrink_conflict("abcdef", lambda s: not {"b", "e"} <= s))
    ['b', 'e']
    """

    def explain(background: frozenset[L], fresh: bool, rest: Sequence[L]) -> frozenset[L]:
        if fresh and not consistent(background):
            return frozenset()
        if len(rest) == 1:
            return frozenset(rest)
        half = len(rest) // 2
        first, second = rest[:half], rest[half:]
        late = explain(background | frozenset(first), True, second)
        early = explain(background | late, bool(late), first)
        return early | late

    if not consistent(frozenset()):
        return frozenset()
    return explain(frozenset(), False, literals)


def find_conflicts(
    literals: Sequence[L],
    consistent: Callable[[frozenset[L]], bool],
    *,
    limit: int | None = None,
    end: float | None = None,
) -> Conflicts[L]:
    """Find minimal conflicts and minimal repairs of inconsistent literals.

    A repair is a smallest-by-inclusion set of literals to drop. Repairs are the minimal hitting
    sets of the conflicts, so both are found together: each candidate repair is tried, and a
    failure shows a conflict that was not known.

    Parameters
    ----------
    literals : in order of preference for being named.
    consistent : the oracle; may raise :class:`OutOfTimeError`.
    limit : at most so many conflicts and repairs.
    end : instant (``time.monotonic``) at which to stop.

    Source
    ------
    Reiter 1987 (diagnoses are the minimal hitting sets of conflicts); the search is ours.
    """
    out: Conflicts[L] = Conflicts()
    everything = frozenset(literals)
    rank = {literal: i for i, literal in enumerate(literals)}
    try:
        out.conflicts.append(shrink_conflict(literals, consistent))
        tried: set[frozenset[L]] = set()
        while True:
            if not out.conflicts[0]:
                return out  # nothing that may be dropped is to blame
            if end is not None and time.monotonic() >= end:
                out.complete = False
                return out
            fresh = next(
                (
                    hit
                    for hit in _hitting_sets(out.conflicts, rank)
                    if hit not in tried and not any(r <= hit for r in out.repairs)
                ),
                None,
            )
            if fresh is None:
                _complete_conflicts(out, rank)
                return out
            tried.add(fresh)
            if limit is not None and max(len(out.repairs), len(out.conflicts)) >= limit:
                out.complete = False
                if consistent(everything - fresh):
                    out.repairs.append(fresh)
                return out
            rest = [literal for literal in literals if literal not in fresh]
            if consistent(frozenset(rest)):
                out.repairs.append(fresh)
            else:
                out.conflicts.append(shrink_conflict(rest, consistent))
    except OutOfTimeError:
        out.complete = False
        return out


def _complete_conflicts(out: Conflicts[L], rank: dict[L, int]) -> None:
    """Find the conflicts that were not needed: all are the minimal hitting sets of all repairs."""
    try:
        out.conflicts = list(_hitting_sets(out.repairs, rank, _DUAL_LIMIT))
    except OverflowError:
        out.complete = False


def _hitting_sets(
    conflicts: Sequence[frozenset[L]], rank: dict[L, int], most: int | None = None
) -> Iterator[frozenset[L]]:
    """Yield the minimal hitting sets of the conflicts, smallest first.

    Raises
    ------
    OverflowError : there are more than ``most`` on the way.
    """
    sets: list[frozenset[L]] = [frozenset()]
    for conflict in conflicts:
        hit = [s for s in sets if s & conflict]
        grown = {s | {literal} for s in sets if not s & conflict for literal in conflict}
        kept = [s for s in grown if not any(other <= s for other in hit)]
        sets = hit + kept
        if most is not None and len(sets) > most:
            raise OverflowError
    yield from sorted(sets, key=lambda s: (len(s), sorted(rank[x] for x in chain(s))))
