"""Path types: told or not, they agree where visits are one place; against a brute-force filter."""

import random

import brute_force
import pytest
import worlds

from hssh_kb.check import check
from hssh_kb.errors import InputError
from hssh_kb.experience import forget_types, has_types
from hssh_kb.maps import enumerate_maps, minimal_maps
from hssh_kb.trace import experience_from_data, experience_to_data

OPEN, SHUT = ("MIDLINE", "LEFTWALL", "RIGHTWALL"), ("DEADEND", "NONE")


def typed_experience(seed, *, told):
    """A random walk whose dlps have random types, each told with some probability."""
    rng = random.Random(seed)
    experience = worlds.random_experience(rng, rng.randint(3, 7), stubs=seed % 3 == 0)
    data = experience_to_data(experience)
    for item in data["visits"]:
        item["types"] = [
            rng.choice(OPEN[:2] if text.endswith("1") else SHUT) if rng.random() < told else None
            for text in item["star"]
        ]
    return experience_from_data(data)


def agree(experience, m):
    """Whether all pairs of visits to one place tell the same types where both tell any."""
    for v, p in enumerate(m.visits):
        for w in range(v):
            if m.visits[w] != p:
                continue
            mine, theirs = (experience.visits[u].readings[m.readings[u]] for u in (v, w))
            size = len(mine.star)
            turn = m.offsets[v] - m.offsets[w]
            for k in range(size if mine.types and theirs.types else 0):
                pair = {mine.types[k], theirs.types[(k + turn) % size]} - {""}
                if len(pair) == 2:
                    return False
    return True


@pytest.mark.parametrize("told", [0.15, 0.4, 1.0])
def test_maps_are_those_in_which_types_agree(told):
    spared = 0
    for seed in range(12):
        experience = typed_experience(seed, told=told)
        free = brute_force.all_maps(brute_force.plain(experience))
        expected = {m[:2] for m in free if agree(experience, m)}
        spared += len(free) - len(expected)
        for engine in ("tree", "program"):
            found = enumerate_maps(experience, engine=engine)
            if found.inconsistent_from is None:
                assert {(h.visits, h.offsets) for h in found.maps} == expected, (seed, engine)
            else:
                assert not expected
        if expected:
            best = minimal_maps(experience)
            plain = brute_force.plain(experience)
            costs = {m: brute_force.count(plain, m) for m in free if m[:2] in expected}
            least = {m[:2] for m, cost in costs.items() if cost == min(costs.values())}
            assert {(h.visits, h.offsets) for h in best.maps} == least
    assert spared


def test_types_of_alternative_readings_count_where_these_are_chosen():
    spared = 0
    for seed in range(12):
        rng = random.Random(seed)
        data = experience_to_data(typed_experience(seed, told=0.3))
        for item in data["visits"]:
            if rng.random() < 0.4:
                types = [rng.choice([*OPEN, None]) if t[-1] == "1" else None for t in item["star"]]
                keys = ("star", "arrive", "depart")
                item["alternatives"] = [
                    {**{key: item[key] for key in keys}, "types": types, "weight": 0.3}
                ]
        experience = experience_from_data(data)
        free = brute_force.all_maps(brute_force.plain(experience))
        expected = {tuple(m) for m in free if agree(experience, m)}
        spared += len(free) - len(expected)
        for engine in ("tree", "program"):
            found = enumerate_maps(experience, engine=engine)
            if found.inconsistent_from is None:
                maps = {
                    (h.visits, h.offsets, h.readings or (0,) * len(data["visits"]))
                    for h in found.maps
                }
                assert maps == expected, (seed, engine)
            else:
                assert not expected
    assert spared


def test_types_are_left_aside_where_displacements_were_measured():
    data = experience_to_data(typed_experience(1, told=1.0))
    for item in data["visits"][1:]:
        item["displacement"] = {"x": 3.0, "y": 0.0, "theta": 0.0}
    experience = experience_from_data(data)
    assert has_types(experience)
    for v in range(1, len(experience)):
        for w in range(v):
            asked = [f"v{v}=v{w}"]
            assert check(experience, asked) == check(forget_types(experience), asked)


@pytest.mark.parametrize("told", [0.3, 1.0])
def test_why_not_agrees(told):
    named = 0
    for seed in range(10):
        experience = typed_experience(seed, told=told)
        free = brute_force.all_maps(brute_force.plain(experience))
        kept = [m for m in free if agree(experience, m)]
        last = len(experience) - 1
        answer = check(experience, [f"v{last}=v0"])
        assert answer.consistent == any(m.visits[last] == m.visits[0] for m in kept), seed
        named += any("path_types" in v.axioms for v in answer.violations)
    assert named


def test_forgetting_types_switches_the_axiom_off():
    experience = typed_experience(3, told=1.0)
    assert has_types(experience)
    free = forget_types(experience)
    assert not has_types(free)
    twin = brute_force.all_maps(brute_force.plain(experience))
    assert len(enumerate_maps(free).maps) == len(twin)


def test_types_come_back_from_a_trace_document():
    experience = typed_experience(1, told=0.5)
    assert experience_from_data(experience_to_data(experience), experience.source) == experience


@pytest.mark.parametrize(
    ("types", "fault"),
    [
        (["MIDLINE"], "must be 2 path types"),
        (["MIDLINE", "ROAD"], "'ROAD' of a-0 is none of"),
        (["MIDLINE", "LEFTWALL"], "contradicts its alpha 0"),
        ("MIDLINE", "must be 2 path types"),
    ],
)
def test_faults_of_types_are_told(types, fault):
    data = {
        "schema": "hssh.trace/1",
        "visits": [{"star": ["a+1", "a-0"], "arrive": None, "depart": 0, "types": types}],
    }
    with pytest.raises(InputError) as caught:
        experience_from_data(data)
    assert fault in str(caught.value)
