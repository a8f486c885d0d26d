"""Tests of the windowed estimate: as good as one that holds all places, at a flat cost."""

import math

import numpy as np
import pytest
from symbolic_walks import Eyes, make_grid, observe, walk_randomly

from hssh_kb import town, walk_graph
from hssh_kb.experience import Displacement
from hssh_kb.map_tree import score_hypothesis
from hssh_kb.place_filter import PlaceFilter
from hssh_kb.score import estimate_score

HEADING_VAR = 1e-3**2


def _walk(size, travels, eyes, seed):
    rng = np.random.default_rng(seed)
    world = make_grid(size, size)
    return observe(world, walk_randomly(world, travels, rng), eyes, rng)


def _follow(truth):
    """Yield the filter after each visit of the true map, and the place numbers."""
    state, number = PlaceFilter.start(), {0: 0}
    for v, first in enumerate(truth.partition):
        if v == 0:
            continue
        prediction = state.predict(truth.experience.visits[v].displacement, 1.0)
        if first == v:
            number[v] = prediction.filter.count
            state = prediction.found_place()
        else:
            state = prediction.close(number[first], 0.0, (1e-9, 1e-9, HEADING_VAR))
        yield state, prediction


def _shrink(monkeypatch, most=24, around=12):
    monkeypatch.setattr(town, "MOST_PLACES", most)
    monkeypatch.setattr(town, "_AROUND", around)


def test_small_worlds_are_held_whole():
    truth = _walk(8, 100, Eyes(), 0)
    for state, _ in _follow(truth):
        assert len(state.places) == state.count
        assert state.slots == {p: p for p in range(state.count)}


@pytest.mark.parametrize("seed", range(2))
def test_windows_change_nothing_where_headings_are_exact(monkeypatch, seed):
    """Then the problem is linear: each window is the marginal of the whole, to rounding."""
    truth = _walk(6, 120, Eyes(sigma=0.05, heading_rad=1e-6), seed)
    monkeypatch.setattr(walk_graph, "_MOST_TRAVELS", 10**6)
    whole = list(_follow(truth))
    _shrink(monkeypatch)
    windowed = list(_follow(truth))
    assert min(len(state.places) for state, _ in windowed[-50:]) < whole[-1][0].count
    for (state, ahead), (held, seen) in zip(whole, windowed, strict=True):
        for place in held.places.tolist():
            if place < seen.filter.count and place in seen.filter.slots:
                mine, theirs = seen.measure(place, 0.0), ahead.measure(place, 0.0)
                assert np.allclose(mine.residual[:2], theirs.residual[:2], atol=2e-5)
                own = np.array(theirs.cov)[:2, :2]
                assert np.allclose(np.array(mine.cov)[:2, :2], own, rtol=1e-3, atol=1e-7)
        assert held.count == state.count


@pytest.mark.parametrize("seed", range(2))
def test_windows_score_as_the_whole_does(monkeypatch, seed):
    """Windows linearise afresh, so with headings unsure the scores agree to tenths of a nat."""
    truth = _walk(6, 120, Eyes(sigma=0.03), seed)
    score = estimate_score(truth.experience)
    whole = score_hypothesis(truth.experience, truth.hypothesis(), score).log_posterior
    _shrink(monkeypatch)
    held = score_hypothesis(truth.experience, truth.hypothesis(), score).log_posterior
    assert held == pytest.approx(whole, abs=1.0)


def test_forgetting_measurements_only_widens(monkeypatch):
    """Rayleigh: leaving out a measurement never makes a covariance smaller."""
    truth = _walk(5, 150, Eyes(sigma=0.05, heading_rad=1e-6), 1)
    _shrink(monkeypatch, most=18, around=9)
    monkeypatch.setattr(walk_graph, "_RECENT", 20)
    spreads = {}
    for most in (10**6, 1):
        monkeypatch.setattr(walk_graph, "_MOST_TRAVELS", most)
        ahead = [seen for _, seen in _follow(truth)][-1]
        spreads[most] = {
            place: np.array(ahead.measure(place, 0.0).cov)[:2, :2]
            for place in ahead.filter.places.tolist()
        }
    shared = spreads[1].keys() & spreads[10**6].keys()
    assert len(shared) > 5
    widened = [np.linalg.eigvalsh(spreads[1][p] - spreads[10**6][p]) for p in shared]
    assert min(values.min() for values in widened) > -1e-7
    assert max(values.max() for values in widened) > 1e-6


def test_walk_graph_does_not_grow_with_the_walk(monkeypatch):
    """Round and round: the visits remembered are bounded by the corridors, not by the travels."""
    _shrink(monkeypatch, most=18, around=12)
    monkeypatch.setattr(walk_graph, "_RECENT", 20)
    truth = _walk(5, 500, Eyes(sigma=0.03), 2)
    kept = [len(state.town.graph.poses) for state, _ in _follow(truth)]
    assert max(kept[250:]) <= 1.1 * max(kept[:250])


def test_every_place_within_the_gate_is_held(monkeypatch):
    """A place that the visit may be at is in the window, however it was reached."""
    truth = _walk(6, 120, Eyes(sigma=0.05), 3)
    whole = [ahead for _, ahead in _follow(truth)]
    _shrink(monkeypatch)
    for ahead, (_, seen) in zip(whole, _follow(truth), strict=True):
        for place in range(ahead.filter.count):
            gap = np.array(ahead.measure(place, 0.0).residual[:2])
            cov = np.array(ahead.measure(place, 0.0).cov)[:2, :2] + 1e-9 * np.eye(2)
            if gap @ np.linalg.solve(cov, gap) < 5.0**2:
                assert place in seen.filter.slots


def test_a_place_outside_the_window_can_be_closed_with(monkeypatch):
    _shrink(monkeypatch, most=12, around=6)
    state = PlaceFilter.start()
    move = Displacement(1.0, 0.0, 0.0, ((1e-4, 0, 0), (0, 1e-4, 0), (0, 0, 1e-6)))
    for _ in range(30):
        state = state.predict(move, 1.0).found_place()
    ahead = state.predict(move, 1.0)
    assert 0 not in ahead.filter.slots
    rough = ahead.measure(0, 0.0)
    assert rough.residual[0] == pytest.approx(31.0)
    closed = ahead.close(0, 0.0, (1e-9, 1e-9, HEADING_VAR))
    assert 0 in closed.slots
    gap = closed.mean[0] - closed.mean[closed.slots[0] + 1]
    assert math.hypot(gap[0], gap[1]) < 0.01


def test_unknown_displacements_reach_anywhere(monkeypatch):
    _shrink(monkeypatch, most=8, around=4)
    state = PlaceFilter.start()
    move = Displacement(1.0, 0.0, 0.0, ((1e-4, 0, 0), (0, 1e-4, 0), (0, 0, 1e-6)))
    for _ in range(12):
        state = state.predict(move, 1.0).found_place()
    state = state.predict(None, 1.0).close(3, 0.0, (1e-9, 1e-9, math.inf))
    for _ in range(12):
        state = state.predict(move, 1.0).found_place()
    assert state.count == 25
    assert np.isfinite(state.mean).all()
    assert np.isfinite(state.cov).all()
