"""A brute-force twin of the theory in plain Python: no solver, no code shared with the product.

It walks the tree of maps visit by visit (Beeson 2008, Algorithm 8.1) on bare tuples: a visit is a
list of readings, a reading is ``(alpha, opposite, arrive, depart)``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

Gate = tuple[int, int]


class Reading(NamedTuple):
    alpha: tuple[int, ...]
    opposite: tuple[int, ...]
    arrive: int | None
    depart: int | None


class Map(NamedTuple):
    visits: tuple[int, ...]
    offsets: tuple[int, ...]
    readings: tuple[int, ...]


def plain(experience) -> list[list[Reading]]:
    """Strip an Experience to bare tuples."""
    out = []
    for visit in experience.visits:
        readings = []
        for reading in visit.readings:
            texts = [str(dlp) for dlp in reading.star.dlps]
            opposite = []
            for text in texts:
                other = text[:-2] + ("-" if text[-2] == "+" else "+")
                opposite.append(next(i for i, t in enumerate(texts) if t[:-1] == other))
            alpha = tuple(int(text[-1]) for text in texts)
            readings.append(Reading(alpha, tuple(opposite), reading.arrive, reading.depart))
        out.append(readings)
    return out


def rotations(one: Reading, other: Reading) -> list[int]:
    """All r that carry dlp k of ``one`` to dlp k + r of ``other`` and keep everything."""
    m = len(one.alpha)
    if m != len(other.alpha):
        return []
    return [
        r
        for r in range(m)
        if all(
            one.alpha[k] == other.alpha[(k + r) % m]
            and (one.opposite[k] + r) % m == other.opposite[(k + r) % m]
            for k in range(m)
        )
    ]


class Twin:
    """Depth-first search over all maps."""

    def __init__(self, visits: list[list[Reading]], *, order: bool = True, planarity: bool = True):
        self.visits, self.order, self.planarity = visits, order, planarity
        self.place: list[int] = []
        self.offset: list[int] = []
        self.reading: list[int] = []
        self.link: dict[Gate, Gate] = {}
        self.deepest = 0

    def maps(self) -> Iterator[Map]:
        yield from self._grow(0)

    def _star(self, p: int) -> Reading:
        return self.visits[p][self.reading[p]]

    def _gate(self, v: int, k: int) -> Gate:
        p = self.place[v]
        return p, (k + self.offset[v]) % len(self._star(p).alpha)

    def _grow(self, v: int) -> Iterator[Map]:
        self.deepest = max(self.deepest, v)
        if v == len(self.visits):
            yield Map(tuple(self.place), tuple(self.offset), tuple(self.reading))
            return
        for index, reading in enumerate(self.visits[v]):
            options = [(v, 0)]
            for p in sorted(set(self.place)):
                options += [(p, r) for r in rotations(reading, self._star(p))]
            for p, r in options:
                self.place.append(p)
                self.offset.append(r)
                self.reading.append(index)
                yield from self._try(v, reading)
                self.place.pop()
                self.offset.pop()
                self.reading.pop()

    def _try(self, v: int, reading: Reading) -> Iterator[Map]:
        if v == 0:
            yield from self._grow(1)
            return
        before = self.visits[v - 1][self.reading[v - 1]]
        out = self._gate(v - 1, before.depart)
        into = self._gate(v, reading.opposite[reading.arrive])
        if into == out:
            return
        if self.link.get(out, into) != into or self.link.get(into, out) != out:
            return
        known = out in self.link
        self.link[out], self.link[into] = into, out
        if known or self._holds():
            yield from self._grow(v + 1)
        if not known:
            del self.link[out], self.link[into]

    def _holds(self) -> bool:
        if self.order and not self._order_holds():
            return False
        return not self.planarity or self._euler() == 2

    def _order_holds(self) -> bool:
        for start in self.link:
            seen, gate = {start[0]}, start
            while gate in self.link:
                p, k = self.link[gate]
                if p in seen:
                    return False
                seen.add(p)
                gate = (p, self._star(p).opposite[k])
        return True

    def _euler(self) -> int:
        """V - E + F of the map drawn so far; a gateway not joined yet is a stub."""
        places = set(self.place)
        edges = {frozenset(pair) for pair in self.link.items()}
        todo = {(p, k) for p in places for k in range(len(self._star(p).alpha))}
        faces = 0
        while todo:
            start = gate = todo.pop()
            faces += 1
            while True:
                p, k = self.link.get(gate, gate)
                gate = (p, (k + 1) % len(self._star(p).alpha))
                if gate == start:
                    break
                todo.remove(gate)
        return len(places) - len(edges) + faces


def names(visits: list[list[Reading]], m: Map) -> tuple[frozenset, frozenset, frozenset]:
    """The paths, places and unlikely readings of a map, by the names that minimality compares.

    A path is named after its first place and the lesser of its two dlps there.
    """
    stars = {p: visits[p][m.readings[p]] for p in set(m.visits)}
    parent = {
        (p, k): (p, min(k, star.opposite[k]))
        for p, star in stars.items()
        for k in range(len(star.alpha))
    }

    def find(x):
        while parent[x] != x:
            x = parent[x]
        return x

    for v in range(1, len(visits)):
        before, now = visits[v - 1][m.readings[v - 1]], visits[v][m.readings[v]]
        ends = []
        for w, k in ((v - 1, before.depart), (v, now.arrive)):
            p = m.visits[w]
            ends.append(find((p, (k + m.offsets[w]) % len(stars[p].alpha))))
        parent[max(ends)] = min(ends)
    paths = frozenset(find(x) for x in parent)
    return paths, frozenset(stars), frozenset((v, r) for v, r in enumerate(m.readings) if r)


def count(visits: list[list[Reading]], m: Map) -> tuple[int, int]:
    """(paths, places) of a map, by union of local-paths."""
    paths, places, _ = names(visits, m)
    return len(paths), len(places)


def all_maps(visits, **keywords) -> set[Map]:
    return set(Twin(visits, **keywords).maps())


def best_maps(visits, **keywords) -> tuple[tuple[int, int] | None, set[Map]]:
    """The maps of fewest paths, then fewest places."""
    costs = {m: count(visits, m) for m in all_maps(visits, **keywords)}
    if not costs:
        return None, set()
    best = min(costs.values())
    return best, {m for m, cost in costs.items() if cost == best}


def subset_minimal(visits, **keywords) -> set[Map]:
    """The maps that no other is preferred to: the first level that differs has a proper part."""
    named = {m: names(visits, m) for m in all_maps(visits, **keywords)}

    def preferred(one, other) -> bool:
        for mine, theirs in zip(one, other, strict=True):
            if mine != theirs:
                return mine < theirs
        return False

    values = set(named.values())
    return {m for m, n in named.items() if not any(preferred(other, n) for other in values)}
