"""Stars read wrongly without alternatives: where it shows, and which readings to doubt."""

import re
from dataclasses import replace

import numpy as np
import pytest
from symbolic_walks import (
    Eyes,
    blind,
    find_first_clash,
    follow_route,
    make_grid,
    observe,
    walk_randomly,
)

from hssh_kb.experience import Experience
from hssh_kb.kb import KnowledgeBase
from hssh_kb.search import search_maps
from hssh_kb.trace import experience_from_data, experience_to_data


def _walk(seed, travels, eyes, *, size=4, stubs=False):
    rng = np.random.default_rng(seed)
    world = make_grid(size, size, stubs=stubs)
    return observe(world, walk_randomly(world, travels, rng), eyes, rng)


@pytest.mark.parametrize("seed", range(6))
def test_a_misread_star_is_found_where_it_first_clashes(seed):
    truth = _walk(seed, 40, Eyes(wrong=0.15))
    wrong = {v for v, reading in enumerate(truth.readings) if reading}
    found = search_maps(blind(truth.experience))
    first = find_first_clash(truth)
    assert found.inconsistent_from == first
    assert found.maps[0].visits == truth.partition[:first]
    assert found.reason.startswith(f"inconsistent from visit {first}: v{first} lies where v")
    doubts = [
        {int(v) for one in doubt for v in re.findall(r"v(\d+)$", one)}
        for doubt in found.contradiction.doubts
    ]
    assert any(doubt <= wrong for doubt in doubts)
    assert len(set(map(len, doubts))) == 1


@pytest.mark.parametrize(("sigma", "stubs"), [(0.05, False), (0.05, True), (0.15, False)])
def test_true_readings_are_not_doubted(sigma, stubs):
    for seed in range(4):
        truth = _walk(seed, 30, Eyes(sigma=sigma), stubs=stubs)
        assert search_maps(truth.experience).contradiction is None


def test_two_earlier_visits_that_agree_are_not_the_least_to_doubt():
    for seed in range(8):
        truth = _walk(seed, 40, Eyes(wrong=0.1))
        found = search_maps(blind(truth.experience)).contradiction
        if found is None:
            continue
        place = truth.partition[found.visit]
        there = [v for v in range(found.visit) if truth.partition[v] == place]
        stars = {v: truth.readings[v] for v in there}
        if len(there) > 1 and not any(stars.values()):
            assert found.doubts == ((f"doubt the star seen at v{found.visit}",),)
            return
    pytest.fail("no walk of the kind that the test is for")


def test_the_contradiction_is_kept_and_told_in_the_users_names(tmp_path):
    experience = blind(_walk(0, 40, Eyes(wrong=0.15)).experience)
    found = search_maps(experience)
    visits = list(experience.visits)
    visits[found.contradiction.place] = replace(
        visits[found.contradiction.place], name="lift lobby"
    )
    kb = KnowledgeBase.from_experience(Experience(tuple(visits)))
    assert f"lies where v{found.contradiction.place} (lift lobby) is" in kb.ranked.contradiction
    assert len(kb.hypothesis().visits) == found.inconsistent_from
    kb.save(tmp_path / "kb.hssh")
    assert KnowledgeBase.open(tmp_path / "kb.hssh").ranked == kb.ranked


def _spoil(truth, v, dy):
    visits = list(truth.experience.visits)
    told = visits[v].displacement
    visits[v] = replace(visits[v], displacement=replace(told, y=told.y + dy))
    return Experience(tuple(visits))


def test_displacements_that_contradict_each_other_are_told():
    """The same stretch is travelled four times; the second time it is told 12 sigma too far."""
    route = follow_route(make_grid(3, 2), [0, 1, 2, 5, 4, 1, 2, 5, 4, 1, 0])
    truth = observe(make_grid(3, 2), route, Eyes(), np.random.default_rng(0))
    assert search_maps(truth.experience).strains == ""
    found = search_maps(_spoil(truth, 6, 0.6))
    assert found.strains.startswith("v5 lies where v1 is, but what was observed later")
    ends = [0, 1, 0, 1, 0, 1]  # there and back between dead ends: the axioms leave one map only
    world = make_grid(2, 1)
    there = observe(world, follow_route(world, ends), Eyes(), np.random.default_rng(0))
    forced = search_maps(_spoil(there, 3, 0.8))
    assert forced.maps[0].visits == there.partition
    assert (
        "The displacement from v2 to v3 speaks against v3 being the place of v1" in forced.strains
    )


@pytest.mark.parametrize("lost", [1, 5])
def test_a_heading_that_is_not_told_is_taken_for_unknown(lost):
    right = 0
    for seed in range(4):
        truth = _walk(seed, 30, Eyes())
        data = experience_to_data(truth.experience)
        for v in np.random.default_rng(seed).permutation(np.arange(1, 31))[:lost]:
            del data["visits"][v]["displacement"]["theta"]
        experience = experience_from_data(data)
        assert sum("the heading is taken for unknown" in n for n in experience.notices) == lost
        found = search_maps(experience)
        assert found.contradiction is None
        right += found.maps[0].visits == truth.partition
    assert right >= 3
