"""Assumptions that only planarity stands against: answers and cores against brute force."""

import random

import brute_force
import pytest
import worlds

from hssh_kb.check import check, parse_assumption
from hssh_kb.oracle import Oracle

MANY = 3000


def compare(seed, questions=6):
    """How many answers are wrong, and how many say no where only planarity does."""
    rng = random.Random(seed)
    stubs = seed % 3 != 0
    travels = rng.randint(5, 6 if stubs else 10)
    experience = worlds.random_experience(rng, travels, triangular=seed % 4 == 0, stubs=stubs)
    plain = brute_force.plain(experience)
    planar = brute_force.all_maps(plain)
    every = brute_force.all_maps(plain, planarity=False) if len(planar) < MANY else planar
    crossed = sorted(every - planar)
    wrong = refused = 0
    for _ in range(questions if crossed else 0):
        given = draw(rng, rng.choice(crossed), len(experience))
        expected = any(all((m.visits[v] == m.visits[w]) == s for v, w, s in given) for m in planar)
        texts = [f"v{v}{'=' if s else '!='}v{w}" for v, w, s in given]
        supposed = [parse_assumption(experience, text) for text in texts]
        oracle = Oracle(experience, supposed)
        found = oracle.find_map(frozenset(oracle.literals()))
        if found is not None:
            wrong += not expected or (found.visits, found.offsets) not in {m[:2] for m in planar}
        else:
            again = Oracle(experience, supposed)
            wrong += expected or again.find_map(oracle.cores[-1]) is not None
            refused += 1
    return wrong, refused


def draw(rng, m, count):
    """Some of what a map that is not planar says: pairs of visits that are one place, or not."""
    pairs = [(v, w) for v in range(count) for w in range(v)]
    same = [(v, w, True) for v, w in pairs if m.visits[v] == m.visits[w]]
    different = [(v, w, False) for v, w in pairs if m.visits[v] != m.visits[w]]
    given = rng.sample(same, min(len(same), rng.randint(2, 4)))
    return given + rng.sample(different, min(len(different), rng.randint(0, 3)))


def test_planarity_refuses_as_the_twin_does():
    wrong, refused = (sum(column) for column in zip(*map(compare, range(16)), strict=True))
    assert wrong == 0
    assert refused >= 10


@pytest.mark.parametrize("seed", [5, 8])
def test_true_pairs_of_a_long_walk_of_pluses_with_other_readings_have_a_map(seed):
    rng = random.Random(seed)
    route = worlds.random_walk(rng, worlds.grid(5, 5), 59)
    experience = worlds.grid(5, 5, stubs=True).drive(route, [rng.randrange(4) for _ in route])
    experience = worlds.with_alternatives(rng, experience)
    true = [(v, w) for v in range(60) for w in range(v) if route[v] == route[w]]
    asked = rng.sample(true, 4)
    answer = check(experience, [f"v{v}=v{w}" for v, w in asked], budget_s=20)
    assert answer.status == "consistent"
    assert all(answer.example.visits[v] == answer.example.visits[w] for v, w in asked)
