"""What is learned from refuted maps: each nogood against every consistent map there is."""

import numpy as np
import pytest
from symbolic_walks import Eyes, make_grid, observe, walk_randomly

from hssh_kb.maps import enumerate_maps
from hssh_kb.node import Decision
from hssh_kb.nogoods import Same, learn_nogood
from hssh_kb.trace import make_experience
from hssh_kb.tree_search import TreeOfMaps

BEND = ["a+1", "b+1", "a-0", "b-0"]
CROSS = ["a+1", "b+1", "a-1", "b-1"]


def _decide(hypothesis):
    """The decisions that make up a map."""
    number = {}
    readings = hypothesis.readings or (0,) * len(hypothesis.visits)
    return [
        Decision(number.setdefault(first, len(number)), offset, reading, False)
        for first, offset, reading in zip(
            hypothesis.visits, hypothesis.offsets, readings, strict=True
        )
    ]


def _learn_all(seed, wrong):
    rng = np.random.default_rng(seed)
    world, travels = (make_grid(3, 3), 10) if wrong else (make_grid(4, 4), 18)
    truth = observe(world, walk_randomly(world, travels, rng), Eyes(sigma=0.3, wrong=wrong), rng)
    tree = TreeOfMaps(experience=truth.experience, order=not wrong, planarity=not wrong)
    grown = tree.exhaust()
    return truth.experience, tree, grown


@pytest.mark.parametrize("wrong", [0.0, 0.25])
def test_no_consistent_map_holds_a_nogood_and_none_is_lost(wrong):
    learned = 0
    for seed in (0, 1, 2, 4):
        experience, tree, grown = _learn_all(seed, wrong)
        nogoods = [nogood for known in tree.nogoods.values() for nogood in known]
        every = enumerate_maps(experience, order=not wrong, planarity=not wrong).maps
        assert len(grown) == len(every)
        learned += len(nogoods)
        for hypothesis in every:
            decisions = _decide(hypothesis)
            assert not any(nogood.holds_in(decisions) for nogood in nogoods)
    assert learned > 10


def test_the_closure_far_back_is_blamed_not_the_travels_after_it():
    # If visit 3 is at the place of visit 0, then visit 5 is at that of visit 2: a bend, no cross.
    experience = make_experience(
        [
            (BEND, None, 0),
            (BEND, 3, 0),
            (BEND, 3, 0),
            (BEND, 3, 0),
            (BEND, 3, 0),
            (CROSS, 3, None),
        ]
    )
    decisions = [Decision(place, 0, 0, False) for place in (0, 1, 2, 0, 1)]
    nogood = learn_nogood(experience.visits, decisions)
    assert nogood.closures == (Same(3, 0, 0, 4),)
    assert nogood.readings == ()
    assert nogood.latest == 3
    assert nogood.refuted_at == 5
    assert nogood.holds_in(decisions)
    apart = [Decision(place, 0, 0, False) for place in (0, 1, 2, 3, 4)]
    assert not nogood.holds_in(apart)
    assert learn_nogood(experience.visits, apart) is None


def test_maps_with_the_same_mistake_die_together_and_the_search_goes_on_before_it():
    rng = np.random.default_rng(1)
    world = make_grid(4, 4)
    truth = observe(world, walk_randomly(world, 60, rng), Eyes(sigma=0.2, wrong=0.2), rng)
    tree = TreeOfMaps(experience=truth.experience)
    tree.search()
    nogoods = [nogood for known in tree.nogoods.values() for nogood in known]
    assert any(nogood.refuted_at - nogood.latest > 2 for nogood in nogoods)
    for one in tree.best(20):
        assert not any(nogood.holds_in(_decide(one)) for nogood in nogoods)
