"""The theory against its twin on random small worlds: sets of maps, best maps, minimal maps."""

import random

import brute_force
import pytest
import worlds

from hssh_kb.errors import UsageError
from hssh_kb.experience import Experience
from hssh_kb.maps import (
    count_paths,
    enumerate_maps,
    find_inconsistent_visit,
    minimal_maps,
)
from hssh_kb.program import make_converter, strict_program
from hssh_kb.solver import solve_all
from hssh_kb.theory import POLICIES
from hssh_kb.trace import experience_from_data, experience_to_data
from hssh_kb.variant import Variant

SWITCHES = (
    {},
    {"planarity": False},
    {"order": False, "planarity": False},
    {"order": False},
)
MANY = 1500


def draw(seed: int, longest: int = 9) -> Experience:
    """A random walk in a random world: square or triangular, with stubs or without."""
    rng = random.Random(seed)
    stubs = seed % 5 == 0
    travels = rng.randint(1, 5 if stubs else longest)
    return worlds.random_experience(rng, travels, triangular=seed % 3 == 0, stubs=stubs)


def keys(maps):
    return {(h.visits, h.offsets, h.readings or (0,) * len(h.visits)) for h in maps}


@pytest.mark.parametrize("chunk", range(6))
def test_all_maps_equal_those_of_the_twin(chunk):
    for seed in range(chunk * 20, chunk * 20 + 20):
        experience, switches = draw(seed), SWITCHES[seed % 4]
        twin = brute_force.all_maps(brute_force.plain(experience), **switches)
        for engine in ("tree", "program"):
            found = enumerate_maps(experience, engine=engine, **switches)
            assert found.complete
            assert len(found.maps) == len(keys(found.maps)), f"a map twice, seed {seed}"
            assert keys(found.maps) == {tuple(m) for m in twin}, f"seed {seed}, {engine}"


@pytest.mark.parametrize("chunk", range(4))
def test_best_maps_equal_those_of_the_twin(chunk):
    for seed in range(chunk * 15, chunk * 15 + 15):
        experience = draw(seed + 1000)
        switches = SWITCHES[seed % 2]
        best, ties = brute_force.best_maps(brute_force.plain(experience), **switches)
        found = minimal_maps(experience, **switches)
        assert found.complete
        assert keys(found.maps) == {tuple(m) for m in ties}, f"seed {seed}"
        assert {cost[:2] for cost in found.costs} == {best}
        assert {(count_paths(experience, h), len(h.places)) for h in found.maps} == {best}


@pytest.mark.parametrize("chunk", range(3))
def test_subset_minimal_maps_equal_those_of_the_twin(chunk):
    for seed in range(chunk * 12, chunk * 12 + 12):
        experience, switches = draw(seed + 2000), SWITCHES[seed % 2]
        if seed % 3 == 0:
            experience = worlds.with_alternatives(random.Random(seed), draw(seed + 2000, 5))
        twin = brute_force.subset_minimal(brute_force.plain(experience), **switches)
        found = minimal_maps(experience, minimal="subset", **switches)
        assert found.complete
        assert keys(found.maps) == {tuple(m) for m in twin}, f"seed {seed}"
        fewest = minimal_maps(experience, **switches)
        if not any(len(visit.readings) > 1 for visit in experience.visits):
            assert keys(fewest.maps) <= keys(found.maps)


@pytest.mark.parametrize("seed", range(3000, 3030))
def test_readings_are_chosen_as_the_twin_chooses(seed):
    rng = random.Random(seed)
    experience = worlds.with_alternatives(rng, draw(seed, 5))
    plain = brute_force.plain(experience)
    switches = SWITCHES[seed % 4]
    twin = brute_force.all_maps(plain, **switches)
    if len(twin) > MANY:
        pytest.skip("too many maps to compare in a test")
    for engine in ("tree", "program"):
        found = enumerate_maps(experience, engine=engine, **switches)
        if twin:
            assert keys(found.maps) == {tuple(m) for m in twin}
        else:
            assert found.inconsistent_from is not None


