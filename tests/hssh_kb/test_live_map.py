"""Visits that arrive one by one: the map keeps up, and says when and why it changes its mind."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from symbolic_walks import Eyes, follow_route, make_grid, observe, walk_randomly

from hssh_kb.change_of_mind import explain_change
from hssh_kb.errors import InputError
from hssh_kb.experience import Displacement, Experience, Visit
from hssh_kb.kb import KnowledgeBase
from hssh_kb.live_map import LiveMap, list_changes_of_mind
from hssh_kb.score import estimate_score
from hssh_kb.trace import load_trace, make_experience

TRACES = Path(__file__).resolve().parents[1] / "traces"


def _walk(seed, travels, eyes=Eyes()):  # noqa: B008
    rng = np.random.default_rng(seed)
    world = make_grid(4, 4)
    return observe(world, walk_randomly(world, travels, rng), eyes, rng)


def _plant_closure(name=None):
    """A walk around a ring; a slipped displacement puts the sixth visit where the first was."""
    world = make_grid(3, 2)
    route = follow_route(world, [0, 1, 2, 5, 4, 3, 0, 1, 4, 5])
    truth = observe(world, route, Eyes(headings=False), np.random.default_rng(0))
    visits = list(truth.experience.visits)
    told = visits[5].displacement
    cov = ((0.09, 0.0, 0.0), (0.0, 0.09, 0.0), (0.0, 0.0, 1e-4))
    visits[5] = Visit(visits[5].readings, Displacement(told.x, told.y - 1.0, told.theta, cov))
    visits[0] = replace(visits[0], name=name)
    return truth, Experience(tuple(visits)), estimate_score(truth.experience)


def test_a_planted_closure_is_believed_until_an_axiom_refutes_it():
    truth, experience, score = _plant_closure(name="lift lobby")
    live = LiveMap(score=score)
    changes, leads = {}, []
    for v, visit in enumerate(experience.visits):
        change = live.arrive(visit)
        leads.append(live.best()[0].visits)
        if change is not None:
            changes[v] = change
    assert leads[5] == (0, 1, 2, 3, 4, 0)
    assert leads[-1] == truth.partition
    first = changes[6]
    assert [(b.visit, b.before, b.after) for b in first.beliefs] == [(5, 0, 5)]
    assert first.refusal == ("travel_function", (1,))
    assert "v5 was held to be the place of v0 (lift lobby)" in first.text
    assert "axiom 12 (one travel, one outcome)" in first.text
    assert "from v0 (lift lobby) to v1" in first.text
    assert changes[7].refusal is None
    assert "less probable by" in changes[7].text


def test_the_refused_axiom_is_the_one_that_refuses():
    """What the change names is what breaks when the former favourite takes the closure."""
    _, experience, score = _plant_closure()
    change = list_changes_of_mind(experience, score=score)[0]
    begun = replace(experience, visits=experience.visits[:7])
    kept = KnowledgeBase.from_experience(begun).check(["v5=v0"])
    assert kept.consistent is False
    assert {"star_isomorphism", "travel_function"} & set(kept.violations[0].axioms)
    assert change.visit == 6


@pytest.mark.parametrize("seed", range(3))
def test_arrivals_end_where_the_whole_search_does(seed):
    truth = _walk(seed, 40)
    kb = KnowledgeBase.from_experience(
        replace(truth.experience, visits=truth.experience.visits[:9])
    )
    for visit in truth.experience.visits[9:]:
        kb, _ = kb.extend(visit)
    assert kb.hypothesis().visits == truth.partition
    assert kb.layout().poses.shape == (len(kb.hypothesis().places), 3)
    assert kb.ranked_by == "posterior"


@pytest.mark.parametrize("work", [20, 200])
def test_arrivals_that_may_cost_little_come_to_the_same_map(work):
    """What an arrival leaves undone is done later; there is a map of all visits at any time."""
    truth = _walk(1, 40)
    live = LiveMap(score=estimate_score(truth.experience), work_per_arrival=work)
    for v, visit in enumerate(truth.experience.visits):
        live.arrive(visit)
        assert len(live.best()[0].visits) == v + 1
    assert live.best()[0].visits == truth.partition


def test_an_extended_knowledge_base_leaves_the_old_one_alone():
    truth = _walk(3, 20)
    visits = truth.experience.visits
    old = KnowledgeBase.from_experience(replace(truth.experience, visits=visits[:-1]))
    known = old.hypothesis()
    for _ in range(2):  # the second time the tree has to be grown anew
        new, _ = old.extend(visits[-1])
        assert new.hypothesis().visits == truth.partition
    assert old.hypothesis() == known
    assert len(old.experience) == len(visits) - 1


def test_symbols_alone_are_extended_too():
    experience = load_trace(TRACES / "figure8-3x2-lt.json")
    kb = KnowledgeBase.from_experience(replace(experience, visits=experience.visits[:1]))
    told = []
    for visit in experience.visits[1:]:
        kb, change = kb.extend(visit)
        told += [change] if change else []
    assert kb.hypotheses == KnowledgeBase.from_experience(experience).hypotheses
    assert told
    assert all("another map took the lead" in change.text for change in told)
    assert any("cannot be" in change.text or "possible" in change.text for change in told)


def test_the_way_out_may_become_known_on_the_next_arrival():
    two = make_experience(
        [
            (["a+1", "a-0"], None, None),
        ],
        source="x",
    ).visits
    end = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)]).visits[1]
    kb = KnowledgeBase.from_experience(Experience(two))
    grown, _ = kb.extend(end, depart=0)
    assert len(grown.hypothesis().visits) == 2
    with pytest.raises(InputError, match="lacks 'depart'"):
        kb.extend(end)
    with pytest.raises(InputError, match="depart is 1, expected a dlp with a gateway"):
        kb.extend(end, depart=1)


def test_what_no_map_explains_keeps_the_maps_before_it():
    there, bend = ["a+1", "a-0"], ["a+1", "b+1", "a-0", "b-0"]
    walk = make_experience([(there, None, 0), (there, 1, 0), (there, 1, 0), (bend, 2, None)])
    kb = KnowledgeBase.from_experience(replace(walk, visits=walk.visits[:3]))
    grown, change = kb.extend(walk.visits[3])
    assert grown.ranked.inconsistent_from == 3
    assert grown.hypothesis().visits == (0, 1, 0)
    assert change is None


def test_maps_of_other_visits_are_not_compared():
    truth = _walk(0, 4)
    best = KnowledgeBase.from_experience(truth.experience).hypothesis()
    with pytest.raises(InputError, match="expected 4 and 5"):
        explain_change(truth.experience, best, best, estimate_score(truth.experience))
