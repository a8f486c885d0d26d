"""Axiom violations: which, why, which observations; and "why not?" for what a user supposes."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass

from hssh_kb.congruence import Assumption
from hssh_kb.errors import InputError, UsageError
from hssh_kb.experience import Experience, hold_types
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.narrate import Narrator
from hssh_kb.oracle import Literal, Oracle
from hssh_kb.program_oracle import ProgramOracle
from hssh_kb.subsets import OutOfTimeError, find_conflicts
from hssh_kb.variant import Variant

_ASSUMPTION = re.compile(r"(?P<one>.+?)\s*(?P<sign>!=|=)\s*(?P<other>.+)\Z", re.DOTALL)
_VISIT = re.compile(r"v(\d+)\Z")
CONFLICT_LIMIT = 8
"""At most so many conflicts, and so many repairs, are told; the smallest are found first."""
DEFAULT_BUDGET_S = 20.0


@dataclass(frozen=True)
class Violation:
    """One reason why there is no map.

    Attributes
    ----------
    axiom : name of the violated axiom; "assumption" if the assumptions alone clash.
    source : where the axiom comes from.
    text : one plain sentence that names the axiom and the observations.
    witness : where the axiom is violated, as a term of the theory.
    observations : the visits that clash, such as ``("v2", "v7")``.
    minimal : True if fewer observations and assumptions would not clash.
    axioms : all axioms that the reason needs, the violated one first.
    """

    axiom: str
    source: str
    text: str
    witness: str
    observations: tuple[str, ...]
    minimal: bool = True
    axioms: tuple[str, ...] = ()


@dataclass(frozen=True)
class Check:
    """The answer to "is this consistent?".

    Attributes
    ----------
    consistent : whether there is a map; False also when the budget ran out before one was found,
        see ``status``.
    violations : the reasons, smallest first; never empty if there is no map.
    repairs : what to drop, each a smallest-by-inclusion set of sentences; smallest first.
    status : "consistent", "violated", "unsatisfiable" (there is no map, and the budget did not
        suffice to say why) or "budget spent" (nothing is known).
    text : one sentence for all of it.
    complete : False if there may be further reasons or repairs.
    example : some map that agrees with everything, if there is one.
    """

    consistent: bool
    violations: tuple[Violation, ...]
    repairs: tuple[tuple[str, ...], ...]
    status: str
    text: str
    complete: bool = True
    example: Hypothesis | None = None


def parse_assumption(experience: Experience, text: str) -> Assumption:
    """Read an assumption such as ``v7=v2`` or ``lift lobby!=v3``.

    Raises
    ------
    InputError : not of that form, or a visit that there is not.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> two = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> parse_assumption(two, "v1 = v0").same
    True
    """
    match = _ASSUMPTION.match(text.strip())
    if match is None:
        raise InputError(
            f"assumption {text!r}: expected two visits with '=' or '!=' between them, "
            "such as v7=v2 or v3!=v1"
        )
    one = _find_visit(experience, match["one"].strip(), text)
    other = _find_visit(experience, match["other"].strip(), text)
    same = match["sign"] == "="
    if one == other:
        raise InputError(f"assumption {text!r}: both sides are visit v{one}")
    sign = "=" if same else "!="
    told = f"{experience.visit_label(one)} {sign} {experience.visit_label(other)}"
    return Assumption(one, other, same, told)


def find_visit(experience: Experience, word: str) -> int:
    """Return the visit called ``v9``, or by a name that only one visit has.

    Raises
    ------
    InputError : there is none, or there are several.
    """
    return _find_visit(experience, word.strip(), "")


def _find_visit(experience: Experience, word: str, text: str) -> int:
    where = f"assumption {text!r}: " if text else ""
    match = _VISIT.match(word)
    if match:
        v = int(match[1])
        if v < len(experience):
            return v
        raise InputError(
            f"{where}there is no visit {word}; the visits are v0 to v{len(experience) - 1}"
        )
    named = [v for v, visit in enumerate(experience.visits) if visit.name == word]
    if len(named) == 1:
        return named[0]
    if named:
        those = ", ".join(f"v{v}" for v in named)
        raise InputError(f"{where}{word!r} is the name of {those}; say which")
    raise InputError(f"{where}{word!r} is no visit; write v0 to v{len(experience) - 1} or a name")


def check(
    experience: Experience,
    assumptions: Sequence[str] = (),
    *,
    planarity: bool = True,
    limit: int = CONFLICT_LIMIT,
    budget_s: float | None = DEFAULT_BUDGET_S,
    variant: Variant | None = None,
) -> Check:
    """Say whether an experience, and what is supposed about it, has a map; if not, why not.

    Parameters
    ----------
    experience : what was lived through.
    assumptions : such as ``["v7=v2", "v3!=v1"]``; visits by number or by name.
    planarity : whether this axiom holds.
    limit : at most so many reasons and repairs.
    budget_s : seconds to spend; None for as long as it takes.
    variant : axioms switched off, or rules of one's own.

    Raises
    ------
    InputError : an assumption that cannot be read, or speaks of a visit that there is not; axioms
        of one's own that cannot be grounded.
    UsageError : a limit below 1 or a budget that is not positive.

    Source
    ------
    Ours: minimal unsatisfiable subsets of observations, assumptions and named axioms.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> two = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> answer = check(two, ["v1=v0"])
    >>> answer.consistent, answer.violations[0].observations, answer.repairs[0]
    (False, ('v0', 'v1'), ('drop the assumption v1 = v0',))
    """
    if limit < 1:
        raise UsageError(f"the limit must be at least 1, not {limit}")
    if budget_s is not None and not budget_s > 0:
        raise UsageError(f"the budget must be more than 0 seconds, not {budget_s:g}")
    end = None if budget_s is None else time.monotonic() + budget_s
    supposed = [parse_assumption(experience, text) for text in assumptions]
    experience = hold_types(experience)
    variant = variant or Variant()
    oracle: Oracle | ProgramOracle
    if variant.is_plain:
        oracle = Oracle(experience, supposed, planarity=planarity, end=end)
    else:
        oracle = ProgramOracle(experience, supposed, variant, planarity=planarity, end=end)
    literals = oracle.literals()
    try:
        example = oracle.find_map(frozenset(literals))
    except OutOfTimeError:
        return _spent(budget_s)
    if example is not None:
        return Check(True, (), (), "consistent", _tell_consistent(supposed), example=example)
    found = find_conflicts(literals, oracle.consistent, limit=limit, end=end)
    narrator = Narrator(experience, supposed, planarity=planarity, variant=variant)
    violations = _narrate(narrator, found.conflicts, end)
    repairs = tuple(
        tuple(_tell_literal(experience, supposed, x) for x in sorted(repair))
        for repair in sorted(found.repairs, key=lambda r: (len(r), sorted(r)))
    )
    if not violations:
        text = "There is no map; the budget did not suffice to say why. Give a longer budget."
        return Check(False, _unexplained(text), repairs, "unsatisfiable", text, complete=False)
    return Check(
        False, violations, repairs, "violated", violations[0].text, complete=found.complete
    )


@dataclass(frozen=True)
class NewPlace:
    """The answer to "why is this visit a new place?".

    Attributes
    ----------
    visit : the visit asked about.
    earlier : for each earlier visit whether they may be one place, and if not, why not.
    forced : True if every earlier visit is refused by an axiom: the visit is new in every map.
    complete : False if the budget ended before all were asked.
    text : one sentence for all of it.
    """

    visit: int
    earlier: tuple[tuple[int, Check], ...]
    forced: bool
    complete: bool
    text: str


def explain_new(
    experience: Experience,
    visit: int,
    *,
    planarity: bool = True,
    budget_s: float | None = DEFAULT_BUDGET_S,
    variant: Variant | None = None,
) -> NewPlace:
    """Say for each earlier visit whether a visit may be at the same place, and if not, why not.

    It answers "why is v9 a new place?": because each of the earlier ones is refused for a reason
    of its own, or because the preference chose so where some are not.

    Raises
    ------
    InputError : there is no such visit.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> two = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> explain_new(two, 1).text
    'v1 is a new place in every map: the axioms refuse each of the 1 earlier visits.'
    """
    if not 0 <= visit < len(experience):
        raise InputError(f"there is no visit v{visit}; the visits are v0 to v{len(experience) - 1}")
    share = None if budget_s is None else max(budget_s / max(visit, 1), 0.1)
    earlier = tuple(
        (
            other,
            check(
                experience,
                [f"v{visit}=v{other}"],
                planarity=planarity,
                limit=1,
                budget_s=share,
                variant=variant,
            ),
        )
        for other in range(visit)
    )
    complete = all(answer.status != "budget spent" for _, answer in earlier)
    possible = [other for other, answer in earlier if answer.consistent]
    forced = complete and not possible
    label = experience.visit_label(visit)
    if not visit:
        text = f"{label} is a new place in every map: it is the first visit."
    elif forced:
        text = (
            f"{label} is a new place in every map: the axioms refuse each of the {visit} "
            "earlier visits."
        )
    elif possible:
        told = ", ".join(experience.visit_label(other) for other in possible)
        text = (
            f"The axioms allow {label} to be at the place of {told}; in a map where it is new, "
            "the preference among maps, or the measurements, made it so."
        )
    else:
        text = f"The budget was spent before all visits earlier than {label} were asked about."
    return NewPlace(visit, earlier, forced, complete, text)


def _narrate(
    narrator: Narrator, conflicts: Sequence[frozenset[Literal]], end: float | None
) -> tuple[Violation, ...]:
    out = []
    for conflict in sorted(conflicts, key=lambda c: (len(c), sorted(c))):
        rest = None if end is None else max(end - time.monotonic(), 0.5)
        reason = narrator.explain(conflict, rest)
        source = narrator.find_source(reason)
        visits = tuple(f"v{v}" for v in sorted(narrator.visits_of(conflict)))
        out.append(
            Violation(
                reason.axiom, source, reason.text, reason.witness, visits, True, reason.axioms
            )
        )
        if end is not None and time.monotonic() >= end:
            break
    return tuple(out)


def _tell_consistent(supposed: Sequence[Assumption]) -> str:
    if not supposed:
        return "The experience violates no axiom."
    told = " and ".join(a.text for a in supposed)
    return f"{told}: violates no axiom; there is a map in which this holds."


def _tell_literal(experience: Experience, supposed: Sequence[Assumption], literal: Literal) -> str:
    if literal.kind == "assumption":
        return f"drop the assumption {supposed[literal.number].text}"
    here = experience.visit_label(literal.number)
    if literal.kind == "star":
        return f"doubt the star seen at {here}"
    before = experience.visit_label(literal.number - 1)
    return f"doubt the travel from {before} to {here}"


def _spent(budget_s: float | None) -> Check:
    text = f"The budget of {budget_s:g} s was spent before an answer was found; give a longer one."
    return Check(False, _unexplained(text), (), "budget spent", text, complete=False)


def _unexplained(text: str) -> tuple[Violation, ...]:
    return (Violation("unknown", "", text, "", (), minimal=False),)
