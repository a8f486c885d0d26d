"""Where to go next: the observations that would tell the rival maps apart, and two old strategies.

Source: expected entropy over the hypotheses is ours; the exploration agenda and the rehearsal
procedure are those of Kuipers & Byun 1991, sections 3.6 and 3.7.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from hssh_kb.errors import BudgetError, NoAnswerError, UsageError
from hssh_kb.foresight import Foresight, Stand
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.place_graph import PlaceGraph, build_place_graph
from hssh_kb.ranking import RankedMaps, rank_maps
from hssh_kb.walks import Walk, list_walks, measure_turn
from perception.geometry import Array

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase

Strategy = Literal["entropy", "agenda", "rehearsal"]
STRATEGIES: tuple[Strategy, ...] = ("entropy", "agenda", "rehearsal")
WORTH_BITS = 1e-3
"""A travel that removes less doubt than this, in bits, is not said to tell maps apart."""


@dataclass(frozen=True)
class Expectation:
    """What some of the maps expect to see at the end of a walk.

    Attributes
    ----------
    maps : their numbers.
    kind : "view" for a known place; "anything" where the way is unexplored in them; "parted" if
        they expected something else on the way already.
    places : what the place is called in them; empty unless "view".
    star : the star there, clockwise from the dlp faced on arrival; empty unless "view".
    text : in words.
    """

    maps: tuple[int, ...]
    kind: Literal["view", "anything", "parted"]
    places: tuple[str, ...]
    star: tuple[str, ...]
    text: str


@dataclass(frozen=True)
class Suggestion:
    """One place to go and way to take there.

    Attributes
    ----------
    rank, tie : one more than the number of better ones, and how many share the rank.
    kind : "frontier" for a way never taken, "revisit" for one taken before.
    walk : the way there and the dlp to leave by.
    entropy_bits : expected entropy of the maps after the walk.
    gain_bits : by how much that is less than now.
    rate_bits : gain per unit of length, see :class:`Exploration`.
    expects : what each map expects to see at the end.
    route_text : how to get to the place; empty if one is there.
    text : where to go and why, in words.
    """

    rank: int
    tie: int
    kind: Literal["frontier", "revisit"]
    walk: Walk
    entropy_bits: float
    gain_bits: float
    rate_bits: float
    expects: tuple[Expectation, ...]
    route_text: str
    text: str


@dataclass(frozen=True)
class Exploration:
    """Where to go next, best first.

    Attributes
    ----------
    strategy : the strategy asked for.
    used : the strategy that answered: "agenda" where no observation is expected to tell the maps
        apart, or nothing is left to rehearse.
    graph : the map that the walks are planned on. number : which of the maps that is.
    at : label of the place where the robot is.
    weights : probability of each map.
    entropy_bits : entropy of the maps now.
    unit : of lengths: "m", or "travels" where lengths are unknown.
    doubted : the visit whose place is tested, for a rehearsal; None otherwise.
    unreached : places with unexplored ways to which no known way leads from here.
    suggestions : best first. found : how many there are, shown or not.
    text : the answer in one or two sentences, ties told.
    """

    strategy: Strategy
    used: Strategy
    graph: PlaceGraph
    number: int
    at: str
    weights: tuple[float, ...]
    entropy_bits: float
    unit: str
    doubted: int | None
    unreached: tuple[str, ...]
    suggestions: tuple[Suggestion, ...]
    found: int
    text: str


def explore(
    kb: KnowledgeBase,
    strategy: Strategy = "entropy",
    *,
    best: int | None = 5,
    every: bool = False,
    budget_s: float | None = None,
) -> Exploration:
    """Rank the ways to go next by what an observation there would tell.

    The rival maps are the ranked ones: weighed by their posterior where that decided, all equal
    where minimality decided (then only those that tie for the best). A walk is a shortest known
    way to a place, then one travel more: through a frontier, or again along a known edge. It is
    valued by the expected loss of entropy per unit of length, so that a little doubt removed near
    by may come before much removed far away; a walk whose last travel tells nothing is left out.

    Parameters
    ----------
    kb : the knowledge base; the robot is taken to be where its last visit was.
    strategy : "entropy"; "agenda" for the nearest unexplored way; "rehearsal" for testing the
        last doubtful recognition of a place.
    best : how many to return; None for all.
    every : weigh all consistent maps, not only the ranked ones: by their posterior where there are
        displacements, else alike.
    budget_s : seconds that finding all of them may take.

    Raises
    ------
    NoAnswerError : no map explains the whole experience; or there is no way left to suggest.
    UsageError : no such strategy.
    BudgetError : too many maps for the budget.

    Source
    ------
    Ours; Kuipers & Byun 1991, sections 3.6 and 3.7, for the strategies of that name.
    """
    from hssh_kb.explore_words import tell_suggestion, tell_summary

    if strategy not in STRATEGIES:
        raise UsageError(f"there is no strategy {strategy!r}: use {', '.join(STRATEGIES)}")
    ranked = _choose_rivals(kb, every, budget_s)
    weights = weigh_rivals(ranked)
    maps = ranked.maps[: len(weights)]
    doubted, lead = None, 0
    if strategy == "rehearsal":
        doubted, lead = find_doubt(maps, weights)
    foresight = Foresight(kb.experience, maps, weights, lead=lead)
    graph = _draw_graph(kb, maps[lead])
    walks = list_walks(graph, foresight)
    used, chosen = _select(strategy, graph, walks, doubted, maps[lead])
    if not chosen:
        also = "" if strategy == "agenda" else ", and no observation is expected to tell maps apart"
        raise NoAnswerError(f"there is nothing left to explore: every way was taken{also}")
    start = foresight.start()
    unit = "m" if graph.has_lengths and graph.edges else "travels"
    suggestions = tuple(
        tell_suggestion(graph, foresight, walk, rank, tie, unit)
        for walk, rank, tie in _rank(chosen, used)[:best]
    )
    stand = start.stands[lead]
    at = f"P{(stand or Stand(0, 0)).place}"
    found = Exploration(
        strategy,
        used,
        graph,
        lead + 1,
        at,
        tuple(weights.tolist()),
        start.entropy_bits,
        unit,
        doubted,
        _list_unreached(graph, walks),
        suggestions,
        len(chosen),
        "",
    )
    return tell_summary(found, maps)


def weigh_rivals(ranked: RankedMaps) -> Array:
    """Return the probabilities (n,) of the first n maps of a ranking, the rivals.

    The normalised posterior where it decided; equal weights among the maps that tie for the best
    where minimality decided.
    """
    posteriors = [h.log_posterior for h in ranked.maps]
    known = [p for p in posteriors if p is not None]
    if ranked.ranked_by == "posterior" and len(known) == len(posteriors):
        shares = np.exp(np.array(known) - max(known))
        return np.asarray(shares / shares.sum())
    return np.full(len(posteriors), 1.0 / len(posteriors))


def _choose_rivals(kb: KnowledgeBase, every: bool, budget_s: float | None) -> RankedMaps:
    """Return the maps among which there is doubt; each explains the whole experience."""
    ranked = kb.ranked
    if every:
        ranked = rank_maps(kb.experience, every=True, budget_s=budget_s)
        if ranked.budget_spent:
            raise BudgetError(
                "the budget was spent before all maps were found; weigh the ranked ones "
                "(without --all), or give more seconds (--budget)"
            )
    if ranked.inconsistent_from is not None or not ranked.maps:
        at = "" if ranked.inconsistent_from is None else f" from v{ranked.inconsistent_from} on"
        raise NoAnswerError(
            f"no map explains the experience{at}, so it is not known where the robot is; "
            "'hssh check' says why"
        )
    if every and kb.experience.has_displacements:
        return _score_all(kb, ranked)
    if every or ranked.ranked_by == "posterior":
        return ranked
    ties = kb.rows[0].tie
    return replace(ranked, maps=ranked.maps[:ties])


def _score_all(kb: KnowledgeBase, ranked: RankedMaps) -> RankedMaps:
    """Return all maps with their posteriors, best first."""
    from hssh_kb.map_tree import score_hypothesis
    from hssh_kb.score import estimate_score

    score = estimate_score(kb.experience)
    scored = [score_hypothesis(kb.experience, h, score) for h in ranked.maps]
    scored.sort(key=lambda h: -(h.log_posterior or 0.0))
    return replace(ranked, maps=tuple(scored), ranked_by="posterior")


def _draw_graph(kb: KnowledgeBase, hypothesis: Hypothesis) -> PlaceGraph:
    return build_place_graph(kb.experience, hypothesis, names=kb.names, lengths_m=kb.lengths_m)


def _list_unreached(graph: PlaceGraph, walks: Sequence[Walk]) -> tuple[str, ...]:
    reached = {walk.place for walk in walks}
    return tuple(p.label for p in graph.places.values() if p.frontiers and p.label not in reached)


def _select(
    strategy: Strategy,
    graph: PlaceGraph,
    walks: Sequence[Walk],
    doubted: int | None,
    lead: Hypothesis,
) -> tuple[Strategy, list[Walk]]:
    """Return the walks of a strategy, best first, and the strategy that gave them."""
    if strategy == "entropy":
        informative = select_informative(walks)
        if informative:
            return "entropy", informative
    if strategy == "rehearsal" and doubted is not None:
        rehearsals = select_rehearsals(walks, doubted, lead)
        if rehearsals:
            return "rehearsal", rehearsals
    return "agenda", select_agenda(graph, walks)


def select_informative(walks: Iterable[Walk]) -> list[Walk]:
    """Return the walks whose last travel tells maps apart, most bits per length first.

    Source
    ------
    Ours.
    """
    telling = [walk for walk in walks if walk.last_gain_bits > WORTH_BITS]
    return sorted(
        telling,
        key=lambda walk: (-round(walk.rate_bits, 9), walk.length, walk.edge is not None, walk.key),
    )


def select_agenda(graph: PlaceGraph, walks: Iterable[Walk]) -> list[Walk]:
    """Return the exploration agenda: the unexplored ways, nearest first.

    (Place, direction) is on the agenda if the place was visited, and neither left in that
    direction nor come back to from it. At one place the sharpest turn comes first, which is the
    order that the source suggests for leaving few loose ends; nearest first is ours.

    Source
    ------
    Kuipers & Byun 1991, section 3.6.
    """
    open_ways = [walk for walk in walks if walk.edge is None]
    return sorted(
        open_ways, key=lambda walk: (walk.way_length, -measure_turn(graph, walk), walk.key)
    )


def find_doubt(maps: Sequence[Hypothesis], weights: Array) -> tuple[int | None, int]:
    """Return the recognition to rehearse: a visit, and the map that recognises a place in it.

    That is the last visit of which some maps say that it was to a known place and others that it
    was not to that one; of the former the weightiest map. Without such a visit it is the last one
    at which the first map recognises a place; None if it recognises none.

    Source
    ------
    Kuipers & Byun 1991, section 3.7: the hypothesis that the current place is a known one.
    """
    for v in range(len(maps[0].visits) - 1, 0, -1):
        closing = [i for i, h in enumerate(maps) if h.visits[v] != v]
        if closing and len({(h.visits[v], h.offsets[v]) for h in maps}) > 1:
            return v, max(closing, key=lambda i: (weights[i], -i))
    known = [v for v, place in enumerate(maps[0].visits) if place != v]
    return (known[-1] if known else None), 0


def select_rehearsals(walks: Iterable[Walk], doubted: int, lead: Hypothesis) -> list[Walk]:
    """Return the walks that rehearse: known ways from the doubted place to its neighbours.

    The map that recognises the place foretells what lies at the far end of each way that was
    known before; if something else comes, the visit was to another place. Those that are expected
    to tell most come first. Only the neighbours are looked at, as in the source; one comes back
    the same way.

    Source
    ------
    Kuipers & Byun 1991, section 3.7.
    """
    place = f"P{lead.visits[doubted]}"
    known = [
        walk
        for walk in walks
        if walk.place == place
        and walk.edge is not None
        and not walk.edge.doubted
        and min(walk.edge.travels) < doubted
    ]
    return sorted(known, key=lambda walk: (-round(walk.gain_bits, 9), walk.length, walk.key))


def _rank(walks: Sequence[Walk], used: Strategy) -> list[tuple[Walk, int, int]]:
    """Give each walk its rank and how many share it."""
    if used == "entropy":
        merits = [round(walk.rate_bits, 9) for walk in walks]
    elif used == "rehearsal":
        merits = [round(walk.gain_bits, 9) for walk in walks]
    else:
        merits = [round(walk.way_length, 9) for walk in walks]
    return [
        (walk, merits.index(merit) + 1, merits.count(merit))
        for walk, merit in zip(walks, merits, strict=True)
    ]
