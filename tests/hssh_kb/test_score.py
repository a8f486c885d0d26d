"""The posterior score: densities that are normalised, exclusion, headings, bad parameters."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import betaln
from symbolic_walks import Eyes, make_grid, observe, walk_randomly

from hssh_kb.errors import InputError
from hssh_kb.experience import Displacement
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.layout import lay_out_hypothesis
from hssh_kb.map_tree import score_hypothesis
from hssh_kb.place_filter import PlaceFilter
from hssh_kb.score import TERMS, Score, estimate_score
from hssh_kb.trace import experience_from_data, experience_to_data


def _move(x, y, theta=0.0, sigma=0.1, heading=0.02):
    cov = ((sigma**2, 0.0, 0.0), (0.0, sigma**2, 0.0), (0.0, 0.0, heading**2))
    return Displacement(x, y, theta, cov)


def _truth(seed, travels=40, **eyes):
    rng = np.random.default_rng(seed)
    world = make_grid(4, 4)
    return observe(world, walk_randomly(world, travels, rng), Eyes(**eyes), rng)


def test_the_density_of_a_closure_integrates_to_one_over_where_the_robot_may_say_it_is():
    score = Score(spread_m=0.05, outlier=0.05)
    grid = np.linspace(-2, 2, 81)
    total = 0.0
    for x in grid:
        for y in grid:
            prediction = PlaceFilter.start().predict(_move(x, y, sigma=0.3), 1.0)
            innovation = prediction.measure(0, 0.0)
            total += math.exp(score.weigh_closure(prediction, innovation, math.inf)[0])
    assert total * (grid[1] - grid[0]) ** 2 == pytest.approx(1, abs=0.01)


def test_a_closure_beats_a_new_place_only_where_the_map_is_sure_enough():
    score = Score(area_m2=1.0)
    for sigma, closes in ((0.05, True), (0.2, True), (1.0, False)):
        prediction = PlaceFilter.start().predict(_move(0.0, 0.0, sigma=sigma), 1.0)
        closure = score.weigh_closure(prediction, prediction.measure(0, 0.0), math.inf)[0]
        assert (closure > score.weigh_new(prediction)[0]) is closes


def test_exclusion_is_the_chance_of_lying_apart():
    score = Score(spacing_m=0.5, floor=-20.0)
    rng = np.random.default_rng(0)
    for x, sigma in ((0.0, 0.4), (0.6, 0.3), (1.5, 0.5), (3.0, 0.1)):
        prediction = PlaceFilter.start().predict(_move(x, 0.0, sigma=sigma), 1.0)
        points = rng.normal((x, 0.0), sigma, (200_000, 2))
        apart = float(-np.expm1(-0.5 * (points**2).sum(axis=1) / 0.5**2).mean())
        assert math.exp(score.weigh_new(prediction)[1]) == pytest.approx(apart, abs=0.01)


def test_exclusion_never_costs_more_than_the_floor():
    prediction = PlaceFilter.start().predict(_move(0.0, 0.0, sigma=1e-4), 1.0)
    assert Score(floor=-7.0).weigh_new(prediction)[1] == pytest.approx(-7.0)


def test_headings_turn_the_frame_of_a_visit_into_that_of_its_place():
    at_place = [0.1, -1.5, 3.1, 1.6]
    at_visit = [at_place[(k + 3) % 4] - 0.4 for k in range(4)]
    turn, var, misfit = Score().match_headings(at_place, at_visit, 3, [1, 1, 1, 1])
    assert turn == pytest.approx(0.4)
    assert misfit == 0.0
    assert 0 < var < Score().dlp_heading_rad ** 2
    bent = [at_visit[0] + 0.8, *at_visit[1:]]
    assert Score().match_headings(at_place, bent, 3, [1, 1, 1, 1])[2] < -3
    unseen = Score().match_headings(at_place, bent, 3, [0, 1, 1, 1])
    assert unseen[0] == pytest.approx(0.4)
    assert unseen[2] == 0.0


def test_without_headings_frames_are_one_or_unknown():
    assert Score(frames="shared").match_headings((), (), 0, ())[1] < 1e-4
    assert math.isinf(Score(frames="free").match_headings((), (), 0, ())[1])
    assert estimate_score(_truth(0, headings=False).experience).frames == "shared"
    turning = _truth(0, headings=False, robot_frames=True).experience
    assert estimate_score(turning).frames == "free"


def test_scales_come_from_the_data_and_follow_the_unit():
    metres = estimate_score(_truth(1).experience)
    feet = estimate_score(_truth(1, scale=3.28).experience)
    assert metres.length_m == pytest.approx(1, abs=0.1)
    assert feet.area_m2 == pytest.approx(3.28**2 * metres.area_m2, rel=0.05)
    assert feet.spacing_m == pytest.approx(3.28 * metres.spacing_m, rel=0.05)


def test_the_filter_ends_where_least_squares_does():
    truth = _truth(2, travels=60, sigma=0.03, headings=False)
    score = estimate_score(truth.experience)
    hypothesis = truth.hypothesis()
    laid = lay_out_hypothesis(truth.experience, hypothesis)
    state = PlaceFilter.start()
    number = {first: i for i, first in enumerate(hypothesis.places)}
    for v in range(1, len(truth.experience)):
        prediction = state.predict(truth.experience.visits[v].displacement, 1.0)
        if hypothesis.visits[v] == v:
            state = prediction.found_place()
            continue
        first = hypothesis.visits[v]
        mine = hypothesis.reading(truth.experience, v)
        theirs = hypothesis.reading(truth.experience, first)
        turn, var, _ = score.match_headings(
            theirs.headings, mine.headings, hypothesis.offsets[v], mine.star.alpha
        )
        state = prediction.close(number[first], turn, (1e-8, 1e-8, var))
    gap = state.mean[1:] - laid.poses
    assert np.abs(gap[:, :2]).max() < 0.02
    spread = np.sqrt(np.diagonal(laid.covariances, axis1=1, axis2=2))
    filtered = np.sqrt(np.diag(state.cov)[3:].reshape(-1, 3))
    assert np.allclose(filtered[1:, :2], spread[1:, :2], rtol=0.15)
    assert np.allclose(state.cov, state.cov.T, atol=1e-12)


def test_terms_add_up_and_the_truth_beats_its_neighbours():
    truth = _truth(3, travels=30)
    score = estimate_score(truth.experience)
    best = score_hypothesis(truth.experience, truth.hypothesis(), score)
    assert tuple(best.terms) == TERMS
    assert sum(best.terms.values()) == pytest.approx(best.log_posterior)
    whole = truth.hypothesis()
    later = max(v for v, first in enumerate(whole.visits) if first != v)
    apart = tuple(v if v == later else first for v, first in enumerate(whole.visits))
    offsets = tuple(0 if v == later else r for v, r in enumerate(whole.offsets))
    worse = score_hypothesis(truth.experience, Hypothesis(apart, offsets), score)
    assert worse.log_posterior < best.log_posterior - 3
    assert worse.terms["exclusion"] < -1


def test_a_reading_costs_its_weight_and_a_doubt_the_slip():
    truth = _truth(4, travels=12, wrong=1.0)
    score = estimate_score(truth.experience, slip=0.05)
    plain = score_hypothesis(truth.experience, truth.hypothesis(), score)
    weights = [
        visit.readings[i].weight
        for visit, i in zip(truth.experience.visits, truth.readings, strict=True)
    ]
    assert plain.terms["readings"] == pytest.approx(sum(map(math.log, weights)))
    whole = truth.hypothesis()
    doubting = Hypothesis(whole.visits, whole.offsets, whole.readings, doubted=(5, 9))
    terms = score_hypothesis(truth.experience, doubting, score).terms
    m, a = score.slip_travels, 0.05 * score.slip_travels
    # Twelve travels, two of them doubted: a beta-binomial count, whichever two they are.
    expected = betaln(a + 2, m - a + 10) - betaln(a, m - a)
    assert terms["doubts"] == pytest.approx(expected)
    second = score.weigh_doubt(True, 1, 8)
    assert score.weigh_doubt(True, 0, 8) < second < score.weigh_doubt(True, 5, 8) < 0


def test_headings_that_are_far_off_say_nothing_where_gateways_may_be_seen_askew():
    log, symbols = Score(askew=0.1), Score()
    straight, turned, one_off = (0.0, 1.5, 3.1), (0.35, 1.85, 3.45), (0.0, 2.0, 3.1)
    prediction = PlaceFilter.start().predict(_move(0.01, 0.0), 1.0)

    def weigh(score, seen):
        turn, var, misfit = score.match_headings(straight, seen, 0, (1, 1, 1))
        innovation = prediction.measure(0, turn)
        _, heading, noise = score.weigh_closure(prediction, innovation, var)
        return heading + misfit, noise[2]

    assert weigh(log, straight)[0] == pytest.approx(0.0, abs=1e-9)
    for seen in (turned, one_off):
        assert 2 * math.log(0.1) <= weigh(log, seen)[0] < -1 > weigh(symbols, seen)[0] + 1
    assert weigh(log, turned)[1] == math.inf  # they do not turn the map either
    assert weigh(log, one_off)[1] > 2 * weigh(log, straight)[1]


def test_a_missing_displacement_favours_neither_old_nor_new():
    score = Score(area_m2=2.0)
    prediction = PlaceFilter.start().predict(None, 1.0)
    closure = score.weigh_closure(prediction, prediction.measure(0, 0.0), math.inf)[0]
    assert closure == score.weigh_new(prediction)[0] == -math.log(2.0)
    assert score.weigh_new(prediction)[1] == 0.0


def test_the_bound_of_a_travel_is_never_beaten():
    rng = np.random.default_rng(0)
    score = Score(spread_m=0.02, area_m2=0.7)
    for _ in range(200):
        move = _move(*rng.normal(size=2), sigma=float(rng.uniform(0.01, 0.5)))
        state = PlaceFilter.start().predict(_move(1.0, 0.0), 1.0).found_place()
        prediction = state.predict(move, 1.0)
        bound = score.bound_travel(move.cov)
        for place in (0, 1):
            innovation = prediction.measure(place, 0.0)
            assert score.weigh_closure(prediction, innovation, math.inf)[0] <= bound + 1e-9
        assert score.weigh_new(prediction)[0] <= bound


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"area_m2": 0.0}, "area_m2 must be positive"),
        ({"spacing_m": -1.0}, "spacing_m must be positive"),
        ({"frames": "mine"}, "frames must be"),
        ({"slip": 1.0}, "probabilities"),
    ],
)
def test_parameters_out_of_range_are_told(values, words):
    with pytest.raises(InputError, match=words):
        Score(**values)


def test_a_hypothesis_that_does_not_fit_is_told():
    truth = _truth(5, travels=20)
    whole, stars = truth.hypothesis(), [visit.star for visit in truth.experience.visits]
    odd = next(v for v in range(1, 21) if not stars[v].isomorphisms(stars[0]))
    bad = Hypothesis((*whole.visits[:odd], 0), (*whole.offsets[:odd], 0))
    with pytest.raises(InputError, match=f"visit {odd} does not match the star of place 0"):
        score_hypothesis(truth.experience, bad, estimate_score(truth.experience))


@pytest.mark.parametrize("nats", [3.0, -2.5])
def test_the_match_of_local_maps_counts_for_the_closure_and_never_above_zero(nats):
    truth = _truth(3, travels=30)
    score, whole = estimate_score(truth.experience), truth.hypothesis()
    later = max(v for v, first in enumerate(whole.visits) if first != v)
    apart = Hypothesis(
        tuple(v if v == later else first for v, first in enumerate(whole.visits)),
        tuple(0 if v == later else r for v, r in enumerate(whole.offsets)),
    )
    visits = list(truth.experience.visits)
    visits[later] = replace(visits[later], lpm_matches=((whole.visits[later], nats),))
    said = replace(truth.experience, visits=tuple(visits))
    gain = []
    for experience in (truth.experience, said):
        one, other = (score_hypothesis(experience, h, score) for h in (whole, apart))
        gain.append(one.log_posterior - other.log_posterior)
        assert max(one.terms["lpm"], other.terms["lpm"]) <= 0
    assert gain[1] - gain[0] == pytest.approx(nats)


def test_matches_of_local_maps_are_kept_in_a_trace_and_checked():
    truth = _truth(3, travels=4)
    visits = list(truth.experience.visits)
    visits[2] = replace(visits[2], lpm_matches=((0, 1.5), (1, -2.0)))
    data = experience_to_data(replace(truth.experience, visits=tuple(visits)))
    assert experience_from_data(data).visits[2].lpm_matches == ((0, 1.5), (1, -2.0))
    data["visits"][2]["lpm_matches"] = [[2, 1.0]]
    with pytest.raises(InputError, match="earlier visit"):
        experience_from_data(data)
