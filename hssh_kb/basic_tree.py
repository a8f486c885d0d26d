"""All maps of a basic experience by depth-first growth: the quick twin of ``axioms/basic.lp``.

A map grows moment by moment; what an axiom refuses once stays refused, so each branch ends where
its first violation is. Tests hold the programs, this, and a brute-force search equal.

Source: Beeson 2008, Algorithm 3.1; the incremental form is ours.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

_LOOK_EVERY = 256
Move = tuple[Hashable, str]


@dataclass(frozen=True)
class _Grown:
    """What the map says so far; never changed, only grown into another.

    Attributes
    ----------
    leads : (dstate, action) -> dstate. place : dstate -> name of its place. way : dstate ->
        (name of its path, 1 or -1 for its direction). travels : (dstate, dstate) pairs.
    """

    leads: dict[tuple[int, Hashable], int]
    place: dict[int, int]
    way: dict[int, tuple[int, int]]
    travels: tuple[tuple[int, int], ...]

    def add(self, q: int, move: Move, r: int) -> _Grown | None:
        """Return the map with one more schema; None if it violates an axiom."""
        name, kind = move
        place, way, travels = self.place, self.way, self.travels
        if r not in place:
            place, way = {**place, r: r}, {**way, r: (r, 1)}
        if kind == "travel":
            travels = (*travels, (q, r))
        else:
            place = _unite_places(place, q, r)
        if kind != "turn":
            united = _unite_ways(way, q, r, 1 if kind == "travel" else -1)
            if united is None:
                return None
            way = united
        return _Grown({**self.leads, (q, name): r}, place, way, travels)

    def holds(self, *, order: bool) -> bool:
        """Return whether axiom 16 and, if asked, axiom 8 hold."""
        if len({(self.place[q], way) for q, way in self.way.items()}) < len(self.way):
            return False
        return not order or not self._has_circle()

    def _has_circle(self) -> bool:
        """Return whether some place precedes itself on some path."""
        after: dict[tuple[int, int], set[tuple[int, int]]] = {}
        for q, r in self.travels:
            path, sign = self.way[q]
            one, other = (path, self.place[q]), (path, self.place[r])
            if sign < 0:
                one, other = other, one
            after.setdefault(one, set()).add(other)
        before = dict.fromkeys(after, 0)
        for nodes in after.values():
            for node in nodes:
                before[node] = before.get(node, 0) + 1
        free = [node for node, count in before.items() if not count]
        left = len(before)
        while free:
            left -= 1
            for node in after.get(free.pop(), ()):
                before[node] -= 1
                if not before[node]:
                    free.append(node)
        return left > 0


def _unite_places(place: dict[int, int], q: int, r: int) -> dict[int, int]:
    keep, gone = sorted((place[q], place[r]))
    if keep == gone:
        return place
    return {x: keep if p == gone else p for x, p in place.items()}


def _unite_ways(
    way: dict[int, tuple[int, int]], q: int, r: int, sign: int
) -> dict[int, tuple[int, int]] | None:
    """Put q and r along one path, in the same direction or (-1) opposite ones; None if not so."""
    (keep, one), (gone, other) = way[q], way[r]
    turn = one * other * sign
    if keep == gone:
        return way if turn == 1 else None
    return {x: (keep, s * turn) if path == gone else (path, s) for x, (path, s) in way.items()}


class BasicTree:
    """Grows the maps of a basic experience.

    Parameters
    ----------
    views : one a moment. moves : what was done between: (name, kind), kind being "travel",
        "turn around" or "turn"; equal names at one dstate lead to one dstate.
    order : whether axiom 8 holds.
    limit, end : at most so many maps, and not beyond this instant (``time.monotonic``).
    """

    def __init__(
        self,
        views: Sequence[Hashable],
        moves: Sequence[Move],
        *,
        order: bool = True,
        limit: int | None = None,
        end: float | None = None,
    ) -> None:
        self.views, self.moves, self.order = views, moves, order
        self.limit, self.end, self.nodes = limit, end, 0
        self.found: list[tuple[int, ...]] = []

    def run(self) -> bool:
        """Fill ``found``; return whether all maps were found."""
        waiting = [self.start()]
        while waiting:
            dstates, grown = waiting.pop()
            self.nodes += 1
            late = self.end is not None and self.nodes % _LOOK_EVERY == 0
            if late and self.end is not None and time.monotonic() > self.end:
                return False
            if len(dstates) == len(self.views):
                if self.limit is not None and len(self.found) >= self.limit:
                    return False
                self.found.append(dstates)
                continue
            waiting.extend(self.grow(dstates, grown))
        return True

    def start(self) -> tuple[tuple[int, ...], _Grown]:
        """Return the map of the first moment."""
        return (0,), _Grown({}, {0: 0}, {0: (0, 1)}, ())

    def grow(
        self, dstates: tuple[int, ...], grown: _Grown
    ) -> Iterator[tuple[tuple[int, ...], _Grown]]:
        """Yield the maps of one moment more that grow from a map."""
        i = len(dstates)
        q, move = dstates[-1], self.moves[i - 1]
        known = grown.leads.get((q, move[0]))
        if known is not None:
            if self.views[known] == self.views[i]:
                yield (*dstates, known), grown
            return
        alike = {r for r in dstates if self.views[r] == self.views[i]}
        for r in (*sorted(alike), i):
            further = grown.add(q, move, r)
            if further is not None and further.holds(order=self.order):
                yield (*dstates, r), further
