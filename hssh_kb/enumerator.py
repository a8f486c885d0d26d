"""All maps of an experience by depth-first growth of the tree of maps: the programs' quick twin.

The theory is in ``axioms/``; this says the same, up to two orders of magnitude sooner, because each
axiom is tested where the map grows: order by the places on a path, kept at its two open ends;
planarity by the face on which both gateways of a new edge must lie. Tests hold both equal.

Source: Beeson 2008, Algorithm 8.1; the rule of faces after Savelli & Kuipers 2004 as cited there.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from hssh_kb.experience import Experience, Reading
from hssh_kb.hypothesis import Hypothesis
from perception.star import Star

_LOOK_EVERY = 512


class _StopSearch(Exception):  # noqa: N818 - control flow, no error
    """A budget ended the search."""


class TreeEnumerator:
    """Grows the tree of maps depth first.

    A gateway is the number ``place * width + dlp``. ``joined[g]`` is the gateway at the other end,
    -1 if open. For an open gateway, ``other[g]`` is the other open end of its path and ``on[g]``
    the places of the path, as bits.

    Parameters
    ----------
    experience : what was lived through. count : how many of its visits.
    order, planarity : whether these axioms hold.
    limit, end : at most so many maps, and not beyond this instant (``time.monotonic``).
    """

    def __init__(
        self,
        experience: Experience,
        count: int,
        *,
        order: bool = True,
        planarity: bool = True,
        limit: int | None = None,
        end: float | None = None,
    ) -> None:
        visits = experience.visits[:count]
        self.count, self.order, self.planarity = count, order, planarity
        self.limit, self.end, self.nodes = limit, end, 0
        self.known = [[_Seen(reading) for reading in visit.readings] for visit in visits]
        self.several = any(len(readings) > 1 for readings in self.known)
        self.width = 1 + max((s.size for readings in self.known for s in readings), default=0)
        self.turns = _match_stars([s for readings in self.known for s in readings])
        self.seen = [readings[0] for readings in self.known]
        self.chosen = [0] * count
        self.size = [0] * count
        self.joined = [-1] * (count * self.width)
        self.other = [-1] * (count * self.width)
        self.on = [0] * (count * self.width)
        self.places = list[int]()
        self.visits, self.offsets = [0] * count, [0] * count
        self.found: list[Hypothesis] = []

    def run(self) -> bool:
        """Collect the maps in ``found``; return whether these are all."""
        try:
            for r in range(len(self.known[0])):
                self._choose(0, r)
                self._add_place(0)
                self._grow(1)
                self.places.pop()
        except _StopSearch:
            return False
        return True

    def _choose(self, v: int, r: int) -> None:
        self.chosen[v], self.seen[v] = r, self.known[v][r]

    def _add_place(self, v: int) -> None:
        base = v * self.width
        self.places.append(v)
        self.visits[v], self.offsets[v] = v, 0
        self.size[v] = self.seen[v].size
        for k, opposite in enumerate(self.seen[v].opposite):
            self.joined[base + k] = -1
            self.other[base + k] = base + opposite
            self.on[base + k] = 1 << v

    def _grow(self, v: int) -> None:
        """Put visit v everywhere it may be, in each of its readings, and go on."""
        if v == self.count:
            self._collect()
            return
        self.nodes += 1
        if self.end is not None and self.nodes % _LOOK_EVERY == 0 and time.monotonic() > self.end:
            raise _StopSearch
        depart = self.seen[v - 1].depart
        if depart is None:
            return
        before = self.visits[v - 1]
        out = before * self.width + (depart + self.offsets[v - 1]) % self.size[before]
        for r in range(len(self.known[v])):
            self._choose(v, r)
            came = self.seen[v].came
            if came is not None:
                self._place(v, came, out)

    def _place(self, v: int, came: int, out: int) -> None:
        """Put visit v, entered through its gateway ``came`` from gateway ``out``, everywhere."""
        far = self.joined[out]
        if far >= 0:
            place, k = divmod(far, self.width)
            turn = (k - came) % self.size[place]
            if turn in self.turns[self.seen[v].kind, self.seen[place].kind]:
                self.visits[v], self.offsets[v] = place, turn
                self._grow(v + 1)
            return
        for into, turn in list(self._closures(v, came, out)):
            self.visits[v], self.offsets[v] = into // self.width, turn
            self._join_and_grow(out, into, v + 1)
        self._add_place(v)
        self._join_and_grow(out, v * self.width + came, v + 1)
        self.places.pop()

    def _closures(self, v: int, came: int, out: int) -> Iterator[tuple[int, int]]:
        """Yield the open gateways by which visit v may have come in, with the rotation."""
        on, kind, width = self.on[out], self.seen[v].kind, self.width
        gates = self._face(out) if self.planarity else self._open_gates()
        for into in gates:
            if self.order and self.on[into] & on:
                continue
            place, k = divmod(into, width)
            turn = (k - came) % self.size[place]
            if into != out and turn in self.turns[kind, self.seen[place].kind]:
                yield into, turn

    def _open_gates(self) -> Iterator[int]:
        for place in self.places:
            base = place * self.width
            for gate in range(base, base + self.size[place]):
                if self.joined[gate] < 0:
                    yield gate

    def _face(self, start: int) -> list[int]:
        """Return the open gateways on the face of an open gateway."""
        gates, gate = [], start
        joined, width, size = self.joined, self.width, self.size
        while True:
            far = joined[gate]
            if far < 0:
                gates.append(gate)
                far = gate
            place = far // width
            gate = far + 1
            if gate - place * width == size[place]:
                gate = place * width
            if gate == start:
                return gates

    def _join_and_grow(self, out: int, into: int, v: int) -> None:
        joined, other, on = self.joined, self.other, self.on
        joined[out], joined[into] = into, out
        if not self.order:
            self._grow(v)
        else:
            first, last = other[out], other[into]
            was_first, was_last = on[first], on[last]
            other[first], other[last] = last, first
            on[first] = on[last] = was_first | was_last
            self._grow(v)
            other[first], other[last] = out, into
            on[first], on[last] = was_first, was_last
        joined[out] = joined[into] = -1

    def _collect(self) -> None:
        if self.limit is not None and len(self.found) >= self.limit:
            raise _StopSearch
        readings = tuple(self.chosen) if self.several else ()
        self.found.append(Hypothesis(tuple(self.visits), tuple(self.offsets), readings))


class _Seen:
    """One reading of one visit, taken apart."""

    def __init__(self, reading: Reading) -> None:
        self.reading, self.star = reading, reading.star
        self.size = len(reading.star)
        self.opposite = reading.star.opposites
        self.depart = reading.depart
        self.came = None if reading.arrive is None else reading.star.opposite(reading.arrive)
        self.kind = 0


def _match_stars(seen: list[_Seen]) -> dict[tuple[int, int], frozenset[int]]:
    """Give each star a number and return the isomorphisms from each to each."""
    kinds: dict[tuple[Star, tuple[str, ...]], int] = {}
    examples: dict[int, Reading] = {}
    for one in seen:
        one.kind = kinds.setdefault((one.star, one.reading.types), len(kinds))
        examples.setdefault(one.kind, one.reading)
    return {
        (a, b): frozenset(reading.isomorphisms(other))
        for a, reading in examples.items()
        for b, other in examples.items()
    }
