"""Windows laid out from their part of town: never surer than the whole, and hardly less sure."""

import math

import numpy as np
import pytest
from symbolic_walks import Eyes
from true_filters import follow_truth, walk_grid

from hssh_kb import place_filter, town, walk_graph
from hssh_kb.map_tree import score_hypothesis
from hssh_kb.score import estimate_score
from hssh_kb.walk_layout import lay_out


def _shrink(monkeypatch, part, visits_per_whole=4):
    monkeypatch.setattr(town, "MOST_PLACES", 20)
    monkeypatch.setattr(town, "_AROUND", 10)
    monkeypatch.setattr(town, "_PART", part)
    monkeypatch.setattr(town, "_VISITS_PER_WHOLE", visits_per_whole)


def test_a_part_is_never_surer_than_the_whole(monkeypatch):
    """With headings exact the problem is linear, and leaving out measurements only widens."""
    truth = walk_grid(8, 200, Eyes(sigma=0.05, heading_rad=1e-6), 0)
    monkeypatch.setattr(walk_graph, "_MOST_TRAVELS", 10**6)
    whole = [ahead for ahead, _ in follow_truth(truth)]
    _shrink(monkeypatch, part=14)
    wider, count = [], 0
    for ahead, (seen, _) in zip(whole, follow_truth(truth), strict=True):
        count += seen.filter.town.since > 0
        for place in seen.filter.places.tolist():
            one = np.array(seen.measure(place, 0.0).cov)[:2, :2]
            other = np.array(ahead.measure(place, 0.0).cov)[:2, :2]
            wider.append(np.linalg.eigvalsh(one - other))
    assert count > 20  # windows cut from a part were looked at
    assert np.min(wider) > -1e-6
    assert np.max(wider) > 1e-4


@pytest.mark.parametrize("seed", range(2))
def test_parts_score_much_as_the_whole_does(monkeypatch, seed):
    truth = walk_grid(7, 160, Eyes(sigma=0.03), seed)
    score = estimate_score(truth.experience)
    whole = score_hypothesis(truth.experience, truth.hypothesis(), score).log_posterior
    _shrink(monkeypatch, part=20)
    cut = score_hypothesis(truth.experience, truth.hypothesis(), score).log_posterior
    assert cut == pytest.approx(whole, abs=8.0)  # 0.05 for each visit


def test_places_outside_are_not_thought_nearer_than_they_may_be(monkeypatch):
    """The deviations told by samples cover how far off the places truly are."""
    _shrink(monkeypatch, part=16)
    worst = []
    for seed in range(2):
        truth = walk_grid(8, 200, Eyes(sigma=0.05), seed)
        where = {}
        for v, first in enumerate(truth.partition):
            if first == v:
                where[len(where)] = truth.places[v]
        cells = np.array([divmod(where[p], 8)[::-1] for p in range(len(where))], float)
        for v, (ahead, _) in enumerate(follow_truth(truth)):
            held = ahead.filter.town
            if ahead.filter.log is not None or not held.outside.any():
                continue  # only windows just made
            here = np.array(divmod(truth.places[v], 8)[::-1], float)
            turn = held.graph.poses[held.graph.last, 2]
            away = held.spots - held.graph.poses[held.graph.last, :2]
            known = cells[: len(held.spots)] - here
            true = known @ np.array(
                [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
            )
            off = np.hypot(*(away - true).T)
            worst.append(np.max((off / (held.deviations[:, 0] + 1e-9))[held.outside]))
    assert len(worst) > 20
    assert max(worst) < place_filter._REACH_SIGMAS


def test_headings_that_no_closure_measured_leave_no_part_undetermined(monkeypatch):
    """Closures whose heading was refused tell positions only; every part can still be laid out."""
    _shrink(monkeypatch, part=12, visits_per_whole=2)
    truth = walk_grid(7, 200, Eyes(sigma=0.03), 1)
    for _, state in follow_truth(truth, heading_var=math.inf):
        assert np.isfinite(state.mean).all()
        assert np.isfinite(state.visit_cov).all()
        assert (np.einsum("iaa->ia", state.own) > -1e-9).all()


def test_a_part_is_joined_by_the_shortest_ways(monkeypatch):
    _shrink(monkeypatch, part=10)
    truth = walk_grid(7, 150, Eyes(sigma=0.03), 2)
    *_, (_, state) = follow_truth(truth)
    graph = state.town.graph
    wanted = np.zeros(len(graph.first), bool)
    wanted[0] = True
    joined = graph.find_paths(wanted)
    assert joined[0]
    assert joined[graph.place[graph.last]]
    cut, nodes = graph.cut(joined)
    assert np.allclose(cut.poses, graph.poses[nodes])
    window = lay_out(cut, np.zeros(1, np.intp), 1.0, sampled=False)
    assert np.isfinite(window.cov).all()
    assert cut.first.size == joined.sum() < len(graph.first)
