"""Walks that the robot may take next, on one map: a known way to a place, then one travel more.

Source: ours.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

from hssh_kb.foresight import Belief, Forecast, Foresight
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
    edge : the edge of the last travel; None if the way is unexplored.
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
    """How a place is reached: cost, edges, the dlp faced."""

    cost: float
    way: tuple[Edge, ...]
    facing: int


def list_walks(graph: PlaceGraph, foresight: Foresight) -> list[Walk]:
    """Return all walks from the last visit, nearest first.

    Parameters
    ----------
    graph : the place graph of the leading map of ``foresight``.
    foresight : the rival maps.

    Returns
    -------
    A walk for each gateway of each place that known ways lead to, on the shortest way to it. Of
    equally long ways the one found first in the order of places and dlps is taken.
    """
    start = foresight.start()
    stand = start.stands[foresight.lead]
    if stand is None:
        return []
    metric = graph.has_lengths and bool(graph.edges)
    lengths = [edge.length_m or 0.0 for edge in graph.undirected_edges]
    typical = (sum(lengths) / len(lengths) or 1.0) if metric else 1.0
    reaches = _reach_places(graph, f"P{stand.place}", stand.facing, metric)
    beliefs = dict[str, Belief]()
    now = start.entropy_bits
    walks = list[Walk]()
    for label, reach in reaches.items():
        if reach.way:
            last = reach.way[-1]
            came = reaches[last.start].facing
            onward = _leave(graph, foresight, beliefs[last.start], last.start, came, last.dlp)
            if onward.onward is None:
                continue
            belief = onward.onward
        else:
            belief = start
        beliefs[label] = belief
        star = graph.places[label].star
        for dlp in (k for k in range(len(star)) if star.alpha[k]):
            edge = graph.edge_at.get((label, dlp))
            more = _price(edge, metric) if edge else typical
            forecast = _leave(graph, foresight, belief, label, reach.facing, dlp)
            walks.append(
                Walk(
                    label,
                    reach.facing,
                    dlp,
                    reach.way,
                    edge,
                    reach.cost,
                    reach.cost + more,
                    now - forecast.entropy_bits,
                    belief.entropy_bits - forecast.entropy_bits,
                    forecast.entropy_bits,
                    belief,
                    forecast,
                )
            )
    return walks


def _leave(
    graph: PlaceGraph, foresight: Foresight, belief: Belief, label: str, facing: int, dlp: int
) -> Forecast:
    size = len(graph.places[label].star)
    return foresight.step(belief, (dlp - facing) % size)


def _price(edge: Edge, metric: bool) -> float:
    """Return the length of an edge; a travel of no length still costs a little."""
    return max(edge.length_m or 0.0, 0.01) if metric else 1.0


def _reach_places(graph: PlaceGraph, start: str, facing: int, metric: bool) -> dict[str, _Reach]:
    """Return the shortest known way to each place that is reached, nearest first."""
    done = dict[str, _Reach]()
    leaving: dict[str, list[Edge]] = {}
    for edge in graph.edges:
        leaving.setdefault(edge.start, []).append(edge)
    serial = 0
    queue: list[tuple[float, int, str, _Reach]] = [(0.0, 0, start, _Reach(0.0, (), facing))]
    while queue:
        cost, _, label, reach = heapq.heappop(queue)
        if label in done:
            continue
        done[label] = reach
        for edge in leaving.get(label, []):
            if edge.goal not in done:
                serial += 1
                on = cost + _price(edge, metric)
                entry = _Reach(on, (*reach.way, edge), edge.arrive)
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
