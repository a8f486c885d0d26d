"""Places that a map holds twice: found by the layout of the whole walk, and merged.

Whether a visit is to a new place or to a known one close by may at first be nearly a tie, and what
comes later decides it: the better a town is known, the less room there is for two places side by
side. By then best-first search has long gone on with the map that was a little better at the time.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from itertools import islice, pairwise, product

import networkx as nx
import numpy as np
from scipy.spatial import cKDTree

from hssh_kb.map_tree import MapTree
from hssh_kb.node import LeafState, Node
from hssh_kb.revise import Change, merge_labels, thread_visits
from hssh_kb.score import Score
from hssh_kb.walk_graph import Array, WalkGraph
from hssh_kb.walk_layout import lay_out

_WORTH_NATS = -3.0  # pairs that promise less are not tried
_WORSE_NATS = 12.0  # a merger that makes a map so much worse on the way is given up
_MOST_PAIRS = 64  # are looked at closely
_REACH = 0.5  # typical travels between two places that may be one, at most
_BLUR = 0.02  # of a typical travel: so far apart they may be one, however well they are known
_LATER = 1.125  # times as long a walk: then what was tried in vain is tried again
_SIGMAS = 5.0  # so many deviations apart they may be one


Pair = tuple[int, int]
Visits = tuple[Pair, ...]
"""Pairs of places, each told by its first visit."""


def merge_doubles(
    tree: MapTree, lead: Node, is_over: Callable[[], bool], put_off: dict[Visits, float]
) -> Iterator[Node]:
    """Yield maps that hold fewer places twice, each better than the one before.

    Parameters
    ----------
    tree, lead : the map to begin with.
    is_over : tells when to stop (the budget is spent).
    put_off : mergers tried in vain, and the visit from which they may be tried again: never if
        the axioms refuse them, else when the walk has grown by an eighth; added to.
    """
    node: Node | None = lead
    while node is not None and not is_over():
        better = None
        labels = [one.decision.place for one in node.chain()[1:]]
        firsts = tree.state_of(node).firsts
        for group in _group(find_doubles(tree, node), labels):
            visits = tuple((firsts[one], firsts[other]) for one, other in group)
            if node.visit < put_off.get(visits, 0) or is_over():
                continue
            change = Change(("merge", *group), merge_labels(labels, group))
            made = thread_visits(tree, node, change, loose=True, worse_nats=_WORSE_NATS)
            put_off[visits] = math.inf if made is node else _LATER * (node.visit + 1)
            if made is not None and made.score > node.score:
                better = made
                yield made
                break
        node = better


def _group(pairs: list[Pair], labels: list[int]) -> Iterator[list[Pair]]:
    """Yield pairs that stand or fall together, then each alone.

    A corridor that is held twice has two ends: both of them are held twice, or neither is.
    """
    graph = nx.Graph()
    graph.add_nodes_from(pairs)
    pairs_of = dict[int, list[Pair]]()
    for pair in pairs:
        for place in pair:
            pairs_of.setdefault(place, []).append(pair)
    for one, other in pairwise(labels):
        graph.add_edges_from(product(pairs_of.get(one, ()), pairs_of.get(other, ())))
    groups = [sorted(group, key=pairs.index) for group in nx.connected_components(graph)]
    yield from (group for group in sorted(groups) if len(group) > 1)
    yield from ([pair] for pair in pairs)


def find_doubles(tree: MapTree, node: Node) -> list[Pair]:
    """Return the pairs of places that may well be one, the likeliest first.

    Parameters
    ----------
    tree, node : the map.

    Returns
    -------
    pairs : numbers of the two places, the earlier first.
    """
    state, length = tree.state_of(node), tree.score.length_m
    graph = state.filter.remember_walk(length)
    near = _find_near(state, graph, tree.score)
    likely = (pair for pair, share in near.items() if share < 1)
    ways = ((pair, _match(tree, state, pair, near)) for pair in likely)
    turns = dict(islice((one for one in ways if one[1]), _MOST_PAIRS))
    if not turns:
        return []
    pairs = list(turns)
    places = np.unique(np.array(pairs, np.intp))
    window = lay_out(graph, places, length, sampled=False)
    tree.work += len(window.graph.poses)
    poses = window.graph.poses[window.graph.first[places]]
    cov = window.cov[3:, 3:].reshape(len(places), 3, len(places), 3)
    worth = {}
    for pair in pairs:
        i, j = np.searchsorted(places, pair).tolist()
        spread = cov[i, :, i] + cov[j, :, j] - cov[i, :, j] - cov[j, :, i]
        gap = poses[j] - poses[i]
        found = max(_weigh(tree.score, gap, spread, *turn) for turn in turns[pair])
        if found > _WORTH_NATS:
            worth[pair] = found
    return sorted(worth, key=lambda pair: (-worth[pair], pair))


def _find_near(state: LeafState, graph: WalkGraph, score: Score) -> dict[Pair, float]:
    """Return how near each other the pairs of places lie that are not far apart.

    Returns
    -------
    near : by pair, the nearest first, how far apart they lie as a share of what samples of
        their errors allow: below one, they may lie on each other.
    """
    spots = graph.poses[graph.first, :2]
    errors = state.filter.town.errors[:, :2]
    known = len(errors) if errors.shape[2] else 0
    widest = _REACH * score.length_m
    found = []
    for i, j in cKDTree(spots).query_pairs(widest):
        reach = widest
        if max(i, j) < known:
            spread = float(np.mean(np.sum((errors[i] - errors[j]) ** 2, axis=0)))
            reach = _SIGMAS * math.sqrt(spread + 2 * score.spread_m**2) + _BLUR * score.length_m
        share = math.dist(spots[i], spots[j]) / reach
        found.append((share, (min(i, j), max(i, j))))
    return {pair: share for share, pair in sorted(found)}


def _match(
    tree: MapTree, state: LeafState, pair: Pair, near: Collection[Pair]
) -> list[tuple[float, float, float]]:
    """Return turn [rad], its variance and the misfit of the stars of two places, every way.

    Ways under which one gateway would lead to two places that do not lie on each other are
    left out: the axioms would refuse the merger, after long work.
    """
    (one, other), read = pair, state.place_readings
    first, later = state.firsts[one], state.firsts[other]
    known = tree.visits[first].readings[read[one]]
    seen = tree.visits[later].readings[read[other]]
    return [
        tree.score.match_headings(known.headings, seen.headings, offset, seen.star.alpha)
        for offset in tree.isomorphisms(later, read[other], first, read[one])
        if _can_be_one(state, pair, offset, len(seen.star), near)
    ]


def _can_be_one(
    state: LeafState, pair: Pair, offset: int, size: int, near: Collection[Pair]
) -> bool:
    """Return whether the gateways of two places lead to the same places, or to such as may be."""
    for dlp in range(size):
        ways = [
            state.judge.follow(pair[0], (dlp + offset) % size),
            state.judge.follow(pair[1], dlp),
        ]
        known = sorted(way[0] for way in ways if way is not None)
        if len(known) == 2 and known[0] != known[1] and (known[0], known[1]) not in near:
            return False
    return True


def _weigh(
    score: Score, gap: Array, spread: Array, turn: float, var: float, misfit: float
) -> float:
    """Return what it should add to the log posterior if two places are one.

    Parameters
    ----------
    gap, spread : pose (3,) of the later place minus that of the earlier, and its covariance (3, 3).
    turn, var, misfit : of their stars; see :meth:`hssh_kb.score.Score.match_headings`.
    """
    around = spread[:2, :2] + (score.spread_m**2 + 1e-12) * np.eye(2)
    chi2 = float(gap[:2] @ np.linalg.solve(around, gap[:2]))
    worth = misfit - 0.5 * chi2 - 0.5 * math.log(float(np.linalg.det(2 * math.pi * around)))
    if math.isfinite(var):
        left = (gap[2] - turn + math.pi) % (2 * math.pi) - math.pi
        worth -= 0.5 * max(left**2 / (var + spread[2, 2]) - 1.0, 0.0)
    return worth + math.log(score.area_m2) - score.place_prior
