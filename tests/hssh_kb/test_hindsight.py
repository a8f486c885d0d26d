"""Looking back: true maps are not strange, wrong ones are, and the search mends them there."""

import math

import numpy as np
import pytest
from symbolic_walks import Eyes, make_grid, observe, walk_randomly

from hssh_kb import tree_search
from hssh_kb.hindsight import find_strange_stretch, rate_strangeness
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.map_tree import grow_hypothesis
from hssh_kb.score import estimate_score
from hssh_kb.search import search_maps


def _walk(seed, size, travels, **eyes):
    rng = np.random.default_rng(seed)
    world = make_grid(size, size)
    return observe(world, walk_randomly(world, travels, rng), Eyes(**eyes), rng)


def _grow(truth, hypothesis):
    score = estimate_score(truth.experience)
    _, node = grow_hypothesis(truth.experience, hypothesis, score, order=False, planarity=False)
    return node, score


def _forget(hypothesis, since):
    """The map that takes no visit from one on for a place known before it."""
    visits = tuple(
        next(u for u in range(v + 1) if hypothesis.visits[u] == p and (u >= since or v < since))
        for v, p in enumerate(hypothesis.visits)
    )
    turns = hypothesis.offsets
    stars = [turns[v] - turns[p] for v, p in enumerate(visits)]
    return Hypothesis(visits, tuple(turn % 4 for turn in stars))


@pytest.mark.parametrize("sigma", [0.05, 0.1])
def test_true_maps_are_not_strange(sigma):
    for seed in range(4):
        truth = _walk(seed, 6, 150, sigma=sigma)
        lead, score = _grow(truth, truth.hypothesis())
        assert find_strange_stretch(lead, 0, score, {}) is None


def test_a_map_that_forgets_its_places_is_strange_from_there_on():
    truth = _walk(0, 5, 100, sigma=0.05)
    lead, score = _grow(truth, _forget(truth.hypothesis(), 60))
    assert not any(rate_strangeness(node, 0.0) > 0 for node in lead.chain()[1:61])
    tried = {}
    stretch = find_strange_stretch(lead, 0, score, tried)
    assert stretch.start < 60 <= stretch.strange.visit < 70 <= stretch.end
    assert find_strange_stretch(lead, 0, score, tried) == stretch
    assert find_strange_stretch(lead, 0, score, tried).strange.visit > stretch.strange.visit
    assert find_strange_stretch(lead, 80, score, {}).strange.visit >= 80
    assert find_strange_stretch(None, 0, score, {}) is None


def test_the_search_finds_where_it_went_wrong(monkeypatch):
    truth = _walk(11, 12, 700, sigma=0.05)
    score = estimate_score(truth.experience, dlp_heading_rad=math.radians(5.0))
    monkeypatch.setattr(tree_search, "_AGAIN", 0)  # narrow fronts only
    monkeypatch.setattr(tree_search, "_AGAIN_LEAST", 0)
    monkeypatch.setattr(tree_search, "merge_doubles", lambda *_: ())
    assert search_maps(truth.experience, score=score).maps[0].visits == truth.partition
    monkeypatch.setattr(tree_search, "find_strange_stretch", lambda *_: None)
    assert search_maps(truth.experience, score=score).maps[0].visits != truth.partition
