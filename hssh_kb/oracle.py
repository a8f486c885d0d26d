"""May these observations and assumptions hold together? Quick where it can be, exact always."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from math import log
from typing import NamedTuple

from hssh_kb.congruence import Assumption
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.search_budget import tell_rest
from hssh_kb.solver import Symbol, solve_best
from hssh_kb.subsets import OutOfTimeError
from hssh_kb.witness import WitnessSearch


class Literal(NamedTuple):
    """Something that may be dropped to make an experience and its assumptions consistent.

    ``kind`` is "assumption" (``number`` into the assumptions), "star" (what was seen at a visit)
    or "travel" (the travel that led to a visit).
    """

    kind: str
    number: int


AXIOMS = (
    "star_isomorphism",
    "path_types",
    "travel_function",
    "reversibility",
    "order_irreflexive",
    "planarity",
)
"""The axioms by which a map can fail; the others hold by the way a map is written down."""

_PRICE_SCALE = 1000


def assumption_facts(assumptions: Iterable[tuple[int, Assumption]]) -> str:
    """Return assumptions as facts of ``axioms/assume.lp``."""
    return "".join(
        f"assumed_{'same' if a.same else 'different'}({i},{a.one},{a.other}).\n"
        for i, a in assumptions
    )


def list_literals(experience: Experience, assumptions: Sequence[Assumption]) -> list[Literal]:
    """Return all that may be dropped, what is near the assumptions first."""
    count = len(experience)
    near = [v for a in assumptions for v in (a.one, a.other)]

    def distance(v: int) -> int:
        return min((abs(v - w) for w in near), default=v)

    visits = sorted(range(count), key=lambda v: (distance(v), v))
    observed = []
    for v in visits:
        observed.append(Literal("star", v))
        if v:
            observed.append(Literal("travel", v))
    return [Literal("assumption", i) for i in range(len(assumptions))] + observed


class Oracle:
    """Answers whether a set of literals has a map.

    What is consistent stays so with fewer literals, and what is not stays so with more; so answers
    already found often say enough.

    Parameters
    ----------
    experience, assumptions : what was lived through and what is supposed.
    planarity : whether this axiom holds.
    end : instant (``time.monotonic``) at which to give up.
    """

    def __init__(
        self,
        experience: Experience,
        assumptions: Sequence[Assumption],
        *,
        planarity: bool = True,
        end: float | None = None,
    ) -> None:
        self.experience, self.assumptions = experience, assumptions
        self.planarity, self.end = planarity, end
        self.cores: list[frozenset[Literal]] = []
        self._good: list[frozenset[Literal]] = []
        self._searches: dict[tuple[tuple[int, int], ...], WitnessSearch] = {}
        self._refuted: list[_Refuted] = []

    def literals(self) -> list[Literal]:
        """Return all literals, those near the assumptions first."""
        return list_literals(self.experience, self.assumptions)

    def consistent(self, active: frozenset[Literal]) -> bool:
        """Return whether some map agrees with these literals.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        """
        if any(core <= active for core in self.cores):
            return False
        return any(active <= good for good in self._good) or self.find_map(active) is not None

    def find_map(self, active: frozenset[Literal]) -> Hypothesis | None:
        """Return some map that agrees with these literals, or None if there is none.

        The likeliest choice of readings is tried first. A choice that has no map tells which of the
        readings are to blame, and the next choice is the likeliest that avoids all that is known.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        """
        stars = frozenset(x.number for x in active if x.kind == "star")
        known = [one for one in self._refuted if one.literals <= active]
        chosen = self._choose_readings(known)
        while chosen is not None:
            if self.end is not None and time.monotonic() >= self.end:
                raise OutOfTimeError
            found = self._search(chosen).run(
                stars,
                [x.number for x in active if x.kind == "travel"],
                [x.number for x in active if x.kind == "assumption"],
            )
            if not isinstance(found, int):
                self._good.append(active)
                return found
            blamed = self._read_reason(found)
            held = {x.number: chosen.get(x.number, 0) for x in blamed if x.kind == "star"}
            self._refuted.append(_Refuted(held, blamed))
            known = [one for one in self._refuted if one.literals <= active]
            chosen = self._choose_readings(known)
        self.cores.append(frozenset().union(*(one.literals for one in known)))
        return None

    def _search(self, chosen: dict[int, int]) -> WitnessSearch:
        key = tuple(sorted(chosen.items()))
        if key not in self._searches:
            self._searches[key] = WitnessSearch(
                self.experience,
                self.assumptions,
                readings=chosen,
                planarity=self.planarity,
                end=self.end,
            )
        return self._searches[key]

    def _read_reason(self, reason: int) -> frozenset[Literal]:
        count = len(self.experience)
        literals = []
        for i in range(2 * count + len(self.assumptions)):
            if reason >> i & 1:
                kind = ("star", "travel")[i // count] if i < 2 * count else "assumption"
                literals.append(Literal(kind, i % count if i < 2 * count else i - 2 * count))
        return frozenset(literals)

    def _choose_readings(self, refuted: Sequence[_Refuted]) -> dict[int, int] | None:
        """Return the likeliest readings that no refutation known holds for; None if there are none.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        """
        if not refuted:
            return {}
        visits = sorted({v for one in refuted for v in one.readings if self._several(v)})
        if any(not any(map(self._several, one.readings)) for one in refuted):
            return None
        lines = []
        for v in visits:
            readings = self.experience.visits[v].readings
            lines.append(f"1 {{ reading({v},0..{len(readings) - 1}) }} 1.")
            prices = [round(-_PRICE_SCALE * log(reading.weight)) for reading in readings]
            lines += [f":~ reading({v},{r}). [{price},{v}]" for r, price in enumerate(prices)]
        for one in refuted:
            body = ", ".join(
                f"reading({v},{r})" for v, r in sorted(one.readings.items()) if self._several(v)
            )
            lines.append(f":- {body}.")
        rest = tell_rest(self.end)
        program = "\n".join([*lines, "#show reading/2."])
        best = solve_best(program, _read_choice, limit=1, budget_s=rest)
        if best.found:
            return {v: r for v, r in best.found[0].items() if r}
        if not best.complete:
            raise OutOfTimeError
        return None

    def _several(self, v: int) -> bool:
        return len(self.experience.visits[v].readings) > 1


class _Refuted(NamedTuple):
    """Readings (visit -> reading) that have no map together with some literals."""

    readings: dict[int, int]
    literals: frozenset[Literal]


def _read_choice(symbols: Sequence[Symbol]) -> dict[int, int]:
    return {s.arguments[0].number: s.arguments[1].number for s in symbols}
