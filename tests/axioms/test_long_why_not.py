"""Why-not on long walks where planarity decides: maps that hold, and a small part that has none."""

import random

import pytest
import worlds

from hssh_kb.check import check
from hssh_kb.consistency import judge_hypothesis
from hssh_kb.trace import make_experience


@pytest.mark.parametrize("seed", range(6))
def test_true_assumptions_about_a_long_walk_have_a_planar_map(seed):
    rng = random.Random(seed)
    world = worlds.grid(5, 5, stubs=seed % 2 == 1)
    route = worlds.random_walk(rng, worlds.grid(5, 5), 59)
    experience = world.drive(route, [rng.randrange(4) for _ in route])
    pairs = [(v, w) for v in range(60) for w in range(v) if route[v] == route[w]]
    given = rng.sample(pairs, 2)
    answer = check(experience, [f"v{v}=v{w}" for v, w in given], budget_s=20)
    assert answer.status == "consistent"
    assert all(answer.example.visits[v] == answer.example.visits[w] for v, w in given)
    assert judge_hypothesis(experience, answer.example).consistent


def test_planarity_alone_says_no_on_a_long_walk():
    # Along a straight road of places to a crossing, through which two loops then cross.
    corner = ["c+1", "d+1", "c-0", "d-0"]
    cross = ["a+1", "b+1", "c-0", "a-1", "b-1", "c+1"]
    road = ["e+1", "f-0", "f+1", "e-1"]
    turn = (corner, 2, 1)
    walk = [(road, None, 0), *[(road, 0, 0)] * 39, (cross, 2, 0), turn, turn]
    walk += [(cross, 0, 1), turn, turn, (cross, 1, None)]
    experience = make_experience(walk)
    answer = check(experience, ["v43=v40", "v46=v40"])
    assert answer.status == "violated"
    assert answer.violations[0].axiom == "planarity"
    assert {"v40", "v43", "v46"} <= set(answer.violations[0].observations)
    assert "drop the assumption v46 = v40" in {r for repair in answer.repairs for r in repair}
    assert "v0" not in answer.violations[0].observations
    assert check(experience, ["v43=v40", "v46=v40"], planarity=False).consistent
