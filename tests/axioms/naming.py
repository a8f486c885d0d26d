"""The words of equations 1 to 10 for one map, in plain Python: the twin of ``axioms/named.lp``."""

from __future__ import annotations

from itertools import product

from brute_force import Map, Reading

Dstate = tuple[int, int]


def _q(dstate: Dstate) -> str:
    return f"q({dstate[0]},{dstate[1]})"


class NamedMap:
    """Places, dstates, paths and orders of a map; ``atoms`` has them as the programs write them."""

    def __init__(self, visits: list[list[Reading]], m: Map):
        self.stars = {p: visits[p][m.readings[p]] for p in sorted(set(m.visits))}
        self.dstates = [(p, k) for p, star in self.stars.items() for k in range(len(star.alpha))]
        self.travels = []
        for v in range(1, len(visits)):
            before, now = visits[v - 1][m.readings[v - 1]], visits[v][m.readings[v]]
            self.travels.append(
                (self._dstate(m, v - 1, before.depart), self._dstate(m, v, now.arrive))
            )
        self._find_ways()
        self.atoms = {*self._local(), *self._along()}

    def _dstate(self, m: Map, v: int, k: int) -> Dstate:
        p = m.visits[v]
        return p, (k + m.offsets[v]) % len(self.stars[p].alpha)

    def turn_around(self, q: Dstate) -> Dstate:
        return q[0], self.stars[q[0]].opposite[q[1]]

    def _find_ways(self) -> None:
        """Which dstates are along one directed path: joined by travel, there or back."""
        way = {q: q for q in self.dstates}

        def join(q: Dstate, r: Dstate) -> None:
            old, new = way[q], way[r]
            for x, y in way.items():
                if y == old:
                    way[x] = new

        for q, r in self.travels:
            join(q, r)
            join(self.turn_around(q), self.turn_around(r))
        self.way = way

    def _local(self) -> set[str]:
        atoms = {"opposite_direction(plus,minus)", "opposite_direction(minus,plus)"}
        atoms |= {"is_travel(travel)", "is_turn_around(turn_around)", "is_turn(turn_around)"}
        for p, star in self.stars.items():
            size = len(star.alpha)
            atoms.add(f"star_size({p},{size})")
            for k in range(size):
                q, back = _q((p, k)), star.opposite[k]
                atoms |= {f"dstate({q})", f"at({q},{p})", f"opposite_dlp({p},{k},{back})"}
                atoms.add(f"schema({q},turn_around,{_q((p, back))})")
                for n in range(1, size):
                    if (k + n) % size != back:
                        atoms.add(f"schema({q},turn({n}),{_q((p, (k + n) % size))})")
                        atoms.add(f"is_turn(turn({n}))")
        return atoms | {f"schema({_q(q)},travel,{_q(r)})" for q, r in self.travels}

    def _along(self) -> set[str]:
        atoms: set[str] = set()
        directed: set[tuple[str, str, int, int]] = set()
        reverse = {"plus": "minus", "minus": "plus"}
        names: dict[Dstate, set[tuple[str, str]]] = {q: set() for q in self.dstates}
        for q in self.dstates:
            same = [r for r in self.dstates if self.way[r] == self.way[q]]
            if min([*same, *map(self.turn_around, same)]) == q:
                for r in same:
                    names[r].add((f"path({q[0]},{q[1]})", "plus"))
                    names[self.turn_around(r)].add((f"path({q[0]},{q[1]})", "minus"))
        for q, told in names.items():
            for path, d in told:
                atoms |= {f"along({_q(q)},{path},{d})", f"on({path},{q[0]})"}
        for q, r in self.travels:
            for path, d in names[q]:
                directed |= {(path, d, q[0], r[0]), (path, reverse[d], r[0], q[0])}
        grown = True
        while grown:
            further = {
                (path, d, a, c)
                for (path, d, a, b), (other, e, b2, c) in product(directed, repeat=2)
                if (path, d, b) == (other, e, b2)
            }
            grown = not further <= directed
            directed |= further
        return atoms | {f"order({path},{d},{a},{b})" for path, d, a, b in directed}
