"""The minimal maps of long walks: a lean program, closed candidates, and planarity on demand.

A twin of the axiom files for walks with one reading a visit; tests hold both equal. Three things
make it reach further. Where a visit may be is worked out beforehand: what making two visits one
place leads to must not clash by itself. The paths are counted by their open ends, and their order
is held by labels and an acyclicity check, instead of by deriving who passes through where. And a
map that is not planar is refuted with a reason that covers many maps.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from hssh_kb.congruence import Assumption
from hssh_kb.crossings import explain_odd_pair, find_candidates, find_cycles, find_odd_pairs
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.merging import ClashError, Merging, Walk
from hssh_kb.program import make_converter
from hssh_kb.ranking import measure_map
from hssh_kb.solver import Models, Symbol, solve_best_refuting

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
_PAIRS_READ = 4
"""So many pairs of cycles that cross oddly are asked for a reason; the shortest is learned."""


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
        judge.refute if judge else lambda _: None,
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


class _PlanarJudge:
    """Refutes maps that are not planar."""

    def __init__(self, merging: Merging) -> None:
        self.merging = merging

    def refute(self, symbols: Sequence[Symbol]) -> list[Symbol] | None:
        """Return atoms of a map that no planar map has together; None if the map is planar.

        Two cycles cross oddly because some visits are one place, and because no further places
        are: where these visits stay at the places they are at, none of those become one.
        """
        walk = self.merging.walk
        merging = self.merging.copy()
        chosen = {}
        try:
            for symbol in symbols:
                v, p, turn = (argument.number for argument in symbol.arguments)
                chosen[v] = symbol
                if p < v:
                    merging.align(v, p, turn, 1 << (walk.first_decision + v))
        except ClashError as clash:
            return [chosen[v] for v in _decided(walk, clash.reason)]
        best: set[int] | None = None
        for one, other in find_odd_pairs(find_cycles(merging))[:_PAIRS_READ]:
            visits = set(_decided(walk, explain_odd_pair(merging, one, other)))
            for candidate in find_candidates(merging, one, other):
                for place in candidate[:2]:
                    corners = (cycle.corners.get(place) for cycle in (one, other))
                    visits |= {corner.visit for corner in corners if corner is not None}
            if best is None or len(visits) < len(best):
                best = visits
        return None if best is None else [chosen[v] for v in sorted(best)]


def _decided(walk: Walk, reason: int) -> list[int]:
    """Return the visits whose places a reason rests on."""
    return [v for v in range(walk.count) if reason >> (walk.first_decision + v) & 1]
