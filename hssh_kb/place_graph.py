"""The place graph of a hypothesis: places, travelled edges and directed paths with their order.

Source: paths, ``on`` and ``order`` as in Beeson, Modayil & Kuipers 2010, section 3.3; the
union-find construction is ours.
"""

from __future__ import annotations

import string
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import networkx as nx
from networkx.utils import UnionFind

from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from perception.star import Star

PlaceDlp = tuple[int, int]
"""A dlp of a place: (index of the first visit of the place, index in its star)."""


@dataclass(frozen=True)
class Place:
    """A place of a hypothesis.

    Attributes
    ----------
    label : "P" and the number of its first visit.
    name : what the user calls it; None if nameless.
    visits : the visits to it, in order of time.
    star : its star; the reading chosen at the first visit.
    headings_rad : direction of each dlp in the place frame, counter-clockwise; empty if unknown.
    frontiers : dlps with alpha 1 that have never been travelled.
    """

    label: str
    name: str | None
    visits: tuple[int, ...]
    star: Star
    headings_rad: tuple[float, ...]
    frontiers: tuple[int, ...]

    @property
    def first(self) -> int:
        """The first visit."""
        return self.visits[0]

    @property
    def title(self) -> str:
        """The user's name if there is one, else the label."""
        return self.name or self.label


@dataclass(frozen=True)
class Edge:
    """A travelled stretch between two places, seen in one direction.

    Attributes
    ----------
    start, goal : labels of the places.
    dlp : index of the dlp of ``start`` that leads along it.
    arrive : index of the dlp of ``goal`` that one faces on arrival.
    path, forward : name of the path, and whether the edge runs along its forward direction.
    length_m : mean length over the travels, metres; None if unknown.
    travels : the visits at the end of each travel over it, in either direction.
    doubted : True if a place may have gone unnoticed on the way.
    """

    start: str
    dlp: int
    goal: str
    arrive: int
    path: str
    forward: bool
    length_m: float | None
    travels: tuple[int, ...]
    doubted: bool = False


@dataclass(frozen=True)
class Path:
    """A path: a class of local-paths joined by travel.

    Attributes
    ----------
    name : a letter if some of it was travelled, else "s" (for stub) and a number.
    places : labels of the places on it, in the order of its forward direction.
    travelled : whether the robot has been along it.
    circular : True if no order exists, which the order axioms forbid.
    """

    name: str
    places: tuple[str, ...]
    travelled: bool
    circular: bool = False


@dataclass(frozen=True)
class PlaceGraph:
    """Places, edges (both directions of each) and paths of one hypothesis.

    ``doubted`` are stretches that were driven, but on which the hypothesis believes that a place
    may have gone unnoticed; they are part of no path.
    """

    places: Mapping[str, Place]
    edges: tuple[Edge, ...]
    paths: tuple[Path, ...]
    path_of_dlp: Mapping[tuple[str, int], tuple[str, bool]]
    doubted: tuple[Edge, ...] = ()

    @cached_property
    def believed_or_not(self) -> PlaceGraph:
        """The same graph with the doubted stretches among its edges."""
        return replace(self, edges=self.edges + self.doubted, doubted=())

    @cached_property
    def graph(self) -> nx.MultiDiGraph:
        """As a networkx graph: nodes are labels, attributes those of Place and Edge."""
        graph = nx.MultiDiGraph()
        for label, place in self.places.items():
            graph.add_node(label, name=place.name, visits=place.visits, star=str(place.star))
        for edge in self.edges:
            graph.add_edge(
                edge.start,
                edge.goal,
                key=edge.dlp,
                dlp=edge.dlp,
                arrive=edge.arrive,
                path=edge.path,
                forward=edge.forward,
                length_m=edge.length_m,
                travels=edge.travels,
            )
        return graph

    @cached_property
    def edge_at(self) -> Mapping[tuple[str, int], Edge]:
        """The edge that leaves a place along a dlp, by (label, dlp)."""
        return {(edge.start, edge.dlp): edge for edge in self.edges}

    @cached_property
    def has_lengths(self) -> bool:
        """True if every edge has a length."""
        return all(edge.length_m is not None for edge in self.edges)

    @property
    def undirected_edges(self) -> tuple[Edge, ...]:
        """Each stretch once, in the direction of its first travel."""
        return self.edges[::2]


