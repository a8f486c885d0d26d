"""May these literals hold together? By trying every map, for the smallest walks only."""

from __future__ import annotations

from itertools import product

from brute_force import Reading, rotations


class Force:
    """All placements of the visits of a walk, each with one reading.

    ``assumptions`` are (visit, visit, same). Literals are ("assumption", i), ("star", v) and
    ("travel", v), the travel that led to visit v.
    """

    def __init__(self, visits: list[list[Reading]], assumptions, *, planarity: bool = True):
        self.stars = [readings[0] for readings in visits]
        self.assumptions, self.planarity = assumptions, planarity
        self.placements = list(self._placements())
        self.known: dict[frozenset, bool] = {}

    def literals(self):
        n = len(self.stars)
        out = [("assumption", i) for i in range(len(self.assumptions))]
        return out + [("star", v) for v in range(n)] + [("travel", v) for v in range(1, n)]

    def _placements(self):
        n = len(self.stars)

        def grow(places):
            v = len(places)
            if v == n:
                turns = [
                    range(len(self.stars[w].alpha)) if p != w else (0,)
                    for w, p in enumerate(places)
                ]
                for offsets in product(*turns):
                    yield tuple(places), offsets
                return
            for p in (*sorted(set(places)), v):
                yield from grow([*places, p])

        yield from grow([])

    def consistent(self, active: frozenset) -> bool:
        if active not in self.known:
            self.known[active] = any(self._holds(p, o, active) for p, o in self.placements)
        return self.known[active]

    def _holds(self, places, offsets, active) -> bool:
        for i, (v, w, same) in enumerate(self.assumptions):
            if ("assumption", i) in active and (places[v] == places[w]) != same:
                return False
        n = len(self.stars)
        seen = [v for v in range(n) if ("star", v) in active]
        for v in seen:
            for w in seen:
                if w < v and places[v] == places[w]:
                    m = len(self.stars[v].alpha)
                    turn = (offsets[v] - offsets[w]) % m
                    if turn not in rotations(self.stars[v], self.stars[w]):
                        return False
        link = {}
        opposite = {}
        for v in range(1, n):
            if ("travel", v) not in active or v not in seen or v - 1 not in seen:
                continue
            out = self._dlp(places, offsets, v - 1, self.stars[v - 1].depart)
            into = self._dlp(places, offsets, v, self.stars[v].opposite[self.stars[v].arrive])
            opposite[into] = self._dlp(places, offsets, v, self.stars[v].arrive)
            behind = self.stars[v - 1].opposite[self.stars[v - 1].depart]
            opposite[out] = self._dlp(places, offsets, v - 1, behind)
            if out == into or link.get(out, into) != into or link.get(into, out) != out:
                return False
            link[out], link[into] = into, out
        for start in link:
            passed, gate = {start[0]}, start
            while gate in link:
                if link[gate][0] in passed:
                    return False
                passed.add(link[gate][0])
                gate = opposite[link[gate]]
        return not self.planarity or self._planar(places, seen, link)

    def _dlp(self, places, offsets, v, k):
        return places[v], (k + offsets[v]) % len(self.stars[v].alpha)

    def _planar(self, places, seen, link) -> bool:
        size = {places[v]: len(self.stars[v].alpha) for v in seen}
        todo = {(p, k) for p, m in size.items() for k in range(m)}
        faces = 0
        while todo:
            start = gate = todo.pop()
            faces += 1
            while True:
                p, k = link.get(gate, gate)
                gate = (p, (k + 1) % size[p])
                if gate == start:
                    break
                todo.remove(gate)
        pieces = {p: p for p in size}
        for (p, _), (q, _) in link.items():
            old, new = pieces[p], pieces[q]
            pieces = {r: new if piece == old else piece for r, piece in pieces.items()}
        return len(size) - len(link) // 2 + faces == 2 * len(set(pieces.values()))

    def conflicts_and_repairs(self):
        """All minimal inconsistent sets and all minimal sets to drop, by trying all subsets."""
        literals = self.literals()
        conflicts, repairs = [], []
        subsets = sorted(product((0, 1), repeat=len(literals)), key=sum)
        for mask in subsets:
            chosen = frozenset(x for x, bit in zip(literals, mask, strict=True) if bit)
            if not any(c <= chosen for c in conflicts) and not self.consistent(chosen):
                conflicts.append(chosen)
        for mask in subsets:
            dropped = frozenset(x for x, bit in zip(literals, mask, strict=True) if bit)
            if not any(r <= dropped for r in repairs) and all(c & dropped for c in conflicts):
                repairs.append(dropped)
        return set(conflicts), set(repairs)
