"""All maps of an experience by depth-first growth of the tree of maps: the programs' quick twin.

The theory is in ``axioms/``; this says the same for experiences with one reading a visit, an order
of magnitude sooner, because each axiom is tested where the map grows: order by the places on a
path, kept at its two open ends; planarity by the face on which both gateways of a new edge must
lie. Tests hold both equal.

Source: Beeson 2008, Algorithm 8.1; the rule of faces after Savelli & Kuipers 2004 as cited there.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis

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
    experience : one reading a visit. count : how many of its visits.
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
        self.size = [len(visit.star) for visit in visits]
        self.width = max(self.size, default=0) + 1
        self.opposite = [visit.star.opposites for visit in visits]
        self.depart = [visit.depart for visit in visits]
        self.came = [
            None if visit.arrive is None else visit.star.opposite(visit.arrive) for visit in visits
        ]
        kinds: dict[object, int] = {}
        self.kind = [kinds.setdefault(visit.star, v) for v, visit in enumerate(visits)]
        self.turns = {
            (a, b): frozenset(visits[a].star.isomorphisms(visits[b].star))
            for a in kinds.values()
            for b in kinds.values()
        }
        self.joined = [-1] * (count * self.width)
        self.other = [-1] * (count * self.width)
        self.on = [0] * (count * self.width)
        self.places = list[int]()
        self.visits, self.offsets = [0] * count, [0] * count
        self.found: list[Hypothesis] = []

    def run(self) -> bool:
        """Collect the maps in ``found``; return whether these are all."""
        try:
            self._add_place(0)
            self._grow(1)
        except _StopSearch:
            return False
        return True

    def _add_place(self, v: int) -> None:
        base = v * self.width
        self.places.append(v)
        self.visits[v], self.offsets[v] = v, 0
        for k, opposite in enumerate(self.opposite[v]):
            self.joined[base + k] = -1
            self.other[base + k] = base + opposite
            self.on[base + k] = 1 << v

    def _grow(self, v: int) -> None:
        """Put visit v everywhere it may be, and go on."""
        if v == self.count:
            self._collect()
            return
        self.nodes += 1
        if self.end is not None and self.nodes % _LOOK_EVERY == 0 and time.monotonic() > self.end:
            raise _StopSearch
        depart, came = self.depart[v - 1], self.came[v]
        if depart is None or came is None:
            return
        before = self.visits[v - 1]
        out = before * self.width + (depart + self.offsets[v - 1]) % self.size[before]
        known = self.joined[out]
        if known >= 0:
            place, k = divmod(known, self.width)
            turn = (k - came) % self.size[place]
            if turn in self.turns[self.kind[v], self.kind[place]]:
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
        on, kind, width = self.on[out], self.kind[v], self.width
        gates = self._face(out) if self.planarity else self._open_gates()
        for into in gates:
            if self.order and self.on[into] & on:
                continue
            place, k = divmod(into, width)
            turn = (k - came) % self.size[place]
            if into != out and turn in self.turns[kind, self.kind[place]]:
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
        self.found.append(Hypothesis(tuple(self.visits), tuple(self.offsets)))
