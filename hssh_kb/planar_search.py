"""Is there a planar map in which these visits are one place? Exact, by crossings and backjumping.

Each pair of cycles that cross oddly is mended in every possible way; a way that fails tells why,
and if the choice made here has no part in that, the choice is not tried otherwise.

Source: ours; conflict-directed backjumping after Prosser 1993.
"""

from __future__ import annotations

import random
import time

from hssh_kb.crossings import (
    Candidate,
    Cycle,
    explain_odd_pair,
    find_candidates,
    find_cycles,
    find_odd_pairs,
    measure_oddness,
)
from hssh_kb.merging import ClashError, Merging, Refused
from hssh_kb.subsets import OutOfTimeError

_PAIRS_TRIED = 8
"""Of the odd pairs, the shortest ones are looked at, and the one with the fewest ways is mended."""
_LOOKED_AT = 12
"""So many ways are carried out before the most promising of them is followed."""


class TooHardError(Exception):
    """A search took more nodes than it was given."""


class PlanarSearch:
    """Seeks a planar map that comes of a merging by making further visits one place.

    Parameters
    ----------
    end : instant (``time.monotonic``) at which to give up; None for never.
    most_nodes : how many mergings may be looked at; None for all.
    """

    def __init__(self, end: float | None, most_nodes: int | None = None) -> None:
        self.end, self.most_nodes, self.nodes = end, most_nodes, 0
        self._rng = random.Random(0)

    def run(self, merging: Merging, level: int = 0) -> Merging | int:
        """Return a planar merging, or the reason why there is none.

        Parameters
        ----------
        merging : where to begin; what is learned is noted in its refusals.
        level : how many decisions were made already.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        TooHardError : so did the nodes.
        """
        self.nodes += 1
        if self.most_nodes is not None and self.nodes > self.most_nodes:
            raise TooHardError
        if self.end is not None and time.monotonic() >= self.end:
            raise OutOfTimeError
        odd = find_odd_pairs(find_cycles(merging))
        if not odd:
            return merging
        (one, other), waiting = self._choose(merging, odd)
        reason = explain_odd_pair(merging, one, other)
        self._rng.shuffle(waiting)
        while waiting:
            result = self._mend(merging, waiting[:_LOOKED_AT], level)
            if not isinstance(result, _Failure):
                return result
            if result.jump:
                return result.reason
            reason |= result.reason
            waiting = waiting[_LOOKED_AT:]
        return reason

    def _choose(
        self, merging: Merging, odd: list[tuple[Cycle, Cycle]]
    ) -> tuple[tuple[Cycle, Cycle], list[Candidate]]:
        """Return the odd pair that can be mended in the fewest ways, and these."""
        best, ways = odd[0], find_candidates(merging, *odd[0])
        for pair in odd[1:_PAIRS_TRIED]:
            if len(ways) <= 1:
                break
            others = find_candidates(merging, *pair)
            if len(others) < len(ways):
                best, ways = pair, others
        return best, ways

    def _mend(
        self, merging: Merging, candidates: list[Candidate], level: int
    ) -> Merging | _Failure:
        """Try some ways of mending, the most promising first: a planar merging, or why none."""
        bit, reason = 1 << (merging.walk.first_decision + level), 0
        ready = list[tuple[int, int, Candidate]]()
        for i, candidate in enumerate(candidates):
            tried = _carry_out(merging, candidate, bit)
            if isinstance(tried, int):
                ready.append((-1, i, candidate))
            else:
                ready.append((measure_oddness(find_cycles(tried)), i, candidate))
        for _, _, candidate in sorted(ready):
            # Once more, as what has failed since may say that it fails too.
            result = _carry_out(merging, candidate, bit)
            if not isinstance(result, int):
                result = self.run(result, level + 1)
            if not isinstance(result, int):
                return result
            if not result & bit:
                return _Failure(result, jump=True)
            merging.refused.append(Refused(*candidate, result & ~bit))
            reason |= result & ~bit
        return _Failure(reason, jump=False)


class _Failure:
    """Why some ways of mending fail; ``jump`` if the ways themselves have no part in it."""

    def __init__(self, reason: int, *, jump: bool) -> None:
        self.reason, self.jump = reason, jump


def _carry_out(merging: Merging, candidate: Candidate, bit: int) -> Merging | int:
    """Return the merging with two places made one, or why that clashes."""
    further = merging.copy()
    try:
        further.align(*candidate, bit)
    except ClashError as clash:
        return clash.reason
    return further
