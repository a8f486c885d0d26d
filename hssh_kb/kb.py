"""The knowledge base: what was lived through, the maps of it, and the questions one asks."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Visit
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.place_graph import Place, PlaceGraph, build_place_graph
from hssh_kb.ranking import MapRow, RankedBy, RankedMaps, rank_maps, tabulate_maps
from hssh_kb.records import BuildRecord, PlaceLayout, Raster, Trajectory

if TYPE_CHECKING:
    from hssh_kb.boundary import Boundary
    from hssh_kb.change_of_mind import ChangeOfMind
    from hssh_kb.check import Check, NewPlace
    from hssh_kb.explore import Exploration, Strategy
    from hssh_kb.query import QueryAnswer
    from hssh_kb.route import Route
    from hssh_kb.variant import Variant
    from hssh_kb.why import Derivation


@dataclass(frozen=True)
class KnowledgeBase:
    """An experience with its ranked map hypotheses, their layouts, and answers about them.

    Attributes
    ----------
    experience : visits and travels.
    ranked : the hypotheses, best first, and what decided.
    layouts : where the places lie, one a hypothesis, None where no displacement says so; may be
        shorter than the list of hypotheses.
    lpms : local perceptual map of each visit in its place frame; empty for a trace.
    trajectory, global_map : the drive and the grid drawn from it, on the first hypothesis.
    names : user names by visit; they win over the names in the experience.
    record : where all this came from.

    Examples
    --------
    A robot leaves a dead end, turns right at a T and comes to another dead end:

    >>> from hssh_kb.trace import make_experience
    >>> dead_end, t = ["a+0", "a-1"], ["a+0", "b+1", "a-1", "b-1"]
    >>> walk = make_experience([(["a+1", "a-0"], None, 0), (t, 0, 1), (dead_end, 0, None)])
    >>> kb = KnowledgeBase.from_experience(walk)
    >>> kb.hypothesis().visits
    (0, 1, 2)
    >>> print(kb.route("P2", "P0").text.partition("; ")[0])
    Leave P2 by the only way out. At the next junction, turn left
    >>> kb.check(["v2=v0"]).consistent
    False
    >>> kb.graph().places["P1"].frontiers
    (3,)
    """

    experience: Experience
    ranked: RankedMaps
    layouts: tuple[PlaceLayout | None, ...] = ()
    lpms: Mapping[int, Raster] = field(default_factory=dict)
    trajectory: Trajectory | None = None
    global_map: Raster | None = None
    names: Mapping[int, str] = field(default_factory=dict)
    record: BuildRecord = field(default_factory=BuildRecord)

    def __post_init__(self) -> None:
        faults = _find_faults(self)
        if faults:
            raise InputError("; ".join(faults))

    @classmethod
    def build(cls, input_path: str | FilePath, **options: Any) -> KnowledgeBase:  # noqa: ANN401
        """Build a knowledge base from a log or a trace; see :func:`hssh_kb.build.build`.

        Raises
        ------
        InputError : the input cannot be read or breaks its format.
        """
        from hssh_kb.build import build

        return build(input_path, **options)

    @classmethod
    def from_experience(cls, experience: Experience, **options: Any) -> KnowledgeBase:  # noqa: ANN401
        """Rank the maps of an experience; options are those of :func:`rank_maps`."""
        ranked = rank_maps(experience, **options)
        record = BuildRecord(source=experience.source, notices=experience.notices)
        return cls(experience, ranked, record=record)

    @classmethod
    def open(cls, path: str | FilePath) -> KnowledgeBase:
        """Read a knowledge base file; a trace is taken too, its maps then being ranked.

        Raises
        ------
        InputError : neither of the two, or damaged; says what to do.
        """
        from hssh_kb.store import read_kb_or_trace

        found = read_kb_or_trace(path)
        return found if isinstance(found, KnowledgeBase) else cls.from_experience(found)

    def save(self, path: str | FilePath) -> None:
        """Write the knowledge base to one file, whole or not at all."""
        from hssh_kb.store import save_kb

        save_kb(self, path)

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """The ranked maps, best first."""
        return self.ranked.maps

    @property
    def ranked_by(self) -> RankedBy:
        """What decided: "minimal" or "posterior"."""
        return self.ranked.ranked_by

    @cached_property
    def rows(self) -> tuple[MapRow, ...]:
        """The ranked maps with rank, ties and sizes."""
        return tabulate_maps(self.experience, self.ranked)

    def maps(self, **options: Any) -> RankedMaps:  # noqa: ANN401
        """Return the stored ranking, or a new one if options of :func:`rank_maps` are given."""
        return rank_maps(self.experience, **options) if options else self.ranked

    def extend(
        self, visit: Visit, *, depart: int | None = None
    ) -> tuple[KnowledgeBase, ChangeOfMind | None]:
        """Take in one more visit; see :func:`hssh_kb.live_map.extend_kb`.

        Raises
        ------
        InputError : the way out of the visit before is not known, or the visit lacks what a
            travel needs.
        """
        from hssh_kb.live_map import extend_kb

        return extend_kb(self, visit, depart=depart)

    def hypothesis(self, number: int = 1) -> Hypothesis:
        """Return the map with a number (its line in the list of maps, from 1).

        Raises
        ------
        InputError : there is no such map.
        """
        if not 1 <= number <= len(self.hypotheses):
            raise InputError(
                f"there is no map {number}: this knowledge base holds "
                f"{len(self.hypotheses)} ranked map{'s' * (len(self.hypotheses) != 1)}"
            )
        return self.hypotheses[number - 1]

    def layout(self, number: int = 1) -> PlaceLayout | None:
        """Return where the places of a map lie; None if nothing was measured."""
        self.hypothesis(number)
        return self.layouts[number - 1] if number <= len(self.layouts) else None

    @cached_property
    def lengths_m(self) -> dict[int, float]:
        """Length of each travel, by the visit it leads to: as driven, else as displaced."""
        lengths = {
            v: math.hypot(visit.displacement.x, visit.displacement.y)
            for v, visit in enumerate(self.experience.visits)
            if visit.displacement is not None
        }
        drive = self.trajectory
        if drive is not None and len(drive.visit_scans) == len(self.experience):
            for v in range(1, len(self.experience)):
                first, last = sorted(drive.visit_scans[v - 1 : v + 1])
                steps = drive.poses[first : last + 1, :2]
                driven = sum(math.dist(a, b) for a, b in itertools.pairwise(steps))
                lengths[v] = max(float(driven), lengths.get(v, 0.0))
        return lengths

    def graph(self, number: int = 1) -> PlaceGraph:
        """Return places, edges and paths of a map."""
        hypothesis = self.hypothesis(number)
        lived = Experience(self.experience.visits[: len(hypothesis.visits)], self.experience.source)
        return build_place_graph(lived, hypothesis, names=self.names, lengths_m=self.lengths_m)

    def place(self, query: str, number: int = 1) -> Place:
        """Find a place by label (``P3``), visit (``v7``) or user name, case aside.

        Raises
        ------
        InputError : no place or several places are called so; the nearest names are told.
        """
        return find_place(self.graph(number), query)

    def route(self, start: str, goal: str, *, number: int = 1) -> Route:
        """Return route instructions from place to place.

        Raises
        ------
        NoAnswerError : no travelled way leads there; tells the nearest place that is reached.
        InputError : there is no such place.
        """
        from hssh_kb.route import find_route

        return find_route(self, start, goal, number=number)

    def check(self, assume: Iterable[str] = (), *, budget_s: float = 20.0) -> Check:
        """Say which axioms the experience, with assumptions such as ``v7=v2``, violates."""
        from hssh_kb.check import check

        return check(self.experience, assumptions=list(assume), budget_s=budget_s)

    def query(
        self,
        query: str,
        *,
        every: bool = False,
        best: int | None = None,
        budget_s: float | None = 60.0,
    ) -> QueryAnswer:
        """Ask a conjunction such as ``at(V,P), on(H,P)`` of the ranked maps (of ``best`` of them).

        With ``every``, of all consistent maps instead. See :func:`hssh_kb.query.query_maps`.

        Raises
        ------
        InputError : the query cannot be read, is unsafe, or uses a predicate that there is not.
        BudgetError : the budget was spent on the first map.
        """
        from hssh_kb.query import query_all_maps, query_maps

        if every:
            return query_all_maps(self.experience, query, budget_s=budget_s)
        return query_maps(self.experience, self.hypotheses[:best], query, budget_s=budget_s)

    def explain(self, atom: str, number: int = 1) -> Derivation:
        """Say why an atom such as ``on(path(0,0),2)`` holds in a map, as a derivation tree.

        Raises
        ------
        InputError : not one ground atom.
        NoAnswerError : it does not hold in this map.
        """
        from hssh_kb.why import explain_holds

        hypothesis = self.hypothesis(number)
        lived = Experience(self.experience.visits[: len(hypothesis.visits)], self.experience.source)
        return explain_holds(lived, hypothesis, atom)

    def explain_new(
        self, visit: int | str, *, budget_s: float = 20.0, variant: Variant | None = None
    ) -> NewPlace:
        """Say why a visit (its number, ``v9`` or its name) is a new place.

        Raises
        ------
        InputError : there is no such visit.
        """
        from hssh_kb.check import explain_new, find_visit

        number = visit if isinstance(visit, int) else find_visit(self.experience, visit)
        return explain_new(self.experience, number, budget_s=budget_s, variant=variant)

    def sides(self, number: int = 1, *, budget_s: float | None = None) -> tuple[Boundary, ...]:
        """Return what lies left and right of each path; see :mod:`hssh_kb.boundary`.

        Raises
        ------
        InputError : there is no such map, or it does not reach the last visit.
        BudgetError : not one choice was found in time.
        """
        from hssh_kb.boundary import find_boundaries

        return find_boundaries(self.experience, self.hypothesis(number), budget_s=budget_s)

    def explore(self, strategy: Strategy = "entropy", **options: Any) -> Exploration:  # noqa: ANN401
        """Rank the ways to go next by what they would tell; see :func:`hssh_kb.explore.explore`.

        Raises
        ------
        NoAnswerError : nothing is left to explore, or no map explains the experience.
        """
        from hssh_kb.explore import explore

        return explore(self, strategy, **options)

    def show(
        self,
        path: str | FilePath,
        *,
        route: tuple[str, str] | None = None,
        number: int = 1,
    ) -> None:
        """Draw a map to an SVG or PNG file, by the ending of its name."""
        from hssh_kb.show import show_map

        show_map(self, path, route=route, number=number)

    def export(self, path: str | FilePath) -> tuple[FilePath, ...]:
        """Write ``.json``, ``.lp`` or ``.pgm`` (with its ``.yaml``); return the files written."""
        from hssh_kb.export import export_kb

        return export_kb(self, path)


def find_place(graph: PlaceGraph, query: str) -> Place:
    """Find a place of a graph by label, visit or user name, case aside.

    Raises
    ------
    InputError : no place or several places are called so.
    """
    asked = query.strip().casefold()
    named = [p for p in graph.places.values() if p.name and p.name.casefold() == asked]
    if len(named) > 1:
        labels = ", ".join(place.label for place in named)
        raise InputError(f"{query!r} is the name of several places ({labels}); give the label")
    if named:
        return named[0]
    for place in graph.places.values():
        if place.label.casefold() == asked or asked in {f"v{v}" for v in place.visits}:
            return place
    titles = [p.name for p in graph.places.values() if p.name] + list(graph.places)
    folded = {title.casefold(): title for title in titles}
    near = [folded[key] for key in difflib.get_close_matches(asked, folded, n=3)]
    hint = f"did you mean {' or '.join(map(repr, near))}?" if near else _list_titles(titles)
    raise InputError(f"no place is called {query!r}; {hint}")


def _list_titles(titles: list[str]) -> str:
    shown = ", ".join(titles[:12])
    return f"the places are {shown}{', ...' if len(titles) > 12 else ''}"


def _find_faults(kb: KnowledgeBase) -> list[str]:
    """Say what does not fit together; each of these would mislead an answer later."""
    faults, count = list[str](), len(kb.experience)
    for number, hypothesis in enumerate(kb.hypotheses, 1):
        length = len(hypothesis.visits)
        if length > count or len(hypothesis.offsets) != length:
            faults.append(f"map {number} has {length} visits, the experience {count}")
        elif any(p > v or hypothesis.visits[p] != p for v, p in enumerate(hypothesis.visits)):
            faults.append(f"map {number} names a place after a visit that is not its first")
    for number, (layout, hypothesis) in enumerate(zip(kb.layouts, kb.hypotheses, strict=False), 1):
        places = len(hypothesis.places)
        if layout is not None and layout.poses.shape != (places, 3):
            faults.append(
                f"the layout of map {number} has poses of shape {layout.poses.shape}, "
                f"expected ({places}, 3)"
            )
    if len(kb.layouts) > len(kb.hypotheses):
        faults.append(f"{len(kb.layouts)} layouts for {len(kb.hypotheses)} maps")
    for kind, visits in (("name", kb.names), ("local map", kb.lpms)):
        faults.extend(f"a {kind} is for visit {v} of {count}" for v in visits if v >= count)
    return faults
