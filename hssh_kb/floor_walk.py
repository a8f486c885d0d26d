"""A depth-first walk of a virtual robot through the place graph of a floor, as an Experience."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hssh_kb.consistency import Refusal, judge_hypothesis
from hssh_kb.experience import Displacement, Experience, Reading, Visit, checked_covariance
from hssh_kb.hypothesis import Hypothesis
from perception.continuity import StarReading
from perception.floor_graph import FloorMap, FloorPlace

_MOST_TRIES = 400
_HEADING_SIGMA_RAD = 0.01


@dataclass(frozen=True)
class FloorWalk:
    """The walk, and the map hypothesis that is true by construction.

    Attributes
    ----------
    experience, hypothesis : of the walk.
    places : number of the place of each visit.
    travels : (number of the edge, whether it is walked forward) of each travel.
    notices : where the stars contradict the axioms, in words.
    """

    experience: Experience
    hypothesis: Hypothesis
    places: tuple[int, ...]
    travels: tuple[tuple[int, bool], ...]
    notices: tuple[str, ...] = ()


def walk_floor(
    floor: FloorMap, *, source: str = "", start_m: tuple[float, float] | None = None
) -> FloorWalk:
    """Walk every edge of a floor, depth first, each there and back but for the last ways back.

    Where the best stars break an axiom, a path is broken off at the place where that costs least;
    a travel that breaks one whatever the stars is doubted. Both are told in the notices.

    Parameters
    ----------
    start_m : the walk begins at the place nearest to it; else where most ways meet.
    """
    first = _choose_start(floor, start_m)
    places, travels = _explore(floor, first)
    names = _name_places(floor, places)
    chosen = dict.fromkeys(range(len(floor.places)), 0)
    walk = _Walk(floor, places, travels, names, source)
    doubted, notices = set[int](), list[str]()
    tries = 0
    while True:
        refused = walk.judge(chosen, doubted)
        if refused is None:
            break
        visit, refusal = refused
        found = None
        if tries < _MOST_TRIES:
            found, spent = walk.find_repair(chosen, doubted, visit, refusal)
            tries += spent
        if found is None:
            doubted |= walk.list_travels(visit)
            notices.append(_tell_doubt(walk, visit, refusal))
            continue
        chosen |= found
        notices += [_tell_repair(walk, place, refusal) for place in found]
    experience, hypothesis = walk.describe(chosen, doubted)
    return FloorWalk(experience, hypothesis, tuple(places), tuple(travels), tuple(notices))


def _choose_start(floor: FloorMap, start_m: tuple[float, float] | None) -> int:
    count = range(len(floor.places))
    if start_m is not None:
        return min(count, key=lambda k: math.dist(floor.places[k].centre_m, start_m))
    return max(count, key=lambda k: (len(floor.places[k].gateways), -k))


def _explore(floor: FloorMap, first: int) -> tuple[list[int], list[tuple[int, bool]]]:
    """Return the places in the order they are visited, and the travels between them."""
    ways: dict[int, list[tuple[int, int, bool, int]]] = defaultdict(list)
    for k, edge in enumerate(floor.edges):
        ways[edge.start].append((edge.start_gateway, k, True, edge.goal))
        ways[edge.goal].append((edge.goal_gateway, k, False, edge.start))
    for at, place in enumerate(floor.places):
        turn = {g: n for n, g in enumerate(place.readings[0].gateway_out) if g is not None}
        ways[at] = [way for _, way in sorted((turn[way[0]], way) for way in ways[at])]
    places, travels = [first], list[tuple[int, bool]]()
    walked, seen = set[int](), {first}
    stack: list[tuple[int, bool]] = []
    last = 0
    while True:
        here = places[-1]
        way = next((w for w in ways[here] if w[1] not in walked), None)
        if way is None:
            if not stack:
                break
            k, forward = stack.pop()
            travels.append((k, not forward))
            edge = floor.edges[k]
            places.append(edge.start if forward else edge.goal)
            continue
        _, k, forward, goal = way
        walked.add(k)
        travels.append((k, forward))
        places.append(goal)
        last = len(travels)
        if goal in seen:  # known already: turn back
            travels.append((k, not forward))
            places.append(here)
        else:
            seen.add(goal)
            stack.append((k, forward))
    return places[: last + 1], travels[:last]


def _name_places(floor: FloorMap, order: Sequence[int]) -> dict[int, str]:
    """Return the names of places; further places in one room are numbered."""
    inside: dict[str, list[int]] = defaultdict(list)
    for k in dict.fromkeys(order):
        for name in floor.places[k].names:
            inside[name].append(k)
    names: dict[int, str] = {}
    for name, members in inside.items():
        centre = np.mean([floor.places[k].centre_m for k in members], axis=0)
        members.sort(key=lambda k: math.dist(floor.places[k].centre_m, centre))
        free = [k for k in members if k not in names]
        for number, k in enumerate(free, 1):
            names[k] = name if number == 1 else f"{name} ({number})"
    return names


class _Walk:
    """The walk while the readings of the stars are settled."""

    def __init__(
        self,
        floor: FloorMap,
        places: Sequence[int],
        travels: Sequence[tuple[int, bool]],
        names: Mapping[int, str],
        source: str,
    ) -> None:
        self.floor, self.places, self.travels = floor, places, travels
        self.names, self.source = names, source
        first: dict[int, int] = {}
        self.visits = tuple(first.setdefault(place, v) for v, place in enumerate(places))

    def describe(
        self, chosen: Mapping[int, int], doubted: set[int]
    ) -> tuple[Experience, Hypothesis]:
        """Return experience and hypothesis with the readings chosen."""
        visits = [self._visit(v, chosen) for v in range(len(self.places))]
        hypothesis = Hypothesis(
            self.visits, (0,) * len(visits), log_posterior=0.0, doubted=tuple(sorted(doubted))
        )
        return Experience(tuple(visits), self.source), hypothesis

    def _visit(self, v: int, chosen: Mapping[int, int]) -> Visit:
        k = self.places[v]
        place = self.floor.places[k]
        reading = place.readings[chosen[k]]
        arrive = depart = None
        if v > 0:
            came_by = _find_dlp(reading, self._gateway(v - 1, start=False))
            arrive = reading.star.opposite(came_by)
        if v < len(self.places) - 1:
            depart = _find_dlp(reading, self._gateway(v, start=True))
        x, y = place.centre_m
        return Visit(
            (Reading(reading.star, arrive, depart, 1.0, reading.headings_px),),
            self._displacement(v),
            self.names.get(k) if self.visits[v] == v else None,
            (x, y, 0.0),
        )

    def _gateway(self, travel: int, *, start: bool) -> int:
        """Return the gateway at the start or at the goal of a travel."""
        number, forward = self.travels[travel]
        edge = self.floor.edges[number]
        return edge.start_gateway if forward == start else edge.goal_gateway

    def _displacement(self, v: int) -> Displacement | None:
        if v == 0:
            return None
        before, now = (self.floor.places[self.places[u]].centre_m for u in (v - 1, v))
        dx, dy = now[0] - before[0], now[1] - before[1]
        sigma = 0.02 + 0.005 * math.hypot(dx, dy)
        cov = checked_covariance(np.diag([sigma**2, sigma**2, _HEADING_SIGMA_RAD**2]))
        return Displacement(dx, dy, 0.0, cov)

    def judge(self, chosen: Mapping[int, int], doubted: set[int]) -> tuple[int, Refusal] | None:
        """Return the first visit that breaks an axiom and why; None if none does."""
        verdict = judge_hypothesis(*self.describe(chosen, doubted))
        if verdict.visit is None or verdict.refusal is None:
            return None
        return verdict.visit, verdict.refusal

    def find_repair(
        self, chosen: Mapping[int, int], doubted: set[int], visit: int, refusal: Refusal
    ) -> tuple[dict[int, int] | None, int]:
        """Return readings by place that let the walk stand beyond a visit, and how many were tried.

        Among the places of the travels that clash, the reading least below the best one is taken,
        or the two least.
        """
        involved = {self.places[u] for v in (visit, *refusal.travels) for u in (v - 1, v) if u >= 0}
        options = sorted(
            (-reading.weight / max(_weigh(self.floor.places[k]), 1e-9), -i, k)
            for k in involved
            for i, reading in enumerate(self.floor.places[k].readings)
            if i > chosen[k]
        )
        singles = ({k: -i} for _, i, k in options)
        pairs = (
            {k: -i, m: -j} for (_, i, k), (_, j, m) in itertools.combinations(options, 2) if k != m
        )
        tried = 0
        for change in itertools.islice(itertools.chain(singles, pairs), _MOST_TRIES // 2):
            tried += 1
            again = self.judge({**chosen, **change}, doubted)
            if again is None or again[0] > visit:
                return change, tried
        return None, tried

    def list_travels(self, visit: int) -> set[int]:
        """Return all travels over the edge that leads to a visit, by the visits they lead to."""
        number = self.travels[visit - 1][0]
        return {v + 1 for v, (edge, _) in enumerate(self.travels) if edge == number}

    def label(self, place: int) -> str:
        """Return what the user calls a place."""
        label = f"P{self.visits[self.places.index(place)]}"
        name = self.names.get(place)
        return f"{name} ({label})" if name else label


def _weigh(place: FloorPlace) -> float:
    return place.readings[0].weight


def _find_dlp(reading: StarReading, gateway: int) -> int:
    """Return the dlp that leaves through a gateway."""
    return reading.gateway_out.index(gateway)


def _tell_repair(walk: _Walk, place: int, refusal: Refusal) -> str:
    x, y = walk.floor.places[place].centre_m
    return (
        f"the star of {walk.label(place)} at ({x:.1f}, {y:.1f}) m contradicts the axiom "
        f"{refusal.axiom}; a path that would go straight on there is taken to end"
    )


def _tell_doubt(walk: _Walk, visit: int, refusal: Refusal) -> str:
    one, other = (walk.label(walk.places[v]) for v in (visit - 1, visit))
    return (
        f"the way from {one} to {other} contradicts the axiom {refusal.axiom} whatever the stars; "
        "it is left out of the map"
    )
