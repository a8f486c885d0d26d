"""Minimal maps by the lean program, against all maps of the tree, and on a walk of 60 travels."""

import random

import pytest
import worlds

from hssh_kb.consistency import judge_hypothesis
from hssh_kb.maps import enumerate_maps, minimal_maps
from hssh_kb.ranking import measure_map

POLICIES = ("paths-then-places", "places-then-paths", "places-only")


@pytest.mark.parametrize("planarity", [True, False])
def test_the_best_maps_are_the_best_of_all_maps(planarity):
    compared = 0
    for seed in range(24):
        rng = random.Random(seed)
        stubs = seed % 3 == 0
        travels = rng.randint(4, 6 if stubs else 12)
        experience = worlds.random_experience(rng, travels, triangular=seed % 4 == 0, stubs=stubs)
        every = enumerate_maps(experience, planarity=planarity, limit=5000)
        if not every.complete:
            continue
        policy = POLICIES[seed % 3]
        cost = {h: measure_map(experience, h, policy) for h in every.maps}
        least = min(cost.values())
        found = minimal_maps(experience, planarity=planarity, policy=policy)
        assert found.complete
        assert set(found.maps) == {h for h in every.maps if cost[h] == least}
        assert found.costs[0] == least
        compared += 1
    assert compared >= 18


def test_a_walk_of_sixty_travels_is_proven():
    rng = random.Random(0)
    world = worlds.grid(4, 4)
    route = worlds.random_walk(rng, world, 60)
    experience = world.drive(route, [rng.randrange(4) for _ in route])
    found = minimal_maps(experience)
    assert found.complete
    assert found.costs[0] == (4, 8, 0)
    assert all(judge_hypothesis(experience, h).consistent for h in found.maps)
