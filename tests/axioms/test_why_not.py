"""Why-not: minimal conflicts and repairs against brute force; sentences; no empty answer."""

import random

import brute_force
import pytest
import worlds
from force_why import Force

from hssh_kb.check import check, parse_assumption
from hssh_kb.experience import Experience
from hssh_kb.narrate import Narrator
from hssh_kb.oracle import Oracle
from hssh_kb.subsets import find_conflicts
from hssh_kb.trace import make_experience


def draw(seed: int, travels: int) -> Experience:
    rng = random.Random(seed)
    return worlds.random_experience(rng, travels, triangular=seed % 4 == 0, stubs=seed % 3 == 0)


def suppose(rng, count, how_many):
    pairs = [(v, w) for v in range(count) for w in range(v)]
    return [(v, w, rng.random() < 0.75) for v, w in rng.sample(pairs, min(how_many, len(pairs)))]


def text(assumption):
    v, w, same = assumption
    return f"v{v}{'=' if same else '!='}v{w}"


def plain(literals):
    return frozenset((x.kind, x.number) for x in literals)


def compare(seed, fewest=1, most=2):
    """Compare all conflicts and repairs of one case with brute force: None if there are none."""
    rng = random.Random(seed)
    experience = draw(seed, rng.randint(2, 3))
    given = suppose(rng, len(experience), rng.randint(fewest, most))
    force = Force(brute_force.plain(experience), given)
    supposed = [parse_assumption(experience, text(a)) for a in given]
    oracle = Oracle(experience, supposed)
    literals = oracle.literals()
    consistent = oracle.consistent(frozenset(literals))
    if consistent != force.consistent(frozenset(force.literals())):
        return False
    if consistent:
        return None
    found = find_conflicts(literals, oracle.consistent)
    conflicts, repairs = force.conflicts_and_repairs()
    narrator = Narrator(experience, supposed, planarity=True)
    reason = narrator.explain(found.conflicts[0])  # raises if the programs disagree
    return (
        found.complete
        and bool(reason.text)
        and {plain(c) for c in found.conflicts} == conflicts
        and {plain(r) for r in found.repairs} == repairs
    )


@pytest.mark.parametrize("chunk", range(3))
def test_conflicts_and_repairs_equal_brute_force(chunk):
    answers = [compare(seed) for seed in range(chunk * 10, chunk * 10 + 10)]
    assert False not in answers
    assert answers.count(True) >= 3


@pytest.mark.parametrize("seed", range(16))
def test_every_no_names_an_axiom_and_the_users_visits(seed):
    rng = random.Random(seed)
    experience = draw(seed + 500, 4 if (seed + 500) % 3 == 0 else 7)
    given = suppose(rng, len(experience), 2)
    answer = check(experience, [text(a) for a in given])
    twin = brute_force.all_maps(brute_force.plain(experience))
    agrees = any(all((m.visits[v] == m.visits[w]) == same for v, w, same in given) for m in twin)
    assert answer.consistent == agrees
    assert answer.text
    if agrees:
        assert answer.status == "consistent"
        example = answer.example
        assert all((example.visits[v] == example.visits[w]) == same for v, w, same in given)
        found = (example.visits, example.offsets)
        assert found in {m[:2] for m in twin}
        return
    assert answer.status == "violated"
    assert answer.violations
    assert answer.repairs
    for violation in answer.violations:
        assert violation.text
        assert all(name in violation.text for name in violation.observations[:1])
        assert len(violation.observations) >= 2


@pytest.mark.parametrize("seed", range(700, 712))
def test_readings_are_chosen_to_agree_with_assumptions(seed):
    rng = random.Random(seed)
    experience = worlds.with_alternatives(rng, draw(seed, 4))
    given = suppose(rng, len(experience), 2)
    answer = check(experience, [text(a) for a in given])
    twin = brute_force.all_maps(brute_force.plain(experience))
    agrees = {m for m in twin if all((m.visits[v] == m.visits[w]) == s for v, w, s in given)}
    assert answer.consistent == bool(agrees)
    if agrees:
        example = answer.example
        readings = example.readings or (0,) * len(experience)
        assert (example.visits, example.offsets, readings) in agrees
    else:
        assert answer.violations
        assert answer.repairs


def test_planarity_alone_can_say_no():
    # Two loops cross at one place; the third visit is lined up by leaving as at the first.
    corner = ["c+1", "d+1", "c-0", "d-0"]
    cross = ["a+1", "b+1", "c-0", "a-1", "b-1", "c+1"]
    turn = (corner, 2, 1)
    walk = [(cross, None, 0), turn, turn, (cross, 0, 1), turn, turn, (cross, 1, None)]
    experience = make_experience(walk)
    given = ["v3=v0", "v6=v0"]
    answer = check(experience, given)
    assert answer.status == "violated"
    assert answer.violations[0].axiom == "planarity"
    assert "axiom 14" in answer.violations[0].text
    assert check(experience, given, planarity=False).consistent


def test_budget_spent_is_said():
    experience = worlds.grid(3, 3, stubs=True).drive(
        worlds.random_walk(random.Random(3), worlds.grid(3, 3), 40)
    )
    answer = check(experience, ["v39!=v1"], budget_s=1e-9)
    assert answer.status == "budget spent"
    assert answer.text
    assert answer.violations
