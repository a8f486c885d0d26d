"""The minimal maps of long walks: a lean program, closed candidates, and planarity on demand.

A twin of the axiom files for walks with one reading a visit; tests hold both equal. Three things
make it reach further. Where a visit may be is worked out beforehand: what making two visits one
place leads to must not clash by itself. The paths are counted by their open ends, and their order
is held by labels and an acyclicity check, instead of by deriving who passes through where. And a
map that is not planar is refuted with a reason that covers many maps.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from hssh_kb.congruence import Assumption
from hssh_kb.crossings import Cycle, find_cycles, find_odd_pairs
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.merging import ClashError, Merging, Walk
from hssh_kb.program import make_converter
from hssh_kb.ranking import measure_map
from hssh_kb.solver import Atom, Models, solve_best_refuting

_RULES = """
1 { place(V,P,O) : offered(V,P,O) } 1 :- visit(V).
first(P) :- place(P,P,0).
:- place(V,P,O), P < V, not first(P).

% The gateways through which travel V leaves and comes in; a gateway has one other end.
out(V+1,P,(K+O)\\M) :- place(V,P,O), departs(V,K), size(V,M).
in(V,P,(K+O)\\M) :- place(V,P,O), came(V,K), size(V,M).
joined(P,K,P',K') :- out(T,P,K), in(T,P',K').
joined(P',K',P,K) :- joined(P,K,P',K').
linked(P,K) :- joined(P,K,P',K').
:- linked(P,K), 2 { joined(P,K,P',K') }.
:- joined(P,K,P,K).

% Each travel is on a path, named after one of its travels. A place is on a path at most once.
1 { along(T,H) : came(H,K), H <= T } 1 :- came(T,K').
:- along(T,H), not along(H,H).
local(P,K,K) :- opposite(P,K,K'), K < K'.
local(P,K,K') :- opposite(P,K,K'), K' < K.
label(P,L,H) :- out(T,P,K), local(P,K,L), along(T,H).
label(P,L,H) :- in(T,P,K), local(P,K,L), along(T,H).
:- local(P,L,L), 2 { label(P,L,H) }.
:- visit(P), along(H,H), 2 { label(P,L,H) }.
#edge ((P,K),(P',K'')) : joined(P,K,P',K'), opposite(P',K',K'').

% Dlp K of visit V is dlp K+R of visit V' (which is earlier).
aligned(V,V',(O+M-O')\\M) :- place(V,P,O), place(V',P,O'), offered(V,V',(O+M-O')\\M), size(V,M).

at(V,P) :- place(V,P,O).
:- same(V,V'), at(V,P), not at(V',P).
:- different(V,V'), at(V,P), at(V',P).
#defined same/2.
#defined different/2.
#defined came/2.
#defined departs/2.
#defined opposite/3.

