"""Walks that the robot may take next, on one map: a known way to a place, then one travel more.

Source: ours.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, replace

from hssh_kb.foresight import Belief, Forecast, Foresight, Stand
from hssh_kb.place_graph import Edge, PlaceGraph
from perception.geometry import wrap_angle


@dataclass(frozen=True)
class Walk:
    """A way to a place, then one travel.

    Attributes
    ----------
    place : label of the place where the last travel begins.
    facing : index of the dlp faced there.
    dlp : index of the dlp to leave by.
    way : the edges to the place; empty if the robot is there.
    edge : the edge of the last travel, maybe a doubted one; None if the way is unexplored.
    turns : how many dlps clockwise of the one faced the robot leaves by, at each place from where
        it is now to ``place``; what it does whichever map is true.
    way_length, length : of the way, and with the last travel, in metres or travels; an unexplored
        way is taken to be as long as edges are on average.
    gain_bits : expected loss of entropy over the whole walk.
    last_gain_bits : the part of it that the last travel brings.
    entropy_bits : expected entropy after it.
    before : the belief at the place. forecast : what the last travel promises.
    """

    place: str
    facing: int
    dlp: int
    way: tuple[Edge, ...]
    edge: Edge | None
    turns: tuple[int, ...]
    way_length: float
    length: float
    gain_bits: float
    last_gain_bits: float
    entropy_bits: float
    before: Belief
    forecast: Forecast

    @property
    def rate_bits(self) -> float:
        """Expected loss of entropy per unit of length, bits."""
        return self.gain_bits / self.length

    @property
    def key(self) -> tuple[int, int]:
        """Place and dlp, as numbers."""
        return int(self.place.removeprefix("P")), self.dlp


@dataclass(frozen=True)
class _Reach:
    """How a place is reached: doubted stretches and length, edges, turns, the dlp faced."""

    cost: tuple[int, float]
    way: tuple[Edge, ...]
    turns: tuple[int, ...]
    facing: int


def list_walks(graph: PlaceGraph, foresight: Foresight) -> list[Walk]:
    """Return all walks from the last visit, nearest first.

    Parameters
    ----------
    graph : the place graph of the leading map of ``foresight``.
    foresight : the rival maps.

    Returns
    -------
    A walk for each gateway of each place that known ways lead to, on the shortest way to it; with
    doubted stretches only where there is no other. Of equally long ways the one found first in
    the order of places and dlps is taken.
    """
    start = foresight.start()
    stand = start.stands[foresight.lead]
    if stand is None:
        return []
    known = graph.believed_or_not
    lengths = [edge.length_m for edge in known.edges if edge.length_m]
    ruler = Ruler(sum(lengths) / len(lengths) if graph.has_lengths and lengths else None)
    reaches = _reach_places(known, f"P{stand.place}", stand.facing, ruler)
    beliefs, walks = dict[str, Belief](), list[Walk]()
    for label, reach in reaches.items():
        belief = start
        if reach.way:
            edge = reach.way[-1]
            belief = _arrive(foresight, beliefs[edge.start], reach.turns[-1], edge)
        beliefs[label] = belief
        star = graph.places[label].star
        for dlp in (k for k in range(len(star)) if star.alpha[k]):
            last = graph.edge_at.get((label, dlp)) or known.edge_at.get((label, dlp))
            turn = (dlp - reach.facing) % len(star)
            forecast = foresight.step(belief, turn)
            walks.append(
                Walk(
                    label,
                    reach.facing,
                    dlp,
                    reach.way,
                    last,
                    (*reach.turns, turn),
                    reach.cost[1],
                    reach.cost[1] + ruler.measure(last),
                    start.entropy_bits - forecast.entropy_bits,
                    belief.entropy_bits - forecast.entropy_bits,
                    forecast.entropy_bits,
                    belief,
                    forecast,
                )
            )
    return walks


@dataclass(frozen=True)
class Ruler:
    """Measures travels: in metres, or each as one travel.

    Attributes
    ----------
    typical_m : mean length of an edge, taken where a length is unknown; None counts travels.
    """

    typical_m: float | None

    def measure(self, edge: Edge | None) -> float:
        """Return the length of an edge; None stands for an unexplored way."""
        if self.typical_m is None:
            return 1.0
        return self.typical_m if edge is None or not edge.length_m else edge.length_m


def _arrive(foresight: Foresight, before: Belief, turn: int, edge: Edge) -> Belief:
    """Return the belief at the far end of an edge on the way."""
    onward = foresight.step(before, turn).onward
    if onward is not None:
        return onward
    # A doubted stretch tells nothing for sure, but leads on if all goes as it did before.
    stands: list[Stand | None] = [None] * len(foresight.maps)
    stands[foresight.lead] = Stand(int(edge.goal.removeprefix("P")), edge.arrive)
    return replace(before, stands=tuple(stands))


def _reach_places(graph: PlaceGraph, start: str, facing: int, ruler: Ruler) -> dict[str, _Reach]:
    """Return the shortest known way to each place that is reached, nearest first."""
    done = dict[str, _Reach]()
    leaving: dict[str, list[Edge]] = {}
    for edge in graph.edges:
        leaving.setdefault(edge.start, []).append(edge)
    serial = 0
    queue = [((0, 0.0), 0, start, _Reach((0, 0.0), (), (), facing))]
    while queue:
        cost, _, label, reach = heapq.heappop(queue)
        if label in done:
            continue
        done[label] = reach
        for edge in leaving.get(label, []):
            if edge.goal not in done:
                serial += 1
                on = cost[0] + edge.doubted, cost[1] + ruler.measure(edge)
                turn = (edge.dlp - reach.facing) % len(graph.places[label].star)
                entry = _Reach(on, (*reach.way, edge), (*reach.turns, turn), edge.arrive)
                heapq.heappush(queue, (on, serial, edge.goal, entry))
    return done


def measure_turn(graph: PlaceGraph, walk: Walk) -> float:
    """Return how far one turns at the place of a walk to leave it, radians in [0, pi].

    Where the headings of the dlps are unknown they are taken to be spread evenly.
    """
    place = graph.places[walk.place]
    if place.headings_rad:
        onto, facing = (place.headings_rad[k] for k in (walk.dlp, walk.facing))
        return abs(float(wrap_angle(onto - facing)))
    even = 2 * math.pi * (walk.dlp - walk.facing) / len(place.star)
    return round(abs(float(wrap_angle(even))), 9)
