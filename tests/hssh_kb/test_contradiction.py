"""Stars read wrongly without alternatives: where it shows, and which readings to doubt."""

import re
from dataclasses import replace

import numpy as np
import pytest
from symbolic_walks import Eyes, blind, find_first_clash, make_grid, observe, walk_randomly

from hssh_kb.experience import Experience
from hssh_kb.kb import KnowledgeBase
from hssh_kb.search import search_maps


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
