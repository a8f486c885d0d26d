"""Maps of an experience: all consistent ones, the minimal ones, and the paths of one."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from hssh_kb.congruence import Assumption
from hssh_kb.enumerator import TreeEnumerator
from hssh_kb.errors import UsageError
from hssh_kb.experience import Experience, has_partial_types
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.oracle import Oracle
from hssh_kb.planarity import make_planarity_test
from hssh_kb.preference import best_by_cardinality, best_by_subset
from hssh_kb.program import (
    blame_variant,
    has_alternatives,
    hypothesis_facts,
    make_converter,
    sort_key,
    strict_program,
    variant_program,
)
from hssh_kb.search_budget import tell_rest
from hssh_kb.solver import Models, is_satisfiable, solve_all
from hssh_kb.subsets import OutOfTimeError
from hssh_kb.variant import Variant

Dstate = tuple[int, int]
_LOOK_S = 2.0
_QUICK = ("--heuristic=None",)
"""When all maps are wanted, deciding in the order of time never runs into a conflict."""


@dataclass(frozen=True)
class Enumeration:
    """Maps that were found, and what is known about the others.

    Attributes
    ----------
    maps : sorted by (visits, offsets, readings); the minimal ones by (paths, places) first.
    complete : True if there are no others of the kind asked for.
    inconsistent_from : the first visit with which no map is left, or None; the maps are then
        those of the visits before it.
    costs : for minimal maps, the number of each thing preferred few, in order of priority.
    """

    maps: tuple[Hypothesis, ...]
    complete: bool
    inconsistent_from: int | None = None
    costs: tuple[tuple[int, ...], ...] = ()


def enumerate_maps(
    experience: Experience,
    *,
    order: bool = True,
    planarity: bool = True,
    limit: int | None = None,
    budget_s: float | None = None,
    engine: str = "tree",
    variant: Variant | None = None,
) -> Enumeration:
    """Find all maps that are consistent with an experience.

    Parameters
    ----------
    experience : what was lived through.
    order, planarity : whether these axioms hold.
    limit : stop after so many maps.
    budget_s : stop after so many seconds.
    engine : "program" asks the solver; "tree" grows the same maps sooner. The solver is asked in
        any case where the axioms in use are not the packaged ones.
    variant : axioms switched off, or rules of one's own.

    Returns
    -------
    Enumeration : ``complete`` is False if a budget ended the search. An experience that
        contradicts itself gives the maps of its longest consistent beginning.

    Raises
    ------
    UsageError : a budget that is not positive, an unknown engine, or weakened axioms: these say
        which maps are best, not which there are.
    InputError : axioms of one's own that cannot be grounded.
    """
    variant = variant or Variant()
    if variant.weights:
        raise UsageError("weakened axioms forbid nothing; they can only rank the best maps")
    if engine not in ("tree", "program"):
        raise UsageError(f"the engine is 'tree' or 'program', not {engine!r}")
    end = _deadline(limit, budget_s)
    count = len(experience)
    if not (order and variant.is_plain and _contradicts_itself(experience, budget_s)):
        found = _enumerate(experience, count, order, planarity, limit, budget_s, engine, variant)
        if found.maps or not found.complete:
            return found
    broken = find_inconsistent_visit(
        experience, order=order, planarity=planarity, budget_s=tell_rest(end), variant=variant
    )
    if broken is None:
        return Enumeration((), complete=False)
    kept = _enumerate(experience, broken, order, planarity, limit, tell_rest(end), engine, variant)
    return Enumeration(kept.maps, kept.complete, inconsistent_from=broken)


def _contradicts_itself(experience: Experience, budget_s: float | None) -> bool:
    """Return whether an experience is known to have no map: a long search would find none."""
    end = time.monotonic() + (_LOOK_S if budget_s is None else min(_LOOK_S, budget_s))
    oracle = Oracle(experience, (), planarity=False, end=end)
    try:
        return not oracle.consistent(frozenset(oracle.literals()))
    except OutOfTimeError:
        return False


def find_inconsistent_visit(
    experience: Experience,
    *,
    order: bool = True,
    planarity: bool = True,
    budget_s: float | None = None,
    variant: Variant | None = None,
) -> int | None:
    """Return the first visit N such that visits 0..N have no map; None if all have one.

    Also None if the budget ran out. Consistency never returns once lost, so bisection finds N.
    The closure under travel decides, without search where each visit has one reading.
    """
    end = None if budget_s is None else time.monotonic() + budget_s
    variant = variant or Variant()
    plain = variant.is_plain

    def consistent(count: int) -> bool | None:
        if not plain:
            with blame_variant(variant):
                program = variant_program(
                    experience, variant, order=order, planarity=planarity, visits=count
                )
                return is_satisfiable(program, tell_rest(end))
        if order:  # the least map is a tree, so planarity never decides
            begun = replace(experience, visits=experience.visits[:count])
            oracle = Oracle(begun, (), planarity=False, end=end)
            try:
                return oracle.consistent(frozenset(oracle.literals()))
            except OutOfTimeError:
                return None
        program = strict_program(experience, order=order, planarity=planarity, visits=count)
        return is_satisfiable(program, tell_rest(end))

    low, high = 1, len(experience) + 1  # low visits have a map; high is open
    step = 1
    while low < len(experience):
        probe = min(low + step, len(experience), high - 1)
        if probe <= low:
            break
        answer = consistent(probe)
        if answer is None:
            return None
        if answer:
            low, step = probe, step * 2
        else:
            high, step = probe, max(1, (probe - low) // 2)
    return high - 1 if high <= len(experience) else None


def minimal_maps(
    experience: Experience,
    *,
    minimal: str = "cardinality",
    policy: str = "paths-then-places",
    planarity: bool = True,
    limit: int | None = None,
    budget_s: float | None = None,
    variant: Variant | None = None,
    supposed: Sequence[Assumption] = (),
) -> Enumeration:
    """Find the minimal maps of an experience: all that tie for the best.

    Parameters
    ----------
    experience : what was lived through.
    minimal : "cardinality" (fewest) or "subset" (circumscription: no map has a proper part of
        what is to be few).
    policy : which preference; see :data:`hssh_kb.theory.POLICIES`.
    planarity : whether this axiom holds.
    limit : stop after so many maps.
    budget_s : stop after so many seconds; then ``complete`` is False and the maps, if any, are
        the best seen so far.
    variant : axioms switched off or weakened, or rules of one's own. What violations of weakened
        axioms cost comes first in ``costs``.
    supposed : what is to hold in the maps; with cardinality only.

    Raises
    ------
    UsageError : unknown ``minimal`` or ``policy``, a budget that is not positive, or weakened
        axioms with subset minimality.
    InputError : axioms of one's own that cannot be grounded.

    Source
    ------
    Beeson, Modayil & Kuipers 2010, section 3.3 (prioritised circumscription of Remolina &
    Kuipers 2004).
    """
    if minimal not in ("cardinality", "subset"):
        raise UsageError(f"minimal is 'cardinality' or 'subset', not {minimal!r}")
    end = _deadline(limit, budget_s)
    variant = variant or Variant()
    if (variant.weights or supposed) and minimal == "subset":
        raise UsageError("subset minimality goes neither with weakened axioms nor with assumptions")

    def find(count: int) -> Enumeration:
        rest = tell_rest(end)
        with blame_variant(variant):
            if minimal == "subset":
                found = best_by_subset(experience, count, policy, planarity, limit, rest, variant)
            else:
                found = best_by_cardinality(
                    experience, count, policy, planarity, limit, rest, variant, supposed
                )
        return _gather(found)

    if supposed or not variant.is_plain or not _contradicts_itself(experience, tell_rest(end)):
        found = find(len(experience))
        if found.maps or not found.complete or supposed:
            return found
    broken = find_inconsistent_visit(
        experience, planarity=planarity, budget_s=tell_rest(end), variant=variant
    )
    if broken is None:
        return Enumeration((), complete=False)
    kept = find(broken)
    return Enumeration(kept.maps, kept.complete, broken, kept.costs)


def obeys(experience: Experience, hypothesis: Hypothesis, variant: Variant) -> bool:
    """Return whether a map violates no axiom of a variant, weakened ones included.

    Raises
    ------
    InputError : axioms of one's own that cannot be grounded.
    """
    strict = replace(variant, weights={})
    begun = replace(experience, visits=experience.visits[: len(hypothesis.visits)])
    with blame_variant(variant):
        program = variant_program(begun, strict, generator="")
        return bool(is_satisfiable(program + hypothesis_facts(begun, hypothesis)))


def _gather(models: Models[Hypothesis]) -> Enumeration:
    maps = tuple(sorted(models.found, key=sort_key))
    return Enumeration(
        maps, models.complete, costs=(models.cost,) * len(maps) if models.cost else ()
    )


def _enumerate(
    experience: Experience,
    count: int,
    order: bool,
    planarity: bool,
    limit: int | None,
    budget_s: float | None,
    engine: str,
    variant: Variant,
) -> Enumeration:
    readings = has_alternatives(experience)
    if not variant.is_plain:
        with blame_variant(variant):
            models = solve_all(
                variant_program(
                    experience, variant, order=order, planarity=planarity, visits=count
                ),
                make_converter(count, readings),
                limit=limit,
                budget_s=budget_s,
                options=_QUICK,
            )
        return Enumeration(tuple(sorted(models.found, key=sort_key)), models.complete)
    if engine == "tree" and not has_partial_types(experience):
        end = None if budget_s is None else time.monotonic() + budget_s
        tree = TreeEnumerator(
            experience, count, order=order, planarity=planarity, limit=limit, end=end
        )
        complete = tree.run()
        return Enumeration(tuple(sorted(tree.found, key=sort_key)), complete)
    by_filter = planarity and not readings  # quicker than guessing faces; tests hold both equal
    program = strict_program(
        experience, order=order, planarity=planarity and not by_filter, visits=count
    )
    keep = make_planarity_test(experience, count) if by_filter else None
    convert = make_converter(count, readings, keep)
    models = solve_all(program, convert, limit=limit, budget_s=budget_s, options=_QUICK)
    return Enumeration(tuple(sorted(models.found, key=sort_key)), models.complete)


def _deadline(limit: int | None, budget_s: float | None) -> float | None:
    if limit is not None and limit < 1:
        raise UsageError(f"the limit must be at least 1 map, not {limit}")
    if budget_s is None:
        return None
    if not budget_s > 0:
        raise UsageError(f"the budget must be more than 0 seconds, not {budget_s:g}")
    return time.monotonic() + budget_s


def path_classes(experience: Experience, hypothesis: Hypothesis) -> tuple[tuple[Dstate, ...], ...]:
    """Return the directed paths of a map, each as the dstates (place, dlp) on it in order.

    Every dlp of every place is on exactly one directed path, travelled or not. Directed paths
    come in pairs, one for each direction, unless a path is circular or doubles back.

    Returns
    -------
    tuple of tuples of (place, index of a dlp of the star of the place); sorted.
    """
    ahead: dict[Dstate, Dstate] = {}
    for v in range(1, len(hypothesis.visits)):
        if v in hypothesis.doubted:
            continue
        before, now = hypothesis.reading(experience, v - 1), hypothesis.reading(experience, v)
        if before.depart is None or now.arrive is None:
            continue
        leave = hypothesis.place_dlp(experience, v - 1, before.depart)
        face = hypothesis.place_dlp(experience, v, now.arrive)
        ahead[leave] = face
        back = hypothesis.place_dlp(experience, v, now.star.opposite(now.arrive))
        home = hypothesis.place_dlp(experience, v - 1, before.star.opposite(before.depart))
        ahead[back] = home
    dstates = [
        (p, k)
        for p in hypothesis.places
        for k in range(len(hypothesis.reading(experience, p).star))
    ]
    behind = set(ahead.values())
    starts = [q for q in dstates if q not in behind]
    seen: set[Dstate] = set()
    paths = []
    for start in [*starts, *dstates]:  # what is left after the true starts is circular
        path, q = [], start
        while q is not None and q not in seen:
            seen.add(q)
            path.append(q)
            q = ahead.get(q, start)
        if path:
            paths.append(tuple(path))
    return tuple(sorted(paths))


def count_paths(experience: Experience, hypothesis: Hypothesis) -> int:
    """Return the number of paths of a map, paths on which nobody has travelled included."""
    number = {q: i for i, path in enumerate(path_classes(experience, hypothesis)) for q in path}
    pairs = set()
    for (p, k), i in number.items():
        opposite = hypothesis.reading(experience, p).star.opposite(k)
        pairs.add(frozenset((i, number[p, opposite])))
    return len(pairs)
