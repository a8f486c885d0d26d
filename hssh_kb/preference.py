"""Minimal maps: fewest by count, or minimal by inclusion, under a named policy."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from hssh_kb.congruence import Assumption
from hssh_kb.experience import Experience, has_partial_types
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.lean_search import search_lean
from hssh_kb.map_samples import sample_planar_maps
from hssh_kb.oracle import assumption_facts
from hssh_kb.planarity import is_planar, make_planarity_test
from hssh_kb.program import (
    has_alternatives,
    make_converter,
    strict_program,
    variant_program,
)
from hssh_kb.ranking import measure_map
from hssh_kb.search_budget import tell_rest
from hssh_kb.solver import Models, Symbol, solve_best, solve_minimal
from hssh_kb.theory import policy_levels, policy_program
from hssh_kb.variant import Variant

_LETTERS = "ABCDEFGH"
_LONG, _SAMPLE_SHARE, _LEAST_S = 20, 0.2, 0.2
"""Beyond so many visits a share of the time is kept for maps to fall back on, at least 0.2 s."""


def best_by_cardinality(
    experience: Experience,
    count: int,
    policy: str,
    planarity: bool,
    limit: int | None,
    budget_s: float | None,
    variant: Variant,
    supposed: Sequence[Assumption] = (),
) -> Models[Hypothesis]:
    """Find the maps of the first visits that cost least, all that tie.

    Walks with one reading a visit go to the lean program. Of others, planarity is tried on the best
    maps found without it. If none is planar, the next best are sought, and so on: a few quick
    searches instead of one in which the faces are guessed.
    """
    further = ["objective", policy_program(policy)]
    if not variant.is_plain:
        program = variant_program(
            experience, variant, planarity=planarity, visits=count, further=further
        )
        convert = make_converter(count, has_alternatives(experience))
        return solve_best(program, convert, limit=limit, budget_s=budget_s)
    further += ["assume"] if supposed else []
    if not has_alternatives(experience) and not has_partial_types(experience):
        return _search_long(experience, count, policy, planarity, limit, budget_s, supposed)
    program = strict_program(experience, planarity=False, visits=count, further=further)
    program += assumption_facts(enumerate(supposed))
    end = None if budget_s is None else time.monotonic() + budget_s
    while True:
        rest = tell_rest(end)
        seen: list[int] = []
        convert = _make_counting_converter(experience, count, planarity, seen)
        models = solve_best(program, convert, limit=limit, budget_s=rest)
        if models.found or not models.complete or not seen:
            return models
        program += _worse_than(policy, models.cost)


def _search_long(
    experience: Experience,
    count: int,
    policy: str,
    planarity: bool,
    limit: int | None,
    budget_s: float | None,
    supposed: Sequence[Assumption],
) -> Models[Hypothesis]:
    """Ask the lean program; if it takes too long, fall back on the best of maps seen quickly."""
    end = None if budget_s is None else time.monotonic() + budget_s
    share = _SAMPLE_SHARE * budget_s if budget_s and count > _LONG and not supposed else 0.0
    rest = None if budget_s is None else budget_s - share
    found = search_lean(experience, count, policy, planarity, limit, rest, supposed)
    if found.complete or supposed or end is None:
        return found
    sample = _sample_maps(experience, count, policy, end)
    if found.found and (not sample.found or found.cost <= sample.cost):
        return found
    return replace(sample, found=sample.found[:limit])


def _sample_maps(experience: Experience, count: int, policy: str, end: float) -> Models[Hypothesis]:
    """Return the best of some maps that the tree of maps shows quickly; never said to be all."""
    begun = replace(experience, visits=experience.visits[:count])
    best: dict[Hypothesis, None] = {}
    cost: tuple[int, ...] = ()
    for hypothesis in sample_planar_maps(begun, max(end, time.monotonic() + _LEAST_S)):
        size = measure_map(begun, hypothesis, policy)
        if not cost or size < cost:
            best, cost = {}, size
        if size == cost:
            best[hypothesis] = None
    return Models(tuple(best), complete=False, cost=cost)


def _make_counting_converter(
    experience: Experience, count: int, planarity: bool, seen: list[int]
) -> Callable[[Sequence[Symbol]], Hypothesis | None]:
    """Return a converter that notes each model in ``seen`` and refuses maps that are not planar."""
    readings = has_alternatives(experience)
    begun = replace(experience, visits=experience.visits[:count])
    quick = make_planarity_test(experience, count) if planarity and not readings else None
    plain = make_converter(count, readings, quick)

    def convert(symbols: Sequence[Symbol]) -> Hypothesis | None:
        seen.append(1)
        hypothesis = plain(symbols)
        if hypothesis is not None and planarity and readings and not is_planar(begun, hypothesis):
            return None
        return hypothesis

    return convert


def _worse_than(policy: str, cost: Sequence[int]) -> str:
    """Return the constraint that a map costs more, level by level, than the best ones so far."""
    parts = []
    for (name, arity), bound in zip(
        (level[0] for level in policy_levels(policy)), cost, strict=True
    ):
        if name == "dear":  # readings are weighed by their price
            parts.append(f"#sum {{ W,V : reading(V,R), price(V,R,W) }} <= {bound}")
        else:
            variables = ",".join(_LETTERS[:arity])
            parts.append(f"#count {{ {variables} : {name}({variables}) }} <= {bound}")
    # No map left is better in an earlier level, so "at most" means "equal" there.
    return f"\n:- {', '.join(parts)}.\n"


def best_by_subset(
    experience: Experience,
    count: int,
    policy: str,
    planarity: bool,
    limit: int | None,
    budget_s: float | None,
    variant: Variant,
) -> Models[Hypothesis]:
    """Find the maps of the first visits to which no other is preferred, by inclusion."""
    further = ("objective",)
    if variant.is_plain:
        program = strict_program(experience, planarity=planarity, visits=count, further=further)
    else:
        program = variant_program(
            experience, variant, planarity=planarity, visits=count, further=further
        )
    convert = make_converter(count, has_alternatives(experience))
    return solve_minimal(program, policy_levels(policy), convert, limit=limit, budget_s=budget_s)