@pytest.mark.parametrize("seed", range(4000, 4024))
def test_generators_and_planarity_by_program_or_by_filter_agree(seed):
    experience = draw(seed, 6)
    if seed % 2:
        experience = worlds.with_alternatives(random.Random(seed), draw(seed, 4))
    readings = any(len(visit.readings) > 1 for visit in experience.visits)
    convert = make_converter(len(experience), readings)
    answers = {
        generator: keys(solve_all(strict_program(experience, generator=generator), convert).found)
        for generator in ("wide", "tight", "given")
    }
    answers["filter"] = keys(enumerate_maps(experience, engine="program").maps)
    if not answers["wide"]:
        assert enumerate_maps(experience).inconsistent_from is not None
        answers["filter"] = set()
    assert answers["wide"] == answers["tight"] == answers["given"] == answers["filter"]


def contradict(rng, experience):
    """Turn on one's heel and find another star than the one left behind."""
    data = experience_to_data(experience)
    last = data["visits"][-1]
    star = experience.visits[-1].star
    last["depart"] = star.opposite(experience.visits[-1].arrive)
    size = rng.choice([n for n in (2, 4, 6) if n != len(experience.visits[-2].star)])
    texts = [f"{'abc'[k % (size // 2)]}{'+' if k < size // 2 else '-'}1" for k in range(size)]
    for depart in (0, None):
        data["visits"].append({"star": texts, "arrive": 1, "depart": depart})
    return experience_from_data(data)


@pytest.mark.parametrize("seed", range(5000, 5012))
def test_contradictory_experience_names_the_visit_and_keeps_the_maps_before(seed):
    before = draw(seed, 5)
    experience = contradict(random.Random(seed), before)
    found = enumerate_maps(experience)
    assert found.inconsistent_from == len(before)
    assert keys(found.maps) == keys(enumerate_maps(before).maps)
    best = minimal_maps(experience)
    assert best.inconsistent_from == len(before)
    assert keys(best.maps) == keys(minimal_maps(before).maps)
    twin = brute_force.Twin(brute_force.plain(experience))
    assert not list(twin.maps())
    assert twin.deepest == len(before)


def test_consistent_experience_is_inconsistent_nowhere():
    assert find_inconsistent_visit(draw(1)) is None


def test_rules_of_ones_own_are_obeyed():
    experience = worlds.grid(2, 2).drive(worlds.RING)
    every = enumerate_maps(experience).maps
    rules = "violation(mine, home(V)) :- place(V,0,O), V > 0."
    found = enumerate_maps(experience, variant=Variant(rules=rules)).maps
    assert found == tuple(h for h in every if 0 not in h.visits[1:])
    assert 0 < len(found) < len(every)


def test_limits_and_budgets_are_kept_and_said():
    experience = worlds.grid(2, 2, stubs=True).drive(worlds.RING)
    for engine in ("tree", "program"):
        some = enumerate_maps(experience, limit=10, engine=engine)
        assert len(some.maps) == 10
        assert not some.complete
        exact = enumerate_maps(experience, limit=444, engine=engine)
        assert len(exact.maps) == 444
        assert exact.complete
    long = worlds.grid(3, 3, stubs=True)
    walk = worlds.random_walk(random.Random(2), long, 40)
    late = enumerate_maps(long.drive(walk), budget_s=0.05)
    assert not late.complete
    with pytest.raises(UsageError, match="more than 0 seconds"):
        enumerate_maps(experience, budget_s=0)
    with pytest.raises(UsageError, match="at least 1 map"):
        minimal_maps(experience, limit=0)
    with pytest.raises(UsageError, match="'cardinality' or 'subset'"):
        minimal_maps(experience, minimal="least")
    with pytest.raises(UsageError, match="engine"):
        enumerate_maps(experience, engine="steam")


@pytest.mark.parametrize("policy", POLICIES)
def test_each_policy_minimises_in_its_order(policy):
    for seed in range(7000, 7006):
        experience = draw(seed, 7)
        plain = brute_force.plain(experience)
        costs = {m: brute_force.count(plain, m) for m in brute_force.all_maps(plain)}
        order = {
            "paths-then-places": lambda c: c,
            "places-then-paths": lambda c: c[::-1],
            "places-only": lambda c: c[1:],
        }[policy]
        best = min(order(c) for c in costs.values())
        expected = {tuple(m) for m, c in costs.items() if order(c) == best}
        assert keys(minimal_maps(experience, policy=policy).maps) == expected
