"""Conflicts in words: which axiom, which witness, which visits; judged by the logic programs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from hssh_kb.congruence import Assumption, Closure
from hssh_kb.errors import InternalError
from hssh_kb.experience import Experience, has_types
from hssh_kb.facts import experience_to_facts
from hssh_kb.oracle import AXIOMS, Literal, assumption_facts
from hssh_kb.solver import Symbol, is_satisfiable, solve_best
from hssh_kb.theory import axiom_program, find_axiom, list_axioms, read_messages, read_programs
from hssh_kb.variant import Variant

_BY_WEIGHT = (
    "planarity",
    "order_irreflexive",
    "path_types",
    "star_isomorphism",
    "reversibility",
    "travel_function",
)
"""Axioms in the order in which they are tried to be left out of a reason."""


_WIDE_LIMIT = 6
_OWN = re.compile(r"\bviolation\(\s*([a-z]\w*)")
_COMPARES = ("star_isomorphism", "path_types")
"""Axioms that compare what was seen at two visits."""


@dataclass(frozen=True)
class Reason:
    """Why some literals cannot hold together.

    Attributes
    ----------
    axiom : name of the axiom that is violated; "assumption" if the assumptions alone clash.
    axioms : all axioms that are needed, the violated one first.
    witness : where it is violated, as a term such as ``alpha(8,3,1,2)``.
    text : one plain sentence.
    """

    axiom: str
    axioms: tuple[str, ...]
    witness: str
    text: str


class Narrator:
    """Turns minimal conflicts into reasons.

    Parameters
    ----------
    experience, assumptions : what was lived through and what is supposed.
    planarity : whether this axiom holds.
    variant : axioms switched off, or rules of one's own.
    """

    def __init__(
        self,
        experience: Experience,
        assumptions: Sequence[Assumption],
        *,
        planarity: bool,
        variant: Variant | None = None,
    ) -> None:
        self.experience, self.assumptions = experience, assumptions
        self.variant = variant or Variant()
        left_out = set() if planarity else {"planarity"}
        if not has_types(experience):
            left_out.add("path_types")
        held = AXIOMS if self.variant.is_plain else self.variant.search_axioms()
        self.axioms = [name for name in held if name not in left_out]
        self.own = sorted(set(_OWN.findall(self.variant.rules)))

    def explain(self, conflict: frozenset[Literal], budget_s: float | None = None) -> Reason:
        """Return the reason of a minimal conflict.

        Raises
        ------
        InternalError : the logic programs find no conflict where the closure found one.
        """
        visits = self.visits_of(conflict)
        facts = self._facts(conflict, visits) + self.variant.rules
        if self._satisfiable(facts, self.axioms, budget_s):
            raise InternalError(
                f"the axioms accept what their closure rejects, at visits {sorted(visits)}"
            )
        needed = list(self.axioms)
        weighty = [*_BY_WEIGHT, *(name for name in self.axioms if name not in _BY_WEIGHT)]
        for name in weighty:
            fewer = [other for other in needed if other != name]
            if name in needed and self._satisfiable(facts, fewer, budget_s) is False:
                needed = fewer
        ruled = bool(self.own) and self._satisfiable(
            self._facts(conflict, visits), needed, budget_s
        )
        if not needed and not ruled:
            return Reason("assumption", (), "", self._tell_assumptions(conflict))
        violated = self.own[0] if ruled else next(name for name in weighty if name in needed)
        others = [name for name in needed if name != violated]
        witness = self._find_witness(facts, others, violated, budget_s)
        text = self._tell(conflict, violated, others, witness)
        return Reason(violated, (violated, *others), witness[1], text)

    def visits_of(self, conflict: Iterable[Literal]) -> set[int]:
        """Return the visits that a conflict speaks of."""
        visits: set[int] = set()
        for literal in conflict:
            if literal.kind == "assumption":
                a = self.assumptions[literal.number]
                visits |= {a.one, a.other}
            else:
                visits.add(literal.number)
                if literal.kind == "travel":
                    visits.add(literal.number - 1)
        return visits

    def _facts(self, conflict: frozenset[Literal], visits: set[int]) -> str:
        stars = {x.number for x in conflict if x.kind == "star"}
        travels = {x.number for x in conflict if x.kind == "travel"}
        doubted = [f"doubtable(star({v}))." for v in visits - stars]
        doubted += [f"doubtable(travel({v}))." for v in visits - travels if v - 1 in visits]
        held = [(x.number, self.assumptions[x.number]) for x in conflict if x.kind == "assumption"]
        return "\n".join(
            [
                experience_to_facts(self.experience, visits),
                *sorted(doubted),
                assumption_facts(sorted(held)),
                self._candidates(conflict, visits),
            ]
        )

    def _candidates(self, conflict: frozenset[Literal], visits: set[int]) -> str:
        """Return where each visit may be, so widely that no axiom is hidden.

        Few visits may be anywhere. With more, whatever matching stars or following the travels
        regardless of stars can make one place: without planarity no other place is forced.
        """
        if len(visits) <= _WIDE_LIMIT or not self.variant.is_plain:
            return read_programs(["wide"])
        held = [self.assumptions[x.number] for x in conflict if x.kind == "assumption"]
        stars = frozenset(x.number for x in conflict if x.kind == "star")
        travels = [x.number for x in conflict if x.kind == "travel"]
        related = Closure(self.experience, lenient=True).relate(stars, travels, held)
        related |= {
            (v, w, r)
            for v in visits
            for w in visits
            if w < v
            for one in self.experience.visits[v].readings
            for other in self.experience.visits[w].readings
            for r in one.star.isomorphisms(other.star)
        }
        related |= {(v, w, 0) for v in visits for w in visits if w < v and v not in stars}
        return " ".join(f"candidate({v},{w},{r})." for v, w, r in sorted(related))

    def _satisfiable(
        self, facts: str, axioms: Iterable[str], budget_s: float | None
    ) -> bool | None:
        names = ["experience", "generate", "map", "assume", "components", "modes/strict"]
        program = read_programs([*names, *map(axiom_program, axioms)]) + facts
        return is_satisfiable(program, budget_s)

    def _find_witness(
        self, facts: str, others: Iterable[str], violated: str, budget_s: float | None
    ) -> tuple[str, str]:
        """Return clause and term of a smallest violation when all the others are kept."""
        names = ["experience", "generate", "map", "assume", "components"]
        axioms = [name for name in [*others, violated] if name not in self.own]
        program = read_programs([*names, *map(axiom_program, axioms), "modes/diagnose"])
        program += facts + f"\n#show.\n#show X : violation({violated},X).\n"
        program += "".join(f":- violation({name},X).\n" for name in others)

        def convert(symbols: Sequence[Symbol]) -> list[Symbol]:
            return sorted(symbols)

        best = solve_best(program, convert, limit=1, budget_s=budget_s)
        if not best.found or not best.found[0]:
            return "", ""
        return best.found[0][0].name, str(best.found[0][0])

    def find_source(self, reason: Reason) -> str:
        """Return where the axiom of a reason comes from."""
        if not reason.axioms:
            return "your own assumptions"
        known = {axiom.name: axiom.source for axiom in list_axioms()}
        return known.get(reason.axiom, self.variant.source)

    # words

    def _name(self, axiom: str) -> str:
        if axiom in self.own:
            return f"{axiom} of {self.variant.source}"
        return f"axiom {find_axiom(axiom).number} ({find_axiom(axiom).title})"

    def _tell_assumptions(self, conflict: Iterable[Literal]) -> str:
        return f"{self._subject(conflict)} contradict each other."

    def _subject(self, conflict: Iterable[Literal]) -> str:
        texts = [
            self.assumptions[x.number].text for x in sorted(conflict) if x.kind == "assumption"
        ]
        return " and ".join(texts)

    def _tell(
        self,
        conflict: frozenset[Literal],
        violated: str,
        others: Sequence[str],
        witness: tuple[str, str],
    ) -> str:
        subject = self._subject(conflict) or "The experience"
        breaks = "together break" if " and " in subject else "breaks"
        head = f"{subject} {breaks} {self._name(violated)}"
        detail = self._detail(conflict, violated, witness)
        chain = self._chain(conflict, violated, others, witness)
        doubtful = any(
            len(self.experience.visits[v].readings) > 1 for v in self.visits_of(conflict)
        )
        rest = ", and so it is with every other reading of these stars" if doubtful else ""
        return f"{head}: {chain}{detail}{rest}."

    def _chain(
        self,
        conflict: frozenset[Literal],
        violated: str,
        others: Sequence[str],
        witness: tuple[str, str],
    ) -> str:
        """Say how the clash follows, where it is not direct."""
        travels = sorted(x.number for x in conflict if x.kind == "travel")
        if not travels:
            return ""
        told = f"by the travel{'s' if len(travels) > 1 else ''} {self._legs(travels)}"
        if others:
            laws = " and ".join(map(self._name, others))
            told += f", and by {laws}"
        numbers = _numbers(witness[1])
        if violated in _COMPARES and len(numbers) >= 2:
            told += f", {self._label(numbers[0])} and {self._label(numbers[1])} would be one place"
            return f"{told}, yet "
        return f"{told}, "

    def _detail(self, conflict: frozenset[Literal], violated: str, witness: tuple[str, str]) -> str:
        clause, term = witness
        if clause and violated == "star_isomorphism":
            direct = not any(x.kind == "travel" for x in conflict)
            clause = "none" if direct and clause != "size" else clause
        template = read_messages().get(violated, {}).get(clause)
        if template is None or violated not in AXIOMS:
            return f"it derives {term}" if term else self._name(violated)
        return template.format(**self._words(violated, _numbers(term)))

    def _words(self, violated: str, numbers: Sequence[int]) -> dict[str, str]:
        """Return what fills the placeholders of a message."""
        if violated in _COMPARES:
            a, b = numbers[0], numbers[1]
            words = {
                "a": self._label(a),
                "b": self._label(b),
                "star_a": str(self.experience.visits[a].star),
                "star_b": str(self.experience.visits[b].star),
            }
            if len(numbers) == 4:
                words["dlp_a"] = self._dlp(a, numbers[2])
                words["dlp_b"] = self._dlp(b, numbers[3])
            return words
        if violated == "order_irreflexive":
            travel, place, k = numbers
            return {
                "travel": self._travel(travel),
                "place": self._label(place),
                "dlp": self._dlp(place, k),
            }
        travels = [self._travel(v) for v in numbers]
        return dict(zip(("travel", "travel2"), travels, strict=False))

    def _legs(self, travels: Sequence[int]) -> str:
        """Return travels in words, those that follow one another as one."""
        runs: list[list[int]] = []
        for v in travels:
            if runs and runs[-1][1] == v - 1:
                runs[-1][1] = v
            else:
                runs.append([v - 1, v])
        texts = [
            f"from {self._label(first)} {'on ' if last - first > 1 else ''}to {self._label(last)}"
            for first, last in runs
        ]
        return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)

    def _travel(self, v: int) -> str:
        return f"{self._label(v - 1)} to {self._label(v)}"

    def _label(self, v: int) -> str:
        return self.experience.visit_label(v)

    def _dlp(self, v: int, k: int) -> str:
        dlps = self.experience.visits[v].star.dlps
        return str(dlps[k % len(dlps)]) if dlps else str(k)


def _numbers(term: str) -> list[int]:
    """Return the arguments of a flat term of integers."""
    return list(_iterate_numbers(term))


def _iterate_numbers(term: str) -> Iterator[int]:
    inside = term.partition("(")[2].rstrip(")")
    for part in inside.split(","):
        if part.strip().isdigit():
            yield int(part)
