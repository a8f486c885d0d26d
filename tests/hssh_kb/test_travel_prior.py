"""What travels have in common: estimated, applied once to each corridor, or left alone."""

import math
from dataclasses import replace

import numpy as np
import pytest
from symbolic_walks import Eyes, make_grid, observe, walk_randomly

from hssh_kb.experience import Displacement, Experience
from hssh_kb.map_tree import grow_hypothesis, score_hypothesis
from hssh_kb.score import estimate_score
from hssh_kb.travel_prior import TravelPrior, estimate_travel_prior, find_heading


def _walk(seed, travels=200, *, size=6, world=None, **eyes):
    rng = np.random.default_rng(seed)
    world = make_grid(size, size) if world is None else world
    return observe(world, walk_randomly(world, travels, rng), Eyes(**eyes), rng)


def _stretch(world, x_to_x):
    """The world with other columns: corridors have the lengths that this gives them."""
    spots = tuple((x_to_x(x), y) for x, y in world.positions)
    return replace(world, positions=spots)


def _move(x, y, sigma):
    return Displacement(x, y, 0.0, ((sigma**2, 0, 0), (0, sigma**2, 0), (0, 0, 1e-4)))


@pytest.mark.parametrize("headings", [True, False])
def test_corridors_built_to_one_measure_are_known_better_than_measured(headings):
    found = estimate_travel_prior(_walk(0, sigma=0.1, headings=headings).experience)
    assert found is not None
    assert found.length_m == pytest.approx(1.0, abs=0.03)
    assert 0.0 < found.along_m2 < 0.1**2 / 2  # cautious: not zero, though the truth is
    assert math.isinf(found.across_m2) is not headings


def test_corridors_of_many_lengths_tell_nothing():
    rng = np.random.default_rng(1)
    world = make_grid(6, 6, jitter=0.2, rng=rng)
    assert estimate_travel_prior(_walk(0, world=world, sigma=0.05).experience) is None


def test_a_wing_of_another_measure_widens_the_prior():
    same = make_grid(12, 3)
    wings = _stretch(same, lambda x: x if x <= 5 else 5 + 1.15 * (x - 5))
    for seed in range(3):
        alike, apart = (
            estimate_travel_prior(_walk(seed, 400, world=one, sigma=0.1).experience)
            for one in (same, wings)
        )
        assert alike is not None
        assert apart is None or apart.along_m2 > 2 * alike.along_m2


def test_travels_that_may_pass_places_unnoticed_and_short_walks_tell_nothing():
    walk = _walk(0, sigma=0.1).experience
    assert estimate_travel_prior(replace(walk, slip=0.02)) is None
    assert estimate_travel_prior(Experience(walk.visits[:10])) is None
    assert estimate_travel_prior(Experience(())) is None


def test_sharpened_travels_lie_closer_to_the_truth_and_say_how_close():
    truth = _walk(2, 400, sigma=0.1)
    prior = estimate_travel_prior(truth.experience)
    off, told_off = [], []
    for before, visit in zip(truth.experience.visits, truth.experience.visits[1:], strict=False):
        heading = find_heading(before.readings[0])
        told = prior.sharpen(visit.displacement, heading).move
        true = np.array([math.cos(heading), math.sin(heading)])
        off.append(np.array([visit.displacement.x, visit.displacement.y]) - true)
        told_off.append(np.array([told.x, told.y]) - true)
        assert np.linalg.eigvalsh(np.array(told.cov)).min() > 0
    assert np.std(told_off) < 0.6 * np.std(off)
    assert np.std(told_off) < 1.2 * math.sqrt(told.cov[0][0])


def test_a_travel_of_another_kind_stays_as_measured():
    prior = TravelPrior(1.0, 1e-3, 1e-3, 0.97, 3.0)
    move = _move(2.0, 0.1, 0.1)
    assert prior.sharpen(move, 0.0).move is move
    assert prior.sharpen(_move(0.0, 1.0, 0.1), 0.0).move.y == 1.0  # not where the dlp leads


@pytest.mark.parametrize("heading", [0.3, None])
def test_the_density_of_a_travel_integrates_to_one(heading):
    prior = TravelPrior(1.0, 0.01, 0.02 if heading is not None else math.inf, 0.9, 2.0)
    grid = np.linspace(-3, 3, 61) + 1e-3
    total = 0.0
    for x in grid:
        for y in grid:
            density = math.exp(prior.sharpen(_move(x, y, 0.2), heading).log_density)
            if math.hypot(x, y) > prior.reach_m:  # the even part ends there
                density -= (1 - prior.share) / (math.pi * prior.reach_m**2)
            total += density
    assert total * (grid[1] - grid[0]) ** 2 == pytest.approx(1, abs=0.02)


def test_the_prior_counts_once_for_each_corridor():
    truth = _walk(3, 60, size=3, sigma=0.1)
    score = replace(estimate_score(truth.experience), place_prior=0.0)
    assert score.travels is not None
    tree, node = grow_hypothesis(truth.experience, truth.hypothesis(), score)
    known, corridors = set(), 0
    for one in node.chain()[2:]:
        before = truth.experience.visits[one.visit - 1].readings[0]
        state = tree.state_of(one.parent)
        gateway = state.place, (before.depart + state.offset) % len(before.star)
        assert (one.addends.travels == 0) is (gateway not in known)
        if gateway not in known:
            corridors += 1
            known |= {gateway, tree.state_of(one).judge.follow(*gateway)}
    assert 8 <= corridors <= 12  # of a 3x3 grid
    told = score_hypothesis(truth.experience, truth.hypothesis(), score)
    assert told.terms["travels"] == pytest.approx(sum(o.addends.travels for o in node.chain()[1:]))
