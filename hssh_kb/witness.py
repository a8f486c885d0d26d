"""A map in which trusted observations and assumptions hold, under one reading of each star.

What is supposed to be one place is made one, in every way that the stars allow; what follows is
worked out, and planarity is reached by making further visits one place. A "no" comes with what it
rests on.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from typing import NamedTuple

from hssh_kb.congruence import Assumption
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.merging import ClashError, Merging, Walk
from hssh_kb.planar_search import PlanarSearch, TooHardError

_ROUNDS = (40, 400, None)
"""Nodes for each way to line up the stars: many ways are tried a little before one is in full."""


class _Pair(NamedTuple):
    """Two visits that assumptions make one place, and which ones do so, as bits."""

    one: int
    other: int
    reason: int


class WitnessSearch:
    """Seeks a map in which what is trusted holds.

    Parameters
    ----------
    experience : what was lived through.
    assumptions : all that may be supposed.
    readings : which reading holds at a visit, where it is not the best one.
    planarity : whether this axiom holds.
    end : instant (``time.monotonic``) at which to give up.
    """

    def __init__(
        self,
        experience: Experience,
        assumptions: Sequence[Assumption],
        *,
        readings: Mapping[int, int] | None = None,
        planarity: bool = True,
        end: float | None = None,
    ) -> None:
        self.walk = Walk(experience, len(assumptions), readings)
        self.assumptions = assumptions
        chosen = readings or {}
        self.chosen = tuple(chosen.get(v, 0) for v in range(len(experience))) if chosen else ()
        self.planarity, self.end = planarity, end
        self._most_nodes: int | None = None

    def run(
        self, stars: Set[int], travels: Iterable[int], supposed: Iterable[int]
    ) -> Hypothesis | int:
        """Return a map, or the reason why there is none, as bits of :class:`Walk`.

        Parameters
        ----------
        stars, travels : what is trusted; a travel is named by the visit it leads to.
        supposed : indices of the assumptions made.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        """
        walk = self.walk
        trusted = set(travels)
        believed = [t for t in sorted(trusted) if t in stars and t - 1 in stars]
        groups = _Groups(self, sorted(supposed))
        merging = Merging(walk)
        try:
            merging.apart = groups.find_apart(stars)
            merging.take(believed)
        except ClashError as clash:
            return clash.reason
        found: Merging | int | None = None
        for self._most_nodes in _ROUNDS:
            found = self._align(merging.copy(), groups.find_pairs(stars), 0, 0)
            if found is not None:
                break
        if found is None or isinstance(found, int):
            return found or 0
        doubted = tuple(v for v in range(1, walk.count) if v not in trusted)
        return self._to_hypothesis(found, groups, stars, doubted)

    def _align(
        self, merging: Merging, pairs: Sequence[_Pair], done: int, level: int
    ) -> Merging | int | None:
        """Line up the stars of the pairs in every way; then reach planarity.

        None if that was too hard for the nodes of this round.
        """
        if done == len(pairs):
            if not self.planarity:
                return merging
            try:
                return PlanarSearch(self.end, self._most_nodes).run(merging, level)
            except TooHardError:
                return None
        one, other, why = pairs[done]
        ways = self.walk.turns(one, other) or (0,)
        reason = why | 1 << one | 1 << other
        bit = 1 << (self.walk.first_decision + level) if len(ways) > 1 else 0
        too_hard = False
        for turn in ways:
            further = merging.copy() if bit else merging
            result: Merging | int | None
            try:
                further.align(one, other, turn, reason | bit)
                result = self._align(further, pairs, done + 1, level + bool(bit))
            except ClashError as clash:
                result = clash.reason
            if result is None:
                too_hard = True
            elif not isinstance(result, int) or not result & bit:
                return result
            else:
                reason |= result & ~bit
        return None if too_hard else reason

    def _to_hypothesis(
        self, merging: Merging, groups: _Groups, stars: Set[int], doubted: tuple[int, ...]
    ) -> Hypothesis:
        count, sizes = self.walk.count, self.walk.sizes
        root = list(range(count))

        def find(v: int) -> int:
            while root[v] != v:
                v = root[v]
            return v

        for v in range(count):
            for w in (merging.place[v], groups.name[v]):
                a, b = find(v), find(w)
                root[max(a, b)] = min(a, b)
        visits = [find(v) for v in range(count)]
        offsets = []
        for v, p in enumerate(visits):
            # A first visit whose star is not trusted has no part in the numbering of the dlps.
            back = merging.turn[p] if p in stars else 0
            size = max(sizes[v], 1)
            offsets.append((merging.turn[v] - back) % size if v in stars else 0)
        return Hypothesis(tuple(visits), tuple(offsets), self.chosen, doubted=doubted)


class _Groups:
    """Visits that assumptions make one place, their stars left aside."""

    def __init__(self, search: WitnessSearch, supposed: Sequence[int]) -> None:
        self.first_bit = 2 * search.walk.count
        self.supposed = [(i, search.assumptions[i]) for i in supposed]
        self.name = list(range(search.walk.count))
        self._why: dict[int, int] = {}
        around: dict[int, list[tuple[int, int]]] = {}
        for i, a in self.supposed:
            if a.same:
                around.setdefault(a.one, []).append((a.other, i))
                around.setdefault(a.other, []).append((a.one, i))
        for start in sorted(around):
            if start in self._why:
                continue
            self._why[start] = 0
            queue = [start]
            for v in queue:
                for w, i in around[v]:
                    if w not in self._why:
                        self._why[w] = self._why[v] ^ 1 << (self.first_bit + i)
                        self.name[w] = start
                        queue.append(w)

    def explain(self, one: int, other: int) -> int:
        """Return the assumptions that make two visits of one group one place."""
        return self._why.get(one, 0) ^ self._why.get(other, 0)  # the ways to the root cancel

    def find_pairs(self, stars: Set[int]) -> list[_Pair]:
        """Return pairs of trusted visits that must be one place, from which all others follow."""
        first: dict[int, int] = {}
        pairs = []
        for v in sorted(stars):
            head = first.setdefault(self.name[v], v)
            if head != v:
                pairs.append(_Pair(v, head, self.explain(v, head)))
        return pairs

    def find_apart(self, stars: Set[int]) -> tuple[tuple[int, int, int], ...]:
        """Return pairs of visits that must not be one place, and why.

        Raises
        ------
        ClashError : the assumptions alone make them one.
        """
        trusted: dict[int, int] = {}
        for v in sorted(stars):
            trusted.setdefault(self.name[v], v)
        apart = []
        for i, a in self.supposed:
            if a.same:
                continue
            reason = 1 << (self.first_bit + i)
            if self.name[a.one] == self.name[a.other]:
                raise ClashError(reason | self.explain(a.one, a.other))
            ends = []
            for v in (a.one, a.other):
                w = trusted.get(self.name[v])
                if w is not None:
                    ends.append(w)
                    reason |= self.explain(v, w)
            if len(ends) == 2:
                apart.append((ends[0], ends[1], reason))
        return tuple(apart)
