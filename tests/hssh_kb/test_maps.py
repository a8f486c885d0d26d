"""Paths of a map: a partition of its dstates, in order, both ways."""

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import brute_force
import worlds

from hssh_kb.consistency import judge_hypothesis
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.maps import count_paths, enumerate_maps, minimal_maps, path_classes
from hssh_kb.planarity import is_planar
from hssh_kb.ranking import COUNT_LIMIT, rank_maps


@pytest.mark.parametrize("seed", range(12))
def test_paths_partition_the_dstates_and_come_in_pairs(seed):
    experience = worlds.random_experience(random.Random(seed), 8, triangular=seed % 3 == 0)
    plain = brute_force.plain(experience)
    for hypothesis in enumerate_maps(experience).maps[:20]:
        paths = path_classes(experience, hypothesis)
        dstates = [q for path in paths for q in path]
        stars = {p: hypothesis.reading(experience, p).star for p in hypothesis.places}
        assert sorted(dstates) == sorted((p, k) for p, s in stars.items() for k in range(len(s)))
        turned = {tuple((p, stars[p].opposite(k)) for p, k in reversed(path)) for path in paths}
        assert turned == set(paths)
        assert all(len({p for p, _ in path}) == len(path) for path in paths)
        twin = brute_force.Map(hypothesis.visits, hypothesis.offsets, (0,) * len(plain))
        assert count_paths(experience, hypothesis) == brute_force.count(plain, twin)[0]
        assert len(paths) == 2 * count_paths(experience, hypothesis)


def test_circular_paths_are_counted_without_the_order_axiom():
    plus = ["a+1", "b+1", "a-1", "b-1"]
    from hssh_kb.trace import make_experience

    ring = make_experience([(plus, None, 0), (plus, 0, 0), (plus, 0, None)])
    hypothesis = Hypothesis((0, 1, 0), (0, 0, 0))
    assert count_paths(ring, hypothesis) == 3
    assert is_planar(ring, hypothesis)


def test_doubted_travels_join_nothing():
    experience = worlds.grid(2, 2).drive(worlds.RING[:3])
    whole = Hypothesis((0, 1, 2), (0, 0, 0))
    doubted = Hypothesis((0, 1, 2), (0, 0, 0), doubted=(2,))
    assert count_paths(experience, whole) == 4
    assert count_paths(experience, doubted) == 5


def test_maps_come_in_the_same_order_each_time():
    experience = worlds.grid(3, 3).drive(worlds.REFERENCES["grid-3x3-ltplus"][1])
    first = enumerate_maps(experience).maps
    assert (
        first
        == enumerate_maps(experience).maps
        == enumerate_maps(experience, engine="program").maps
    )
    assert list(first) == sorted(first, key=lambda h: (h.visits, h.offsets))


def test_a_walk_too_long_to_be_solved_in_time_still_gives_maps():
    rng = random.Random(5)
    route = worlds.random_walk(rng, worlds.grid(5, 5), 60)
    experience = worlds.grid(5, 5).drive(route)
    found = minimal_maps(experience, budget_s=1.0)
    assert not found.complete
    assert found.maps
    for hypothesis, cost in zip(found.maps, found.costs, strict=True):
        assert judge_hypothesis(experience, hypothesis).consistent
        assert cost[:2] == (count_paths(experience, hypothesis), len(hypothesis.places))


def test_all_maps_are_no_more_than_can_be_ranked_within_the_budget():
    experience = worlds.grid(3, 2, stubs=True).drive(worlds.FIGURE8)
    few = rank_maps(experience, every=True, budget_s=1.0)
    assert few.budget_spent
    assert len(few.maps) == COUNT_LIMIT
    assert few.consistent is None
    every = rank_maps(experience, every=True, budget_s=60.0)
    assert not every.budget_spent
    assert every.consistent == len(every.maps) == 10_651
