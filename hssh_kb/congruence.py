"""What must be one place, given that some visits are: closure under the axioms of travel.

It says which visits the logic programs are asked about when a conflict is put into words: whatever
the travels can make one place, stars left aside. What is consistent is decided elsewhere
(:mod:`hssh_kb.merging`), with reasons.

Source: ours; the least closure is the "equality is congruence" of Remolina & Kuipers 2004.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, product

from hssh_kb.experience import Experience, has_partial_types

Gate = tuple[int, int]
_ALIGNMENT_LIMIT = 64


class _ConflictError(Exception):
    """The closure violates an axiom."""


@dataclass(frozen=True)
class Assumption:
    """The user supposes that two visits are (or are not) at one place.

    Attributes
    ----------
    one, other : indices of the visits. same : whether they are one place.
    text : the user's words.
    """

    one: int
    other: int
    same: bool
    text: str


class Closure:
    """Least map that follows from assumptions and trusted observations.

    Parameters
    ----------
    experience : what was lived through.
    lenient : let any two stars of one size match: what would follow if stars did not matter.
    """

    def __init__(
        self,
        experience: Experience,
        *,
        lenient: bool = False,
    ) -> None:
        self.lenient = lenient
        readings_held = [visit.readings[0] for visit in experience.visits]
        self.readings = readings_held
        self.partial = has_partial_types(experience)
        self.stars = [reading.star for reading in readings_held]
        self.arrive = [reading.arrive for reading in readings_held]
        self.depart = [reading.depart for reading in readings_held]
        self.came = [
            None if arrive is None else star.opposite(arrive)
            for star, arrive in zip(self.stars, self.arrive, strict=True)
        ]
        self._rotations: dict[tuple[int, int], tuple[int, ...]] = {}

    def relate(
        self, trusted: frozenset[int], travels: Sequence[int], assumptions: Iterable[Assumption]
    ) -> set[tuple[int, int, int]]:
        """Return (visit, earlier visit, rotation) wherever some alignment makes them one place.

        It goes as far as it can: a clash ends one alignment, and what was found is kept.
        """
        same = [a for a in assumptions if a.same]
        believed = sorted(v for v in travels if v in trusted and v - 1 in trusted)
        related: set[tuple[int, int, int]] = set()
        for alignment in islice(self._alignments(trusted, same), _ALIGNMENT_LIMIT):
            classes = _Classes(self)
            with suppress(_ConflictError):
                for v, w, rotation in alignment:
                    classes.align(v, w, rotation)
                self._close_travels(believed, classes)
            related |= classes.pairs(trusted)
        return related

    def _alignments(
        self, trusted: frozenset[int], same: Sequence[Assumption]
    ) -> Iterator[tuple[tuple[int, int, int], ...]]:
        """Yield (visit, visit, rotation) merges, one tuple for each way to align the stars."""
        groups = _Classes(self)
        for a in same:
            groups.unite(a.one, a.other)
        members: dict[int, list[int]] = {}
        for v in sorted(trusted):
            members.setdefault(groups.place(v), []).append(v)
        choices = [
            [(v, group[0], r) for r in self.rotations(v, group[0])]
            for group in members.values()
            for v in group[1:]
        ]
        yield from product(*choices)

    def rotations(self, v: int, w: int) -> tuple[int, ...]:
        """Return the isomorphisms from the star of visit v to the star of visit w."""
        key = (v, w)
        if key not in self._rotations:
            one, other = self.stars[v], self.stars[w]
            if self.lenient and len(one) == len(other):
                self._rotations[key] = tuple(range(len(one)))
            else:
                self._rotations[key] = self.readings[v].isomorphisms(self.readings[w])
        return self._rotations[key]

    def _close_travels(self, travels: Sequence[int], classes: _Classes) -> dict[Gate, Gate]:
        """Join gateways and make one what travel says is one, until nothing changes."""
        links: dict[Gate, Gate] = {}
        while not self._join_all(travels, classes, links):
            links.clear()
        return links

    def _join_all(self, travels: Sequence[int], classes: _Classes, links: dict[Gate, Gate]) -> bool:
        """Join gateways; False if that made two visits one place, so that all starts anew."""
        for v in travels:
            depart, came = self.depart[v - 1], self.came[v]
            if depart is None or came is None:
                continue
            out, into = classes.gate(v - 1, depart), classes.gate(v, came)
            if out == into:
                raise _ConflictError
            for one, other in ((out, into), (into, out)):
                known = links.get(one, other)
                if known != other:
                    (w, k), (u, m) = known, other
                    classes.align(w, u, (m - k) % len(self.stars[w]))
                    return False
                links[one] = other
        return True


class _Classes:
    """Visits in places, and the rotation that carries each star onto the first of its place."""

    def __init__(self, closure: Closure) -> None:
        self.closure = closure
        count = len(closure.stars)
        self.root = list(range(count))
        self.aligned = [(v, 0) for v in range(count)]

    def place(self, v: int) -> int:
        """Return the first visit of the place of a visit."""
        while self.root[v] != v:
            v = self.root[v]
        return v

    def unite(self, v: int, w: int) -> None:
        """Make two visits one place."""
        one, other = self.place(v), self.place(w)
        self.root[max(one, other)] = min(one, other)

    def frame(self, v: int) -> tuple[int, int]:
        """Return the visit whose star numbers the gateways here, and the rotation onto it."""
        turn = 0
        while self.aligned[v][0] != v:
            v, more = self.aligned[v]
            turn += more
        return v, turn

    def gate(self, v: int, k: int) -> Gate:
        """Return the gateway of dlp k of visit v."""
        w, turn = self.frame(v)
        return w, (k + turn) % len(self.closure.stars[w])

    def align(self, v: int, w: int, rotation: int) -> None:
        """Make dlp k of visit v dlp k + rotation of visit w.

        Raises
        ------
        _ConflictError : they are aligned otherwise already, or their stars differ.
        """
        (one, turn_v), (other, turn_w) = self.frame(v), self.frame(w)
        size = len(self.closure.stars[one])
        turn = (rotation + turn_w - turn_v) % max(size, 1)
        if one == other:
            if turn:
                raise _ConflictError
            return
        if turn not in self.closure.rotations(one, other):
            raise _ConflictError
        if self.closure.partial:
            self._check_members(one, other, turn)
        if one < other:
            one, other, turn = other, one, -turn % size
        self.aligned[one] = (other, turn)
        self.unite(v, w)

    def _check_members(self, one: int, other: int, turn: int) -> None:
        """Check each visit of one frame against each of another: some types are not told."""
        count = len(self.closure.stars)
        frames = [(v, *self.frame(v)) for v in range(count)]
        size = max(len(self.closure.stars[one]), 1)
        for v, root, here in frames:
            for w, goal, there in frames:
                rotation = (here + turn - there) % size
                if (root, goal) == (one, other) and rotation not in self.closure.rotations(v, w):
                    raise _ConflictError

    def pairs(self, visits: Iterable[int]) -> set[tuple[int, int, int]]:
        """Return (visit, earlier visit, rotation) for all that are aligned."""
        groups: dict[int, list[tuple[int, int]]] = {}
        for v in sorted(visits):
            root, turn = self.frame(v)
            groups.setdefault(root, []).append((v, turn))
        return {
            (v, w, (turn - back) % max(len(self.closure.stars[v]), 1))
            for group in groups.values()
            for v, turn in group
            for w, back in group
            if w < v
        }
