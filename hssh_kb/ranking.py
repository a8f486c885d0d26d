"""Ranked maps: minimal ones where there is no metrical evidence, probable ones where there is.

Source: the prioritised circumscription of the SSH (fewest paths, then fewest places) and the
posterior of Beeson 2008, chapter 9; which of the two decides is said with the answer.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from hssh_kb.errors import NoAnswerError, UsageError
from hssh_kb.experience import Experience, hold_types
from hssh_kb.facts import price_of_reading
from hssh_kb.hypothesis import Hypothesis

if TYPE_CHECKING:
    from hssh_kb.variant import Variant

COUNT_LIMIT = 2000
"""Maps are counted by default only if there are at most so many."""

DEFAULT_POLICY = "paths-then-places"
RankedBy = Literal["minimal", "posterior"]
_EQUAL = 1e-9
_RANKED_A_SECOND = 1500
"""Maps found for each second of a budget, at most: ranking and showing them takes far longer than
finding them."""

_COUNT_SHARE, _LEAST_S = 0.25, 0.2
"""Of the time, so much may go into counting the maps unasked; and some is left in any case."""


@dataclass(frozen=True)
class RankedMaps:
    """Hypotheses, best first, and what is known about the others.

    Attributes
    ----------
    maps : best first.
    ranked_by : "minimal" (fewest paths, then fewest places) or "posterior" (metrical evidence).
    minimality : "cardinality" or "subset", where minimality decided.
    consistent : how many maps are consistent; None if they were not all counted.
    proven : whether it is proven that no other map is better.
    budget_spent : True if a budget ended the work; the maps are then a partial answer.
    inconsistent_from : the first visit with which no consistent map is left; None if there is
        one. The maps are then those of the visits before it.
    contradiction : what clashes there, and the least to doubt, where displacements call for
        what the axioms refuse; or which displacements speak against the best map; else ''.
    policy : the preference, where minimality decided.
    log_evidence : where the posterior decided, log of the summed posteriors of all maps found.
    penalty : what the violations of weakened axioms cost in each of the maps; they are then the
        maps in which this is least.
    """

    maps: tuple[Hypothesis, ...]
    ranked_by: RankedBy
    minimality: str = "cardinality"
    consistent: int | None = None
    proven: bool = True
    inconsistent_from: int | None = None
    budget_spent: bool = False
    policy: str = DEFAULT_POLICY
    penalty: int | None = None
    log_evidence: float | None = None
    contradiction: str = ""

    @property
    def complete(self) -> bool:
        """True if all consistent maps were counted."""
        return self.consistent is not None


@dataclass(frozen=True)
class MapRow:
    """One line of a ranking.

    Attributes
    ----------
    number : position in the list, from 1; what ``--map`` takes.
    rank : one more than the number of better maps; tied maps share it.
    tie : how many maps share the rank.
    places, paths : how many the map has, untravelled paths included.
    probability : share of the posterior of all maps found; None where minimality decided.
    """

    number: int
    rank: int
    tie: int
    places: int
    paths: int
    hypothesis: Hypothesis
    probability: float | None = None


def rank_maps(
    experience: Experience,
    *,
    every: bool = False,
    best: int | None = None,
    minimal: str | None = None,
    planarity: bool = True,
    order: bool = True,
    budget_s: float | None = None,
    policy: str | None = None,
    variant: Variant | None = None,
) -> RankedMaps:
    """Find the maps of an experience and rank them.

    Parameters
    ----------
    experience : what was lived through.
    every : all consistent maps, not only the best ones.
    best : how many maps; by default all that tie for the best if minimality decides, else 5.
    minimal : "cardinality" or "subset": minimality decides, even where there is metrical evidence.
    planarity, order : whether these axioms hold.
    budget_s : seconds after which a partial answer is given (``budget_spent``); of all maps, no
        more are found then than can be ranked in that time.
    policy : a preference of :data:`hssh_kb.theory.POLICIES`: minimality decides, in its order.
    variant : axioms switched off or weakened, or rules of one's own. Where the posterior decides,
        the search holds to the packaged axioms, and maps that break others are left out.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> walk = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> [hypothesis.visits for hypothesis in rank_maps(walk).maps]
    [(0, 1)]
    """
    from hssh_kb.variant import Variant

    weaker = not (planarity and order)
    variant = variant or Variant()
    experience = hold_types(experience)
    if policy is not None:
        from hssh_kb.theory import policy_program

        policy_program(policy)  # raises if there is none of that name
        minimal = minimal or "cardinality"
    policy = policy or DEFAULT_POLICY
    if experience.has_displacements and minimal is None and not every and not weaker:
        ranked = _rank_by_posterior(experience, best or 5, budget_s)
        return ranked if variant.is_plain else _hold_to(experience, ranked, variant)
    if minimal == "subset" and every:
        raise UsageError("subset minimality leaves maps out, so it cannot be asked for all maps")
    if variant.weights and (every or not order):
        raise UsageError("weakened axioms rank the best maps; all maps cannot be asked for")
    end = None if budget_s is None else time.monotonic() + budget_s
    if not variant.weights and (not order or every or minimal != "subset"):
        found = _rank_all(experience, every, best, planarity, order, budget_s, policy, variant)
        if found is not None:
            return found
    rest = None if end is None else max(end - time.monotonic(), _LEAST_S)
    return _rank_by_minimality(
        experience, best, minimal or "cardinality", planarity, rest, policy, variant
    )


def _hold_to(experience: Experience, ranked: RankedMaps, variant: Variant) -> RankedMaps:
    """Leave out maps that break the axioms of a variant, which the search does not read.

    Raises
    ------
    UsageError : the variant forbids less than the packaged axioms do.
    NoAnswerError : none of the maps is left.
    """
    from hssh_kb.maps import obeys

    if variant.without or variant.weights:
        raise UsageError(
            "the search for the most probable maps holds to all axioms; with axioms switched off "
            "or weakened, let minimality decide (--minimal cardinality)"
        )
    kept = tuple(h for h in ranked.maps if obeys(experience, h, variant))
    if ranked.maps and not kept:
        raise NoAnswerError(
            f"the {len(ranked.maps)} most probable maps all break the axioms in use "
            f"({variant.describe()}); let minimality decide (--minimal cardinality), or ask for "
            "more maps"
        )
    return replace(ranked, maps=kept, proven=ranked.proven and kept == ranked.maps)


def _rank_by_posterior(experience: Experience, best: int, budget_s: float | None) -> RankedMaps:
    from hssh_kb.search import search_maps

    start = time.monotonic()
    found = search_maps(experience, best=best, budget_s=budget_s)
    spent = budget_s is not None and time.monotonic() - start >= budget_s
    return RankedMaps(
        found.maps,
        "posterior",
        proven=found.proven,
        # A visit not explained in time is no visit that cannot be explained.
        inconsistent_from=None if spent and not found.contradiction else found.inconsistent_from,
        budget_spent=spent,
        log_evidence=found.log_evidence,
        contradiction=found.contradiction.text if found.contradiction else found.strains,
    )


def _rank_all(
    experience: Experience,
    every: bool,
    best: int | None,
    planarity: bool,
    order: bool,
    budget_s: float | None,
    policy: str,
    variant: Variant,
) -> RankedMaps | None:
    """Enumerate; None if there are too many to do so without having been asked."""
    from hssh_kb.maps import enumerate_maps

    asked = every or not order
    limit = None if asked else COUNT_LIMIT
    if budget_s is not None and asked:
        limit = max(COUNT_LIMIT, round(_RANKED_A_SECOND * budget_s))
    elif budget_s is not None:
        budget_s *= _COUNT_SHARE
    found = enumerate_maps(
        experience,
        order=order,
        planarity=planarity,
        limit=limit,
        budget_s=budget_s,
        variant=variant,
    )
    if not found.complete and not asked:
        return None
    sized = sorted((measure_map(experience, h, policy), i) for i, h in enumerate(found.maps))
    kept = sized[:best] if best else [one for one in sized if every or one[0] == sized[0][0]]
    return RankedMaps(
        tuple(found.maps[i] for _, i in kept),
        "minimal",
        consistent=len(found.maps) if found.complete else None,
        proven=found.complete,
        inconsistent_from=found.inconsistent_from,
        budget_spent=not found.complete,
        policy=policy,
    )


def _rank_by_minimality(
    experience: Experience,
    best: int | None,
    minimal: str,
    planarity: bool,
    budget_s: float | None,
    policy: str,
    variant: Variant,
) -> RankedMaps:
    from hssh_kb.maps import minimal_maps

    found = minimal_maps(
        experience,
        minimal=minimal,
        planarity=planarity,
        budget_s=budget_s,
        policy=policy,
        variant=variant,
    )
    return RankedMaps(
        tuple(found.maps[:best] if best else found.maps),
        "minimal",
        minimality=minimal,
        proven=found.complete,
        inconsistent_from=found.inconsistent_from,
        budget_spent=not found.complete,
        policy=policy,
        penalty=found.costs[0][0] if variant.weights and found.costs else None,
    )


def measure_map(
    experience: Experience, hypothesis: Hypothesis, policy: str = DEFAULT_POLICY
) -> tuple[int, ...]:
    """Return what a policy makes few, then the price of the readings."""
    prices = (
        price_of_reading(hypothesis.reading(experience, v).weight)
        for v in range(len(hypothesis.visits))
        if len(experience.visits[v].readings) > 1
    )
    return (*order_sizes(*count_map(experience, hypothesis), policy), sum(prices))


def order_sizes(paths: int, places: int, policy: str = DEFAULT_POLICY) -> tuple[int, ...]:
    """Return the numbers of paths and places in the order in which a policy compares them.

    Examples
    --------
    >>> order_sizes(4, 5, "places-then-paths"), order_sizes(4, 5, "places-only")
    ((5, 4), (5,))
    """
    orders = {"places-then-paths": (places, paths), "places-only": (places,)}
    return orders.get(policy, (paths, places))


def count_map(experience: Experience, hypothesis: Hypothesis) -> tuple[int, int]:
    """Return (paths, places) of a map, the order in which minimality counts them.

    Every local-path of a place is a path of its own until a travel joins it to another; made for
    thousands of maps, without building their graphs.
    """
    parent: dict[tuple[int, int], tuple[int, int]] = {}

    def find(path: tuple[int, int]) -> tuple[int, int]:
        while (above := parent.get(path, path)) != path:
            path = above
        return path

    visits, offsets, readings = hypothesis.visits, hypothesis.offsets, hypothesis.readings
    lived = [
        visit.readings[readings[v] if readings else 0]
        for v, visit in enumerate(experience.visits[: len(visits)])
    ]
    stars = {place: lived[place].star.opposites for place in hypothesis.places}
    count = sum(len(opposites) for opposites in stars.values()) // 2

    def local_path(v: int, dlp: int) -> tuple[int, int]:
        opposites = stars[visits[v]]
        k = (dlp + offsets[v]) % len(opposites)
        return visits[v], min(k, opposites[k])

    for v in range(1, len(visits)):
        depart, arrive = lived[v - 1].depart, lived[v].arrive
        if depart is None or arrive is None or v in hypothesis.doubted:
            continue
        one, other = find(local_path(v - 1, depart)), find(local_path(v, arrive))
        if one != other:
            parent[one] = other
            count -= 1
    return count, len(stars)


def tabulate_maps(experience: Experience, ranked: RankedMaps) -> tuple[MapRow, ...]:
    """Return the maps of a ranking as numbered rows that say which of them tie."""
    keys = list[tuple[float, ...]]()
    sizes = list[tuple[int, int]]()
    for hypothesis in ranked.maps:
        sizes.append(count_map(experience, hypothesis))
        posterior = hypothesis.log_posterior
        if ranked.ranked_by == "posterior" and posterior is not None:
            keys.append((posterior,))
        else:  # every subset-minimal map is as good as any other
            measured = measure_map(experience, hypothesis, ranked.policy)
            keys.append(() if ranked.minimality == "subset" else measured)
    table = list[MapRow]()
    first, last = 0, 0
    for i, hypothesis in enumerate(ranked.maps):
        if i == last:  # the maps come best first, so those that tie stand together
            first = i
            while last < len(keys) and _same(keys[last], keys[first]):
                last += 1
        paths, places = sizes[i]
        share = weigh_map(ranked, hypothesis)
        table.append(MapRow(i + 1, first + 1, last - first, places, paths, hypothesis, share))
    return tuple(table)


def weigh_map(ranked: RankedMaps, hypothesis: Hypothesis) -> float | None:
    """Return the probability of a map: its share of the posterior of all maps that were found.

    Maps that were never grown have no share, so it is the share of what the search met. None
    where minimality decided.
    """
    if ranked.log_evidence is None or hypothesis.log_posterior is None:
        return None
    return min(math.exp(hypothesis.log_posterior - ranked.log_evidence), 1.0)


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    return all(abs(x - y) <= _EQUAL * max(1.0, abs(x)) for x, y in zip(a, b, strict=True))
