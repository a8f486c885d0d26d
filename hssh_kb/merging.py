"""Visits made one place, and all that follows from it; each step knows what it rests on.

A :class:`Merging` holds which trusted visits are one place so far. Making two of them one makes
others one too: a gateway leads to one gateway, in both directions. What follows is worked out at
once, and a clash is raised with its reason: the observations, assumptions and decisions used.

Source: ours; congruence closure with explanations after Nieuwenhuis & Oliveras 2007.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from hssh_kb.experience import Experience, has_partial_types
from perception.star import Star


class ClashError(Exception):
    """The visits made one place violate an axiom; ``reason`` is a set of bits."""

    def __init__(self, reason: int) -> None:
        super().__init__(reason)
        self.reason = reason


class Link(NamedTuple):
    """A gateway and what it leads to: ``travel`` goes from here to gateway ``far``.

    ``here`` and ``there`` are the visits at the two ends.
    """

    far: int
    travel: int
    here: int
    there: int


class Refused(NamedTuple):
    """Dlp k of visit ``one`` is not dlp k + ``turn`` of visit ``other``, because of ``reason``."""

    one: int
    other: int
    turn: int
    reason: int


class Walk:
    """What was lived through, under one reading of each star; shared by all mergings of it.

    A reason is a set of bits: v for the star seen at visit v, n + v for the travel that led to it,
    2 n + i for assumption i, and from ``first_decision`` on for decisions of a search.

    Parameters
    ----------
    experience : what was lived through.
    assumptions : how many assumptions there are.
    readings : which reading holds at a visit, where it is not the best one.
    """

    def __init__(
        self, experience: Experience, assumptions: int, readings: Mapping[int, int] | None = None
    ) -> None:
        chosen = readings or {}
        held = [v.readings[chosen.get(i, 0)] for i, v in enumerate(experience.visits)]
        self.readings = held
        self.stars: list[Star] = [reading.star for reading in held]
        self.sizes = [len(star) for star in self.stars]
        self.depart = [reading.depart for reading in held]
        self.came = [
            None if reading.arrive is None else reading.star.opposite(reading.arrive)
            for reading in held
        ]
        self.partial = has_partial_types(experience)
        self.count = len(held)
        self.width = max(self.sizes, default=0) + 1
        self.first_decision = 2 * self.count + assumptions
        self._turns: dict[tuple[int, int], tuple[int, ...]] = {}

    def turns(self, one: int, other: int) -> tuple[int, ...]:
        """Return the isomorphisms from the star of one visit to that of another."""
        key = one, other
        if key not in self._turns:
            self._turns[key] = self.readings[one].isomorphisms(self.readings[other])
        return self._turns[key]

    def told_by(self, travel: int) -> int:
        """Return what a travel rests on: itself and the stars at its two ends."""
        return 1 << (self.count + travel) | 1 << (travel - 1) | 1 << travel


class Merging:
    """Which trusted visits are one place, and which gateway leads to which.

    Gateway k of the place named after visit p is the number ``p * width + k``, in the numbering of
    the star of p.

    Attributes
    ----------
    place : name of the place of each visit. turn : dlp k of a visit is dlp k + turn of its place.
    links : gateway -> :class:`Link`, for all that were travelled.
    refused : alignments that must not come about.
    apart : (visit, visit, reason) that must not be one place.
    """

    def __init__(self, walk: Walk) -> None:
        self.walk = walk
        self.place = list(range(walk.count))
        self.turn = [0] * walk.count
        self.members: dict[int, list[int]] = {v: [v] for v in range(walk.count)}
        self.links: dict[int, Link] = {}
        self.refused: list[Refused] = []
        self.apart: tuple[tuple[int, int, int], ...] = ()
        self._above: list[tuple[int, int]] = [(v, 0) for v in range(walk.count)]
        self._waiting: list[tuple[int, int, int, int]] = []

    def copy(self) -> Merging:
        """Return a merging that may go another way."""
        other = Merging.__new__(Merging)
        other.walk = self.walk
        other.place, other.turn = self.place.copy(), self.turn.copy()
        other.members = self.members.copy()
        other.links, other.refused = self.links.copy(), self.refused.copy()
        other.apart = self.apart
        other._above, other._waiting = self._above.copy(), []
        return other

    def take(self, travels: Iterable[int]) -> None:
        """Believe travels, each named by the visit it leads to.

        Raises
        ------
        ClashError : an axiom is violated.
        """
        for travel in travels:
            self._join(travel)
        self._settle()

    def align(self, one: int, other: int, turn: int, reason: int) -> None:
        """Make dlp k of one visit dlp k + turn of another, and work out what follows.

        Raises
        ------
        ClashError : an axiom is violated.
        """
        self._waiting.append((one, other, turn, reason))
        self._settle()

    def explain(self, one: int, other: int) -> int:
        """Return why two visits of one place are one place."""
        above = self._above
        seen: dict[int, int] = {}
        v, reason = one, 0
        while True:
            seen[v] = reason
            up, why = above[v]
            if up == v:
                break
            v, reason = up, reason | why
        v, reason = other, 0
        while v not in seen:
            up, why = above[v]
            v, reason = up, reason | why
        return reason | seen[v]

    def is_refused(self, one: int, other: int, turn: int) -> Refused | None:
        """Return the refusal of making dlp k of place ``one`` dlp k + turn of place ``other``."""
        for held in self.refused:
            for a, b, r in (
                (held.one, held.other, held.turn),
                (held.other, held.one, -held.turn),
            ):
                if self.place[a] == one and self.place[b] == other:
                    size = self.walk.sizes[one]
                    if (r + self.turn[b] - self.turn[a] - turn) % size == 0:
                        return held
        return None

    def _settle(self) -> None:
        while self._waiting:
            self._merge(*self._waiting.pop())
        self._check_refused()
        self._check_order()

    def _merge(self, one: int, other: int, turn: int, reason: int) -> None:
        walk, place = self.walk, self.place
        p, q = place[one], place[other]
        size = walk.sizes[p]
        told = 1 << one | 1 << other
        if size != walk.sizes[q] or not size:
            if p != q:
                self._merge_bare(one, other, reason)
            return
        onto = (turn + self.turn[other] - self.turn[one]) % size  # gateway g of p is g + onto of q
        if p == q:
            if onto:
                raise ClashError(reason | told | self.explain(one, other))
            return
        if turn % size not in walk.turns(one, other):
            raise ClashError(reason | told)
        if walk.partial:
            self._check_types(p, q, onto, one, other, reason)
        if len(self.members[p]) > len(self.members[q]):
            p, q, onto = q, p, -onto % size
        moved = self._unlink(p)
        for v in self.members[p]:
            place[v] = q
            self.turn[v] = (self.turn[v] + onto) % size
        self.members[q] = self.members[q] + self.members.pop(p)
        self._note(one, other, reason)
        for travel in moved:
            self._join(travel)

    def _merge_bare(self, one: int, other: int, reason: int) -> None:
        """Make one place of stars without dlps; stars of different sizes clash."""
        if self.walk.sizes[one] != self.walk.sizes[other]:
            raise ClashError(reason | 1 << one | 1 << other)
        p, q = self.place[one], self.place[other]
        for v in self.members[p]:
            self.place[v] = q
        self.members[q] = self.members[q] + self.members.pop(p)
        self._note(one, other, reason)

    def _check_types(self, p: int, q: int, onto: int, one: int, other: int, reason: int) -> None:
        """Compare each visit of one place with each of another: some types are not told."""
        size = self.walk.sizes[p]
        for v in self.members[p]:
            for w in self.members[q]:
                turn = (self.turn[v] + onto - self.turn[w]) % size
                if turn not in self.walk.turns(v, w):
                    why = self.explain(v, one) | self.explain(other, w)
                    raise ClashError(reason | why | 1 << v | 1 << w)

    def _note(self, one: int, other: int, reason: int) -> None:
        """Hang the proof tree of one visit under the other."""
        above, below, why = self._above, other, reason
        while True:
            up, old = above[one]
            above[one] = (below, why)
            if up == one:
                return
            below, why, one = one, old, up

    def _unlink(self, p: int) -> list[int]:
        """Take away the links of the gateways of a place; return their travels."""
        base, moved = p * self.walk.width, list[int]()
        for gate in range(base, base + self.walk.sizes[p]):
            link = self.links.pop(gate, None)
            if link is not None:
                self.links.pop(link.far, None)
                moved.append(link.travel)
        return moved

    def _join(self, travel: int) -> None:
        walk = self.walk
        depart, came = walk.depart[travel - 1], walk.came[travel]
        if depart is None or came is None:
            return
        start = self._end(travel - 1, depart)
        end = self._end(travel, came)
        if start == end:
            raise ClashError(walk.told_by(travel) | self.explain(travel - 1, travel))
        known = (self.links.get(start), self.links.get(end))
        if known[0] is None and known[1] is None:
            self.links[start] = Link(end, travel, travel - 1, travel)
            self.links[end] = Link(start, travel, travel, travel - 1)
            return
        ends = ((start, travel - 1, travel), (end, travel, travel - 1))
        for (_gate, here, there), link in zip(ends, known, strict=True):
            far = end if here < there else start
            if link is not None and link.far != far:
                mine, theirs = self._dlp(travel, there), self._dlp(link.travel, link.there)
                why = walk.told_by(travel) | walk.told_by(link.travel)
                why |= self.explain(here, link.here)
                self._waiting.append((there, link.there, theirs - mine, why))

    def _dlp(self, travel: int, visit: int) -> int:
        """Return the gateway of a travel at one of its ends, as a dlp of that visit."""
        dlp = self.walk.came[visit] if visit == travel else self.walk.depart[visit]
        return dlp if dlp is not None else 0

    def _end(self, v: int, k: int) -> int:
        p = self.place[v]
        return p * self.walk.width + (k + self.turn[v]) % self.walk.sizes[p]

    def _check_refused(self) -> None:
        for one, other, turn, reason in self.refused:
            p = self.place[one]
            if p == self.place[other]:
                size = self.walk.sizes[p]
                if not size or (self.turn[one] - self.turn[other] - turn) % size == 0:
                    raise ClashError(reason | self.explain(one, other))
        for one, other, reason in self.apart:
            if self.place[one] == self.place[other]:
                raise ClashError(reason | self.explain(one, other))

    def _check_order(self) -> None:
        """Follow each path from its end, then those that have none.

        Raises
        ------
        ClashError : a place comes after itself.
        """
        links, width = self.links, self.walk.width
        todo = dict.fromkeys(links)
        opposites = [star.opposites for star in self.walk.stars]

        def straight(gate: int) -> int:
            p = gate // width
            return p * width + opposites[p][gate - p * width]

        ends = [gate for gate in links if straight(gate) not in links]
        for start in [*ends, *links]:
            if start not in todo:
                continue
            chain, seen, gate = list[Link](), {start // width: 0}, start
            while gate in links:
                link = links[gate]
                todo.pop(gate, None)
                todo.pop(link.far, None)
                chain.append(link)
                p = link.far // width
                if p in seen:
                    raise ClashError(self._explain_chain(chain[seen[p] :], closed=True))
                seen[p] = len(chain)
                gate = straight(link.far)

    def _explain_chain(self, chain: Sequence[Link], *, closed: bool) -> int:
        """Return why links follow one another; closed if the last leads back to the first."""
        reason = 0
        for link in chain:
            reason |= self.walk.told_by(link.travel)
        following = [*chain[1:], chain[0]] if closed else chain[1:]
        for link, after in zip(chain, following, strict=False):
            reason |= self.explain(link.there, after.here)
        return reason

    def explain_cycle(self, chain: Sequence[Link]) -> int:
        """Return why links lead round to where the first begins."""
        return self._explain_chain(chain, closed=True)
