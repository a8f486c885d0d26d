"""May these observations and assumptions hold together? Quick where it can be, exact always."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from heapq import heappop, heappush
from math import log
from typing import NamedTuple

from hssh_kb.congruence import Assumption, Closure
from hssh_kb.experience import Experience, has_types
from hssh_kb.facts import experience_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.planar_search import find_planar_map
from hssh_kb.planarity import is_planar
from hssh_kb.program import make_converter
from hssh_kb.solver import solve_all
from hssh_kb.subsets import OutOfTimeError, shrink_conflict
from hssh_kb.theory import axiom_program, read_programs


class Literal(NamedTuple):
    """Something that may be dropped to make an experience and its assumptions consistent.

    ``kind`` is "assumption" (``number`` into the assumptions), "star" (what was seen at a visit)
    or "travel" (the travel that led to a visit).
    """

    kind: str
    number: int


SEARCH_LIMIT = 30
"""Where planarity decides, at most so many visits are handed to the solver at once."""

_SOON_S, _PATIENCE_S = 0.4, 60.0

AXIOMS = (
    "star_isomorphism",
    "path_types",
    "travel_function",
    "reversibility",
    "order_irreflexive",
    "planarity",
)
"""The axioms by which a map can fail; the others hold by the way a map is written down."""


def assumption_facts(assumptions: Iterable[tuple[int, Assumption]]) -> str:
    """Return assumptions as facts of ``axioms/assume.lp``."""
    return "".join(
        f"assumed_{'same' if a.same else 'different'}({i},{a.one},{a.other}).\n"
        for i, a in assumptions
    )


class Oracle:
    """Answers whether a set of literals has a map.

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
        self.closure = Closure(experience)
        self.certain = all(len(visit.readings) == 1 for visit in experience.visits)
        self.searches = 0
        self.core: frozenset[Literal] | None = None
        self._known: dict[frozenset[Literal], Hypothesis | None] = {}

    def literals(self) -> list[Literal]:
        """Return all literals, those near the assumptions first."""
        count = len(self.experience)
        near = [v for a in self.assumptions for v in (a.one, a.other)]

        def distance(v: int) -> int:
            return min((abs(v - w) for w in near), default=v)

        visits = sorted(range(count), key=lambda v: (distance(v), v))
        observed = []
        for v in visits:
            observed.append(Literal("star", v))
            if v:
                observed.append(Literal("travel", v))
        return [Literal("assumption", i) for i in range(len(self.assumptions))] + observed

    def consistent(self, active: frozenset[Literal]) -> bool:
        """Return whether some map agrees with these literals.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        """
        return self.find_map(active) is not None

    def find_map(self, active: frozenset[Literal]) -> Hypothesis | None:
        """Return some map that agrees with these literals, or None if there is none."""
        if active not in self._known:
            self._known[active] = self._find_map(active)
        return self._known[active]

    def _find_map(self, active: frozenset[Literal]) -> Hypothesis | None:
        least = self._close(active, self.closure)
        if least is None and self.certain:
            return None
        if least is None:
            least = self._close_readings(active)
            if least is None:
                return None
        stars = frozenset(x.number for x in active if x.kind == "star")
        if not self.planarity or is_planar(self.experience, least, stars):
            return least
        return self._search(active)

    def _close(self, active: frozenset[Literal], closure: Closure) -> Hypothesis | None:
        """Return the least map of some literals, planarity left aside."""
        if self.end is not None and time.monotonic() >= self.end:
            raise OutOfTimeError
        stars = frozenset(x.number for x in active if x.kind == "star")
        travels = [x.number for x in active if x.kind == "travel"]
        assumed = [self.assumptions[x.number] for x in active if x.kind == "assumption"]
        return closure.close(stars, travels, assumed)

    def _close_readings(self, active: frozenset[Literal]) -> Hypothesis | None:
        """Return a least map under other readings of the stars; None if no choice has one.

        A choice that clashes shows a minimal conflict; any choice that does better reads some
        visit of that conflict otherwise. So all that need trying are found, likely ones first.
        """
        waiting: list[tuple[float, int, dict[int, int]]] = [(0.0, 0, {})]
        seen: set[tuple[tuple[int, int], ...]] = {()}
        ordered = [x for x in self.literals() if x in active]
        while waiting:
            chosen = heappop(waiting)[2]
            closure = Closure(self.experience, readings=chosen)
            if chosen:
                least = self._close(active, closure)
                if least is not None:
                    return least

            def consistent(some: frozenset[Literal], held: Closure = closure) -> bool:
                return self._close(some, held) is not None

            conflict = shrink_conflict(ordered, consistent)
            for v in sorted(x.number for x in conflict if x.kind == "star"):
                for r in range(len(self.experience.visits[v].readings)):
                    other = {**chosen, v: r}
                    key = tuple(sorted((w, q) for w, q in other.items() if q))
                    if key not in seen:
                        seen.add(key)
                        heappush(waiting, (self._price(other), len(seen), dict(key)))
        return None

    def _price(self, chosen: dict[int, int]) -> float:
        readings = self.experience.visits
        return -sum(log(readings[v].readings[r].weight) for v, r in chosen.items())

    def _search(self, active: frozenset[Literal]) -> Hypothesis | None:
        """Ask the solver: planarity or the choice of readings decides."""
        visits = self.relevant_visits(active)
        if len(visits) > SEARCH_LIMIT:
            return self._search_long(active)
        self.searches += 1
        program = self.program(active, [name for name in AXIOMS if self._holds(name)], visits)
        convert = make_converter(len(self.experience), not self.certain)
        rest = None if self.end is None else max(self.end - time.monotonic(), 0.0)
        found = solve_all(program, convert, limit=1, budget_s=rest)
        if found.found:
            return found.found[0]
        if not found.complete:
            raise OutOfTimeError
        return None

    def relevant_visits(self, active: frozenset[Literal]) -> list[int]:
        """Return the visits that some literals say anything about; the others may be anywhere."""
        visits = {x.number for x in active if x.kind == "star"}
        for x in active:
            if x.kind == "assumption":
                visits |= {self.assumptions[x.number].one, self.assumptions[x.number].other}
        return sorted(visits)

    def _search_long(self, active: frozenset[Literal]) -> Hypothesis | None:
        """Decide a long experience by a small part of it that has no map, or by finding a map.

        A part whose least map is not planar is shrunk until it is smallest; if the solver finds
        that no other map of that part is planar, no map of the whole is. If it finds one, a map of
        the whole is sought in the tree of maps.

        Raises
        ------
        OutOfTimeError : neither came to an end.
        """
        if not self.certain:
            raise OutOfTimeError
        least = self._close(active, self.closure)
        held = [self.assumptions[x.number] for x in active if x.kind == "assumption"]
        whole = len(active) - len(held) == 2 * len(self.experience) - 1  # no observation dropped
        now = time.monotonic()
        rest = (self.end or now + _PATIENCE_S) - now
        if whole and least is not None:
            # Most that has a map shows it soon; so some of the time is given to seek one first.
            soon = now + min(_SOON_S, rest / 2)
            found = find_planar_map(self.experience, held, least, soon)
            if found is not None:
                return found
        ordered = [x for x in self.literals() if x in active]
        core = shrink_conflict(ordered, self._has_planar_closure)
        if len(self.relevant_visits(core)) <= SEARCH_LIMIT and self.find_map(core) is None:
            self.core = core
            return None
        if whole and least is not None:
            found = find_planar_map(self.experience, held, least, now + rest)
            if found is not None:
                return found
        raise OutOfTimeError

    def _has_planar_closure(self, some: frozenset[Literal]) -> bool:
        """Return whether the least map of some literals is planar: it need not be the only one."""
        least = self._close(some, self.closure)
        stars = frozenset(x.number for x in some if x.kind == "star")
        return least is not None and is_planar(self.experience, least, stars)

    def _holds(self, axiom: str) -> bool:
        if axiom == "path_types":
            return has_types(self.experience)
        return self.planarity or axiom != "planarity"

    def program(
        self,
        active: frozenset[Literal],
        axioms: Iterable[str],
        visits: Sequence[int] | None = None,
    ) -> str:
        """Return the strict program of some literals and axioms, over all visits or some."""
        names = ["experience", "generate", "map", "assume", "components", "modes/strict", "show"]
        chosen = range(len(self.experience)) if visits is None else visits
        kept = set(chosen)
        stars = {x.number for x in active if x.kind == "star"}
        travels = {x.number for x in active if x.kind == "travel"}
        doubted = [f"doubtable(star({v}))." for v in chosen if v not in stars]
        doubted += [
            f"doubtable(travel({v}))." for v in chosen if v - 1 in kept and v not in travels
        ]
        held = [(x.number, self.assumptions[x.number]) for x in active if x.kind == "assumption"]
        return "\n".join(
            [
                read_programs([*names, *map(axiom_program, axioms)]),
                experience_to_facts(self.experience, chosen),
                *doubted,
                assumption_facts(sorted(held)),
                *self._candidates(stars, chosen),
            ]
        )

    def _candidates(self, stars: set[int], chosen: Sequence[int]) -> list[str]:
        """Return where each visit may be: wherever trusted stars do not forbid it."""
        out = []
        for i, v in enumerate(chosen):
            visit = self.experience.visits[v]
            for p in chosen[:i]:
                there = self.experience.visits[p]
                if v not in stars:
                    turns: set[int] = {0}
                elif p not in stars:
                    turns = {r for one in visit.readings for r in range(len(one.star))}
                else:
                    turns = {
                        r
                        for one in visit.readings
                        for other in there.readings
                        for r in one.isomorphisms(other)
                    }
                out += [f"candidate({v},{p},{r})." for r in sorted(turns)]
        return out
