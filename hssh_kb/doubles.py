"""Places that a map holds twice: found by the layout of the whole walk.

Early on, whether a visit is to a new place or to a known one close by may be nearly a tie, and what
comes later decides it: the better the town is known, the less room there is for two places side
by side. Best-first search has then long gone on with the map that was a little better at the time.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from hssh_kb.map_tree import MapTree
from hssh_kb.node import LeafState, Node
from hssh_kb.score import Score
from hssh_kb.walk_graph import Array, WalkGraph
from hssh_kb.walk_layout import lay_out

_WORTH_NATS = -3.0  # pairs that promise less are not worth a try
_MOST_PAIRS = 64
_SIGMAS = 4.0
_SIGMAS_HEADING = 3.0


def find_doubles(tree: MapTree, node: Node) -> list[tuple[int, int]]:
    """Return the pairs of places that may well be one, the likeliest first.

    Parameters
    ----------
    tree, node : the map.

    Returns
    -------
    pairs : numbers of the two places, the earlier first.
    """
    state = tree.state_of(node)
    graph = state.filter.remember_walk(tree.score.length_m)
    pairs = [pair for pair in _find_near(state, graph, tree.score) if _match(tree, state, pair)]
    places = np.unique(np.array(pairs, np.intp))
    if not len(places):
        return []
    window = lay_out(graph, places, tree.score.length_m, sampled=False)
    poses = window.graph.poses[window.graph.first[places]]
    cov = window.cov[3:, 3:].reshape(len(places), 3, len(places), 3)
    worth = dict[tuple[int, int], float]()
    for pair in pairs:
        i, j = np.searchsorted(places, pair)
        spread = cov[i, :, i] + cov[j, :, j] - cov[i, :, j] - cov[j, :, i]
        found = _weigh(tree, state, pair, poses[j] - poses[i], spread)
        if found > _WORTH_NATS:
            worth[pair] = found
    return sorted(worth, key=lambda pair: (-worth[pair], pair))


def _find_near(state: LeafState, graph: WalkGraph, score: Score) -> Iterator[tuple[int, int]]:
    """Yield pairs of places that lie on each other, as far as samples of their errors tell."""
    spots = graph.poses[graph.first, :2]
    errors = state.filter.town.errors[:, :2]
    known, size = len(errors), errors.shape[2]
    found = list[tuple[float, tuple[int, int]]]()
    for i, j in sorted(cKDTree(spots).query_pairs(0.5 * score.length_m)):
        off = math.dist(spots[i], spots[j])
        reach = 0.5 * score.length_m
        if size and j < known:
            spread = float(np.mean(np.sum((errors[i] - errors[j]) ** 2, axis=0)))
            reach = _SIGMAS * math.sqrt(1.5 * spread + score.spread_m**2)
        if off < reach + 0.02 * score.length_m:
            found.append((off / reach, (i, j)))
    yield from (pair for _, pair in sorted(found)[:_MOST_PAIRS])


def _match(tree: MapTree, state: LeafState, pair: tuple[int, int]) -> bool:
    return bool(_list_turns(tree, state, pair))


def _list_turns(tree: MapTree, state: LeafState, pair: tuple[int, int]) -> list[tuple[float, float, float]]:
    one, other = pair
    first, later = state.firsts[one], state.firsts[other]
    read, read_later = state.place_readings[one], state.place_readings[other]
    at_place = tree.visits[first].readings[read]
    at_visit = tree.visits[later].readings[read_later]
    return [
        tree.score.match_headings(
            at_place.headings, at_visit.headings, offset, at_visit.star.alpha
        )
        for offset in tree.isomorphisms(later, read_later, first, read)
    ]


def _weigh(
    tree: MapTree, state: LeafState, pair: tuple[int, int], gap: Array, spread: Array
) -> float:
    """Return what a merger should add to the log posterior."""
    score = tree.score
    best = -math.inf
    for turn, var, misfit in _list_turns(tree, state, pair):
        noise = np.diag([score.spread_m**2 + 1e-9, score.spread_m**2 + 1e-9])
        plane = spread[:2, :2] + noise
        chi2 = float(gap[:2] @ np.linalg.solve(plane, gap[:2]))
        worth = -0.5 * chi2 - 0.5 * math.log(float(np.linalg.det(2 * math.pi * plane)))
        if math.isfinite(var):
            left = (gap[2] - turn + math.pi) % (2 * math.pi) - math.pi
            worth -= 0.5 * max(left**2 / (var + spread[2, 2]) - 1.0, 0.0)
        best = max(best, worth + misfit)
    return best + math.log(score.area_m2) - score.place_prior
