"""Places that a map holds twice are found and merged."""

from __future__ import annotations

from collections.abc import Iterator

import networkx as nx
import numpy as np
from street_worlds import make_town, make_world
from symbolic_walks import Eyes, follow_route, observe, walk_randomly

from hssh_kb.doubles import find_doubles, merge_doubles
from hssh_kb.map_tree import MapTree, grow_hypothesis
from hssh_kb.node import Node
from hssh_kb.revise import Change, thread_visits
from hssh_kb.score import estimate_score
from hssh_kb.town import MOST_PLACES


def _grow_truth(seed: int, crossings: int = 800, travels: int = 700) -> tuple[MapTree, Node]:
    rng = np.random.default_rng(seed)
    world = make_town(crossings, seed)
    truth = observe(world, walk_randomly(world, travels, rng), Eyes(sigma=0.03), rng)
    return grow_hypothesis(truth.experience, truth.hypothesis(), estimate_score(truth.experience))


def _list_places(node: Node) -> list[int]:
    return [one.decision.place for one in node.chain()[1:]]


def _split_visits(tree: MapTree, true: Node) -> Iterator[tuple[int, Node]]:
    """Yield consistent maps that take one later visit to a known place for a new place.

    The robot must come and go by corridors that it travels for the first time.
    """
    labels = _list_places(true)
    seen = set[frozenset[int]]()
    for v in range(1, len(labels) - 1):
        came, goes = frozenset(labels[v - 1 : v + 1]), frozenset(labels[v : v + 2])
        if labels[v] in labels[:v] and not {came, goes} & seen:
            split = [*labels]
            split[v] = max(labels) + 1
            made = thread_visits(tree, true, Change(("split", v), split))
            if made is not None and made.places == true.places + 1:
                yield v, made
        seen.add(came)


def test_a_place_held_twice_is_merged_in_a_town_larger_than_the_window() -> None:
    tree, true = _grow_truth(2)
    assert true.places > MOST_PLACES
    labels, count = _list_places(true), 0
    for v, split in _split_visits(tree, true):
        count += 1
        found = _list_places(split)
        assert (found[labels.index(labels[v])], found[v]) in find_doubles(tree, split)
        mended = [_list_places(one) for one in merge_doubles(tree, split, lambda: False, {})]
        assert mended == [labels]
    assert count > 2


def test_the_true_map_stays_as_it_is() -> None:
    tree, true = _grow_truth(7)
    assert list(merge_doubles(tree, true, lambda: False, {})) == []


def test_corners_beside_each_other_that_lead_to_places_far_apart_are_no_doubles() -> None:
    spots = [(0, 0), (-10, 0), (-10, 5), (-20, 5), (-20, -0.8), (0.3, -0.3)]
    spots += [(0.5, 20), (-5, 20), (-5, 10), (0, 10)]
    graph = nx.cycle_graph(len(spots))
    nx.set_node_attributes(graph, dict(enumerate(spots)), "spot")
    world = make_world(graph, merge_m=0.0, corners=True, look_m=0.0)
    order = sorted(range(len(spots)), key=lambda k: spots.index(world.positions[k]))
    rng = np.random.default_rng(1)
    truth = observe(world, follow_route(world, [*order, order[0]]), Eyes(sigma=0.03), rng)
    score = estimate_score(truth.experience)
    tree, true = grow_hypothesis(truth.experience, truth.hypothesis(), score)
    assert true.places == len(spots)
    assert find_doubles(tree, true) == []


def test_nothing_is_tried_once_the_budget_is_spent() -> None:
    tree, true = _grow_truth(2)
    _, split = next(_split_visits(tree, true))
    assert list(merge_doubles(tree, split, lambda: True, {})) == []