end(P,K) :- first(P), opposite(P,K,K'), not linked(P,K).
#show place/3.
"""
_COUNTS = {"paths": "1@{},P,K : end(P,K)", "places": "1@{},P : first(P)"}
_LEVELS = {
    "paths-then-places": ("paths", "places"),
    "places-then-paths": ("places", "paths"),
    "places-only": ("places",),
}
_OPTIONS = ("--opt-strategy=usc,k",)
_PAIRS_READ = 12
"""So many pairs of cycles that cross oddly give a reason, the shortest first."""


def search_lean(
    experience: Experience,
    count: int,
    policy: str,
    planarity: bool,
    limit: int | None,
    budget_s: float | None,
    supposed: Sequence[Assumption] = (),
) -> Models[Hypothesis]:
    """Find the maps of the first visits that cost least, all that tie.

    Parameters
    ----------
    experience : one reading a visit, path types told everywhere or nowhere.
    count, policy, planarity, limit, budget_s, supposed : as in
        :func:`hssh_kb.maps.minimal_maps`.
    """
    begun = replace(experience, visits=experience.visits[:count])
    walk = Walk(begun, 0)
    merging = Merging(walk)
    try:
        merging.take(range(1, count))
    except ClashError:
        return Models((), complete=True)
    levels = _LEVELS[policy]
    lines = [_RULES, *_describe(walk), *_offer(merging)]
    lines += [f"#minimize {{ {_COUNTS[what].format(9 - i)} }}." for i, what in enumerate(levels)]
    lines += [f"#minimize {{ 0@{9 - i} : #true }}." for i in range(len(levels))]
    lines += [f"{'same' if a.same else 'different'}({a.one},{a.other})." for a in supposed]
    judge = _PlanarJudge(merging) if planarity else None
    models = solve_best_refuting(
        "\n".join(lines),
        make_converter(count, readings=False),
        ("place", 3),
        ("aligned", 3),
        judge.refute if judge else lambda _: (),
        limit=limit,
        budget_s=budget_s,
        options=_OPTIONS,
    )
    cost = measure_map(begun, models.found[0], policy) if models.found else ()
    return replace(models, cost=cost)


def _describe(walk: Walk) -> Iterable[str]:
    for v, star in enumerate(walk.stars):
        yield f"visit({v}). size({v},{len(star)}). offered({v},{v},0)."
        for k, opposite in enumerate(star.opposites):
            yield f"opposite({v},{k},{opposite})."
        if v + 1 < walk.count and walk.depart[v] is not None:
            yield f"departs({v},{walk.depart[v]})."
        if walk.came[v] is not None:
            yield f"came({v},{walk.came[v]})."


def _offer(merging: Merging) -> Iterable[str]:
    """Yield where each visit may be: wherever what follows does not clash by itself."""
    walk = merging.walk
    for v in range(walk.count):
        for p in range(v):
            for turn in walk.turns(v, p):
                try:
                    merging.copy().align(v, p, turn, 0)
                except ClashError:
                    continue
                yield f"offered({v},{p},{turn})."


class _Corner(NamedTuple):
    """A corner of a cycle: visits come to and left from; dlps between and used, as bits.

    The dlps are those of the visit left from.
    """

    came: int
    left: int
    between: int
    used: int


class _PlanarJudge:
    """Refutes maps that are not planar."""

    def __init__(self, merging: Merging) -> None:
        self.merging, self.walk = merging, merging.walk

    def refute(self, places: Sequence[tuple[int, ...]]) -> list[list[tuple[Atom, bool]]]:
        """Return what cannot be true together in a planar map; nothing if the map is planar.

        Two cycles cross oddly as long as their travels follow one another, the corners that cross
        stay aligned, and no others come to do so.
        """
        merging = self.merging.copy()
        for v, p, turn in places:
            if p < v:
                merging.align(v, p, turn, 0)
        reasons = []
        for one, other in find_odd_pairs(find_cycles(merging))[:_PAIRS_READ]:
            corners = self._read(merging, one), self._read(merging, other)
            atoms = [self._align(merging, a, b) for part in corners for a, b, *_ in part if a != b]
            reason = [(atom, True) for atom in atoms]
            for _, u, between, _ in corners[0]:
                for _, w, _, used in corners[1]:
                    reason += self._cross(merging, u, between, w, used)
            reasons.append(reason)
        return sorted(reasons, key=len)

    def _read(self, merging: Merging, cycle: Cycle) -> list[_Corner]:
        found = []
        for before, after in zip([cycle.chain[-1], *cycle.chain[:-1]], cycle.chain, strict=True):
            u = after.here
            corner, size = cycle.corners[merging.place[u]], self.walk.sizes[u]
            back = -merging.turn[u] % size
            between, used = (_rotate(bits, back, size) for bits in (corner.between, corner.used))
            found.append(_Corner(before.there, u, between, used))
        return found

    def _align(self, merging: Merging, a: int, b: int) -> Atom:
        """Return the atom that says how two visits of one place are aligned."""
        v, w = max(a, b), min(a, b)
        return "aligned", (v, w, (merging.turn[v] - merging.turn[w]) % self.walk.sizes[v])

    def _cross(
        self, merging: Merging, u: int, between: int, w: int, used: int
    ) -> Iterator[tuple[Atom, bool]]:
        """Yield the alignments of two corners in which they cross, and whether they hold."""
        if u == w:
            return
        size = self.walk.sizes[u]
        held = self._align(merging, u, w) if merging.place[u] == merging.place[w] else None
        for turn in self.walk.turns(u, w):
            if (_rotate(between, turn, size) & used).bit_count() & 1:
                later = (u, w, turn) if u > w else (w, u, -turn % size)
                yield ("aligned", later), ("aligned", later) == held


def _rotate(bits: int, turn: int, size: int) -> int:
    """Return bits moved up by a turn, round a star."""
    return (bits << turn | bits >> (size - turn)) & ((1 << size) - 1)
