"""A plain drawing of a place graph of which nothing was measured.

Several force-directed drawings are made; the one with the fewest crossings wins, then the one
that best keeps the clockwise order of the stars.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import networkx as nx
import numpy as np

from hssh_kb.place_graph import PlaceGraph
from perception.geometry import Array

_SEEDS = 12


def place_nodes(graph: PlaceGraph) -> dict[str, Array]:
    """Return a position (2,) for each place, about one unit apart."""
    labels = list(graph.places)
    if len(labels) < 3:
        return {label: np.array([float(i), 0.0]) for i, label in enumerate(labels)}
    plain = nx.Graph(graph.graph)
    plain.remove_edges_from(list(nx.selfloop_edges(plain)))
    best = min(_draw_nodes(plain), key=lambda spots: _price(graph, spots))
    lengths = [math.dist(best[e.start], best[e.goal]) for e in graph.undirected_edges]
    unit = float(np.median([length for length in lengths if length > 0] or [1.0]))
    return {label: best[label] / unit for label in labels}


def _draw_nodes(plain: nx.Graph) -> Iterator[dict[str, Array]]:
    planar, _ = nx.check_planarity(plain)
    start = nx.planar_layout(plain) if planar else nx.circular_layout(plain)
    drawings = [start]
    if nx.is_connected(plain):
        drawings.append(nx.kamada_kawai_layout(plain, pos=start))
        drawings.append(nx.kamada_kawai_layout(plain, pos=nx.circular_layout(plain)))
    drawings += [nx.spring_layout(plain, seed=seed, iterations=120) for seed in range(_SEEDS)]
    for drawing in drawings:
        spots = {label: np.asarray(xy, float) for label, xy in drawing.items()}
        yield spots
        yield {label: xy * np.array([-1.0, 1.0]) for label, xy in spots.items()}


def _price(graph: PlaceGraph, spots: dict[str, Array]) -> tuple[int, int, float]:
    """Return (crossings, places whose star is not in order, unevenness of the lengths)."""
    pairs = sorted({tuple(sorted((e.start, e.goal))) for e in graph.edges if e.start != e.goal})
    crossings = sum(
        _cross(*(spots[end] for end in (*pair, *other)))
        for i, pair in enumerate(pairs)
        for other in pairs[:i]
        if not set(pair) & set(other)
    )
    lengths = np.array([math.dist(spots[a], spots[b]) for a, b in pairs] or [1.0])
    uneven = float(lengths.std() / max(lengths.mean(), 1e-9))
    return crossings, sum(not _keeps_order(graph, spots, label) for label in graph.places), uneven


def _cross(a: Array, b: Array, c: Array, d: Array) -> bool:
    def side(p: Array, q: Array, r: Array) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def _keeps_order(graph: PlaceGraph, spots: dict[str, Array], label: str) -> bool:
    """Whether the stretches leave a place in the clockwise order of its star."""
    here = spots[label]
    ways = [
        spots[graph.edge_at[label, k].goal] - here
        for k in range(len(graph.places[label].star))
        if (label, k) in graph.edge_at and graph.edge_at[label, k].goal != label
    ]
    angles = [float(np.arctan2(way[1], way[0])) for way in ways]
    clockwise = sum(
        (a - b) % (2 * np.pi) for a, b in zip(angles, angles[1:] + angles[:1], strict=True)
    )
    return len(ways) < 3 or clockwise < 2.5 * np.pi