def build_place_graph(
    experience: Experience,
    hypothesis: Hypothesis,
    *,
    names: Mapping[int, str] | None = None,
    lengths_m: Mapping[int, float] | None = None,
) -> PlaceGraph:
    """Build the place graph of a hypothesis.

    Parameters
    ----------
    experience, hypothesis : what was lived through, and one map of it.
    names : user names by visit; they win over the names in the experience.
    lengths_m : length of each travel by the visit it leads to, metres; the displacement's norm
        where absent.

    Returns
    -------
    The graph. Travels that the hypothesis doubts make no edge.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> experience = make_experience([
    ...     (["a+1", "a-0"], None, 0), (["b-0", "b+1"], 0, 1), (["c+1", "c-0"], 1, None)])
    >>> graph = build_place_graph(experience, Hypothesis((0, 1, 0), (0, 0, 0)))
    >>> [(path.name, path.places) for path in graph.paths]
    [('A', ('P0', 'P1'))]
    >>> sorted(graph.graph.edges())
    [('P0', 'P1'), ('P1', 'P0')]
    """
    links = _find_links(experience, hypothesis)
    places = _make_places(experience, hypothesis, links, names or {})
    classes = _join_dlps(places, links)
    paths, path_of_dlp = _name_paths(places, links, classes)
    make = _EdgeMaker(experience, places, path_of_dlp, lengths_m or {})
    edges = [edge for link, travels in links.items() for edge in make(link, travels)]
    doubted = _find_doubted(experience, hypothesis, {(edge.start, edge.dlp) for edge in edges})
    unsure = [edge for link, v in doubted.items() for edge in make(link, (v,), doubted=True)]
    return PlaceGraph(places, tuple(edges), paths, path_of_dlp, tuple(unsure))


Links = dict[tuple[PlaceDlp, PlaceDlp], tuple[int, ...]]


def _find_links(experience: Experience, hypothesis: Hypothesis) -> Links:
    """Travels by the dlps they join, each link once whichever way it was first travelled."""
    links: dict[tuple[PlaceDlp, PlaceDlp], list[int]] = {}
    for v in range(1, len(experience)):
        link = _find_link(experience, hypothesis, v)
        if link is None or v in hypothesis.doubted:
            continue
        reverse = _reverse_link(experience, hypothesis, *link)
        links.setdefault(reverse if reverse in links else link, []).append(v)
    return {link: tuple(travels) for link, travels in links.items()}


def _find_doubted(
    experience: Experience, hypothesis: Hypothesis, taken: set[tuple[str, int]]
) -> dict[tuple[PlaceDlp, PlaceDlp], int]:
    """Doubted travels that lead to or from a gateway of which nothing better is known."""
    found = {}
    for v in hypothesis.doubted:
        link = _find_link(experience, hypothesis, v)
        if link is None:
            continue
        back, _ = _reverse_link(experience, hypothesis, *link)
        ends = {(f"P{place}", k) for place, k in (link[0], back)}
        if len(ends) == 2 and not ends <= taken:
            found[link] = v
            taken |= ends
    return found


def _find_link(
    experience: Experience, hypothesis: Hypothesis, visit: int
) -> tuple[PlaceDlp, PlaceDlp] | None:
    depart = hypothesis.reading(experience, visit - 1).depart
    arrive = hypothesis.reading(experience, visit).arrive
    if depart is None or arrive is None:
        return None
    return (
        hypothesis.place_dlp(experience, visit - 1, depart),
        hypothesis.place_dlp(experience, visit, arrive),
    )


class _EdgeMaker:
    """Makes both directions of an edge from the dlps it joins."""

    def __init__(
        self,
        experience: Experience,
        places: Mapping[str, Place],
        path_of_dlp: Mapping[tuple[str, int], tuple[str, bool]],
        lengths_m: Mapping[int, float],
    ) -> None:
        self.experience, self.places, self.lengths_m = experience, places, lengths_m
        self.path_of_dlp = path_of_dlp

    def __call__(
        self,
        link: tuple[PlaceDlp, PlaceDlp],
        travels: tuple[int, ...],
        *,
        doubted: bool = False,
    ) -> tuple[Edge, Edge]:
        """Return the edge there and the edge back."""
        (p, d), (q, a) = link
        start, goal = self.places[f"P{p}"], self.places[f"P{q}"]
        lengths = [_travel_length(self.experience, v, self.lengths_m) for v in travels]
        known = [length for length in lengths if length is not None]
        mean = sum(known) / len(known) if known else None
        path, forward = self.path_of_dlp[start.label, d]
        there = Edge(start.label, d, goal.label, a, path, forward, mean, travels, doubted=doubted)
        d_back, a_back = goal.star.opposite(a), start.star.opposite(d)
        path, forward = self.path_of_dlp[goal.label, d_back]
        back = Edge(
            goal.label, d_back, start.label, a_back, path, forward, mean, travels, doubted=doubted
        )
        return there, back


