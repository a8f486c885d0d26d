"""Routes over a place graph: the shortest way, as typed steps and then as English.

Source: the rules of wording are ours, after counts of how people word routes (MacMahon,
Stankiewicz and Kuipers' SAIL corpus): heading-relative, silent where there is no choice,
openings counted on the side one turns to, a forced turn at an end said.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from hssh_kb.errors import InternalError, NoAnswerError
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.place_graph import Edge, Place, PlaceGraph
from hssh_kb.route_steps import Step, describe_route, follow_steps
from hssh_kb.wording import word_route, word_steps
from perception.geometry import wrap_angle

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase

_TURN_PRICE = 1e-6  # of two equally long ways, the one with fewer turns
_SAME_DLP_RAD = np.deg2rad(30)


@dataclass(frozen=True)
class Route:
    """A way from place to place, and how to tell it.

    Attributes
    ----------
    start, goal : the places.
    edges : the stretches in order.
    steps : what to do, typed, each with its own text.
    text : the instructions as one paragraph.
    length_m : metres; None where lengths are unknown.
    holds_in : in how many of the ranked maps the same instructions lead from start to goal.
    maps : how many ranked maps there are.
    """

    start: Place
    goal: Place
    edges: tuple[Edge, ...]
    steps: tuple[Step, ...]
    text: str
    length_m: float | None
    holds_in: int
    maps: int

    @property
    def doubted(self) -> tuple[tuple[str, str], ...]:
        """Ends of the stretches on which a place may have gone unnoticed."""
        return tuple((edge.start, edge.goal) for edge in self.edges if edge.doubted)


def find_route(kb: KnowledgeBase, start: str, goal: str, *, number: int = 1) -> Route:
    """Find the shortest travelled way and word it.

    Parameters
    ----------
    kb : the knowledge base.
    start, goal : labels, visits or names of places.
    number : the map to plan on.

    Raises
    ------
    NoAnswerError : no travelled way leads there; tells the nearest place that is reached.
    InputError : there is no such place.
    """
    graph = kb.graph(number)
    origin, target = kb.place(start, number), kb.place(goal, number)
    edges = plan_route(graph, origin.label, target.label)
    if edges is None:  # better a way with a doubt, which is told, than none
        edges = plan_route(graph.believed_or_not, origin.label, target.label)
        graph = replace(graph, edges=graph.edges + tuple(e for e in edges or () if e.doubted))
    if edges is None:
        raise NoAnswerError(_explain_no_route(kb, number, graph, origin, target))
    steps = describe_route(graph, origin, target, edges)
    steps = word_steps(steps, graph)
    if edges and follow_steps(graph, origin.label, edges[0].dlp, steps) != target.label:
        raise InternalError(
            f"the route text from {origin.title} to {target.title} fits another place"
        )
    holds = sum(
        _leads_there(kb, kb.hypothesis(number), n, origin, target, edges, steps)
        for n in range(1, len(kb.hypotheses) + 1)
    )
    lengths = [edge.length_m for edge in edges]
    known = [length for length in lengths if length is not None]
    return Route(
        origin,
        target,
        edges,
        steps,
        word_route(steps, graph, [(e.start, e.goal) for e in edges if e.doubted]),
        sum(known) if len(known) == len(lengths) else None,
        holds,
        len(kb.hypotheses),
    )


def plan_route(graph: PlaceGraph, start: str, goal: str) -> tuple[Edge, ...] | None:
    """Return the stretches of the shortest way, by length if known, else by travels.

    None if no way is known. Of equally short ways the one with fewer turns is taken.
    """
    if start == goal:
        return ()
    states, leaving = nx.DiGraph(), defaultdict[str, list[int]](list)
    for i, edge in enumerate(graph.edges):
        leaving[edge.start].append(i)
    for i, edge in enumerate(graph.edges):
        length = edge.length_m if graph.has_lengths and edge.length_m is not None else 1.0
        if edge.start == start:
            states.add_edge("start", i, weight=0.0)
        if edge.goal == goal:
            states.add_edge(i, "goal", weight=length)
        for j in leaving[edge.goal]:
            turned = graph.edges[j].dlp != edge.arrive
            states.add_edge(i, j, weight=length + _TURN_PRICE * turned)
    try:
        way = nx.dijkstra_path(states, "start", "goal")
    except (nx.NetworkXNoPath, nx.NodeNotFound):
        return None
    return tuple(graph.edges[i] for i in way[1:-1])


def _explain_no_route(
    kb: KnowledgeBase, number: int, graph: PlaceGraph, origin: Place, target: Place
) -> str:
    text = f"no travelled way is known from {origin.title} to {target.title}"
    reached = nx.descendants(graph.graph, origin.label) | {origin.label}
    layout = kb.layout(number)
    if layout is not None:
        index = {f"P{first}": i for i, first in enumerate(kb.hypothesis(number).places)}
        here = layout.poses[index[target.label], :2]
        away = {r: float(np.linalg.norm(layout.poses[index[r], :2] - here)) for r in reached}
        nearest = min(away, key=lambda label: (away[label], label))
        place = graph.places[nearest]
        return (
            f"{text}; the nearest place that is reached is {place.title}, {away[nearest]:.1f} m off"
        )
    titles = sorted(graph.places[label].title for label in reached - {origin.label})
    return f"{text}; from there one reaches {', '.join(titles) if titles else 'no other place'}"


def _leads_there(
    kb: KnowledgeBase,
    own: Hypothesis,
    number: int,
    origin: Place,
    target: Place,
    edges: tuple[Edge, ...],
    steps: tuple[Step, ...],
) -> bool:
    """Whether the instructions, made for one map, lead from start to goal in another."""
    other = kb.hypothesis(number)
    if other is own:
        return True  # followed already
    if max(origin.first, target.first) >= len(other.visits):
        return False
    graph = kb.graph(number)
    start, goal = (f"P{other.visits[place.first]}" for place in (origin, target))
    if not edges:
        return start == goal
    dlp = _carry_dlp(kb, own, other, origin.first, edges[0].dlp)
    if dlp is None:
        return False
    sure_first = replace(graph, edges=graph.doubted + graph.edges)  # the later edge wins
    graphs = graph, sure_first, graph.believed_or_not
    return any(follow_steps(known, start, dlp, steps) == goal for known in graphs)


def _carry_dlp(
    kb: KnowledgeBase, own: Hypothesis, other: Hypothesis, visit: int, dlp: int
) -> int | None:
    """Index, in the star of the other map's place, of a dlp of the first visit to a place."""
    mine, theirs = own.reading(kb.experience, visit), other.reading(kb.experience, visit)
    if mine != theirs:
        if not (mine.headings and theirs.headings):
            return None
        turned = np.abs(wrap_angle(np.array(theirs.headings) - mine.headings[dlp]))
        dlp = int(turned.argmin())
        if turned[dlp] > _SAME_DLP_RAD:
            return None
    return other.place_dlp(kb.experience, visit, dlp)[1]
