"""Tests of the windowed estimate: as good as one that holds all places, at a flat cost."""

import math

import numpy as np
import pytest
from symbolic_walks import Eyes
from true_filters import follow_truth, walk_grid

from hssh_kb import town, walk_graph
from hssh_kb.experience import Displacement
from hssh_kb.map_tree import score_hypothesis
from hssh_kb.place_filter import PlaceFilter
from hssh_kb.score import estimate_score

HEADING_VAR = 1e-3**2


def _shrink(monkeypatch, most=24, around=12):
    monkeypatch.setattr(town, "MOST_PLACES", most)
    monkeypatch.setattr(town, "_AROUND", around)


def test_small_worlds_are_held_whole():
    truth = walk_grid(8, 100, Eyes(), 0)
    for _, state in follow_truth(truth):
        assert len(state.places) == state.count
        assert state.slots == {p: p for p in range(state.count)}


@pytest.mark.parametrize("seed", range(2))
def test_windows_change_nothing_where_headings_are_exact(monkeypatch, seed):
    """Then the problem is linear: each window is the marginal of the whole, to rounding."""
    truth = walk_grid(6, 120, Eyes(sigma=0.05, heading_rad=1e-6), seed)
    monkeypatch.setattr(walk_graph, "_MOST_TRAVELS", 10**6)
    whole = list(follow_truth(truth))
    _shrink(monkeypatch)
    windowed = list(follow_truth(truth))
    assert min(len(state.places) for _, state in windowed[-50:]) < whole[-1][1].count
    for (ahead, state), (seen, held) in zip(whole, windowed, strict=True):
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
    truth = walk_grid(6, 120, Eyes(sigma=0.03), seed)
    score = estimate_score(truth.experience)
    whole = score_hypothesis(truth.experience, truth.hypothesis(), score).log_posterior
    _shrink(monkeypatch)
    held = score_hypothesis(truth.experience, truth.hypothesis(), score).log_posterior
    assert held == pytest.approx(whole, abs=1.0)


def test_forgetting_measurements_only_widens(monkeypatch):
    """Rayleigh: leaving out a measurement never makes a covariance smaller."""
    truth = walk_grid(5, 150, Eyes(sigma=0.05, heading_rad=1e-6), 1)
    _shrink(monkeypatch, most=18, around=9)
    monkeypatch.setattr(walk_graph, "_RECENT", 20)
    spreads = {}
    for most in (10**6, 1):
        monkeypatch.setattr(walk_graph, "_MOST_TRAVELS", most)
        ahead = [seen for seen, _ in follow_truth(truth)][-1]
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
    truth = walk_grid(5, 500, Eyes(sigma=0.03), 2)
    kept = [len(state.town.graph.poses) for _, state in follow_truth(truth)]
    assert max(kept[250:]) <= 1.1 * max(kept[:250])


def test_every_place_within_the_gate_is_held(monkeypatch):
    """A place that the visit may be at is in the window, however it was reached."""
    truth = walk_grid(6, 120, Eyes(sigma=0.05), 3)
    whole = [ahead for ahead, _ in follow_truth(truth)]
    _shrink(monkeypatch)
    for ahead, (seen, _) in zip(whole, follow_truth(truth), strict=True):
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