def _reverse_link(
    experience: Experience, hypothesis: Hypothesis, start: PlaceDlp, goal: PlaceDlp
) -> tuple[PlaceDlp, PlaceDlp]:
    star_p = hypothesis.reading(experience, start[0]).star
    star_q = hypothesis.reading(experience, goal[0]).star
    return (goal[0], star_q.opposite(goal[1])), (start[0], star_p.opposite(start[1]))


def _make_places(
    experience: Experience, hypothesis: Hypothesis, links: Links, names: Mapping[int, str]
) -> dict[str, Place]:
    visits: dict[int, list[int]] = defaultdict(list)
    for v, place in enumerate(hypothesis.visits):
        visits[place].append(v)
    travelled = set[PlaceDlp]()
    for start, (q, a) in links:
        travelled |= {start, (q, hypothesis.reading(experience, q).star.opposite(a))}
    places = {}
    for first in hypothesis.places:
        reading = hypothesis.reading(experience, first)
        own = [names[v] for v in visits[first] if v in names]
        told = [experience.visits[v].name for v in visits[first]]
        found = [name for name in (*own, *told) if name]
        frontiers = tuple(
            k for k, alpha in enumerate(reading.star.alpha) if alpha and (first, k) not in travelled
        )
        places[f"P{first}"] = Place(
            f"P{first}",
            found[0] if found else None,
            tuple(visits[first]),
            reading.star,
            reading.headings,
            frontiers,
        )
    return places


def _join_dlps(places: Mapping[str, Place], links: Links) -> UnionFind:
    """Classes of (place, dlp): each class is one directed path."""
    opposite = {place.first: place.star.opposites for place in places.values()}
    classes = UnionFind((p, k) for p, back in opposite.items() for k in range(len(back)))
    for (p, d), (q, a) in links:
        classes.union((p, d), (q, a))
        classes.union((p, opposite[p][d]), (q, opposite[q][a]))
    return classes


def _name_paths(
    places: Mapping[str, Place], links: Links, classes: UnionFind
) -> tuple[tuple[Path, ...], dict[tuple[str, int], tuple[str, bool]]]:
    label = {place.first: place.label for place in places.values()}
    star = {place.first: place.star for place in places.values()}
    named: dict[PlaceDlp, tuple[str, bool]] = {}
    paths = list[Path]()
    seeds = [start for start, _ in links]
    seeds += [(p, k) for p in star for k in range(len(star[p]))]
    for n, (p, d) in enumerate(seeds):
        forward, backward = classes[p, d], classes[p, star[p].opposite(d)]
        if forward in named:
            continue
        travelled = n < len(links)
        count = sum(path.travelled == travelled for path in paths)
        name = name_path(count) if travelled else f"s{count + 1}"
        named[backward], named[forward] = (name, False), (name, True)
        on_path, circular = _order_places((p, d), links, classes, star)
        paths.append(Path(name, tuple(label[q] for q in on_path), travelled, circular))
    path_of_dlp = {(label[p], k): named[classes[p, k]] for p in star for k in range(len(star[p]))}
    return tuple(paths), path_of_dlp


def _order_places(
    seed: PlaceDlp, links: Links, classes: UnionFind, star: Mapping[int, Star]
) -> tuple[list[int], bool]:
    """Places of the directed path of ``seed`` in order, and whether the order is circular."""
    forward, order = classes[seed], nx.DiGraph()
    order.add_node(seed[0])
    for (p, d), (q, _) in links:
        if classes[p, d] == forward:
            order.add_edge(p, q)
        elif classes[p, star[p].opposite(d)] == forward:
            order.add_edge(q, p)
    try:
        return list(nx.lexicographical_topological_sort(order)), False
    except nx.NetworkXUnfeasible:
        return sorted(order.nodes), True


def name_path(index: int) -> str:
    """Return the name of the index-th travelled path: A to Z, then AA, AB and so on.

    Examples
    --------
    >>> name_path(0), name_path(25), name_path(26)
    ('A', 'Z', 'AA')
    """
    letters = string.ascii_uppercase
    name = ""
    index += 1
    while index:
        index, rest = divmod(index - 1, 26)
        name = letters[rest] + name
    return name


def _travel_length(
    experience: Experience, visit: int, lengths_m: Mapping[int, float]
) -> float | None:
    if visit in lengths_m:
        return lengths_m[visit]
    displacement = experience.visits[visit].displacement
    return None if displacement is None else float((displacement.x**2 + displacement.y**2) ** 0.5)
