"""Exploration against brute force, in simulated worlds, and its two old strategies."""

import math
from dataclasses import replace

import numpy as np
import pytest
from exploring import SYMBOLS, BruteForce, know, look, start_robot, with_misreadings
from small_kbs import make_kb
from symbolic_walks import observe

from hssh_kb.errors import NoAnswerError, UsageError
from hssh_kb.experience import Experience, Reading, Visit
from hssh_kb.explore import WORTH_BITS, explore, find_doubt, select_agenda, weigh_rivals
from hssh_kb.explore_document import document_exploration
from hssh_kb.explore_words import word_view, word_way
from hssh_kb.foresight import Foresight, Stand, see_star
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.kb import KnowledgeBase
from hssh_kb.maps import enumerate_maps
from hssh_kb.place_graph import build_place_graph
from hssh_kb.ranking import RankedMaps, rank_maps
from hssh_kb.route_steps import describe_route, follow_steps
from hssh_kb.trace import make_experience
from hssh_kb.walks import list_walks
from perception.star import Star

BEND = ["a+1", "b+1", "a-0", "b-0"]
CORRIDOR = ["a+1", "a-1"]


def compare_with_brute_force(experience, maps, weights, lead=0) -> int:
    """Check the expected entropy of each walk of at most four travels; return how many."""
    graph = build_place_graph(experience, maps[lead])
    foresight = Foresight(experience, maps, weights, lead=lead)
    brute = BruteForce(experience, maps, weights, lead)
    checked = 0
    for walk in list_walks(graph, foresight):
        if len(walk.turns) <= 4:
            expected = brute.expect_entropy(walk.turns)
            assert walk.entropy_bits == pytest.approx(expected, abs=1e-9)
            before = brute.expect_entropy(walk.turns[:-1]) if walk.way else weigh(weights)
            assert walk.last_gain_bits == pytest.approx(before - expected, abs=1e-9)
            checked += 1
    return checked


def weigh(weights) -> float:
    return -sum(w * math.log2(w) for w in weights if w > 0)


@pytest.mark.parametrize("seed", range(12))
def test_expected_entropy_is_that_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    kb = know(start_robot(seed), limit=100)
    if kb is None:
        pytest.skip("more than 100 maps: too slow for brute force")
    weights = rng.dirichlet(np.ones(len(kb.hypotheses)))
    lead = int(rng.integers(len(weights)))
    assert compare_with_brute_force(kb.experience, kb.hypotheses, weights, lead)


@pytest.mark.parametrize("seed", range(6))
def test_expected_entropy_with_doubtful_stars_is_that_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    experience = with_misreadings(start_robot(seed, travels=(3, 5)).experience, rng)
    maps = enumerate_maps(experience, limit=25).maps
    # Where readings of the last visit differ, nothing says how their dlps line up.
    last = {h.reading(experience, len(experience) - 1) for h in maps}
    kept = [h for h in maps if h.reading(experience, len(experience) - 1) == max(last, key=repr)]
    weights = rng.dirichlet(np.ones(len(kept)))
    assert Foresight(experience, kept, weights).misread > 0
    assert compare_with_brute_force(experience, kept, weights)


@pytest.mark.parametrize("seed", range(20))
def test_following_the_first_suggestion_never_removes_the_true_map(seed):
    robot = start_robot(100 + seed)
    kb = know(robot)
    if kb is None:
        pytest.skip("too many maps")
    found = kb.explore(best=1)
    before = {(h.visits, h.offsets) for h in kb.hypotheses}
    count = len(kb.experience)
    robot.follow(found.graph, found.suggestions[0].walk)
    after = know(robot, limit=20_000)
    if after is None:
        pytest.skip("too many maps afterwards")
    assert robot.partition in {h.visits for h in after.hypotheses}
    kept = {(h.visits[:count], h.offsets[:count]) for h in after.hypotheses}
    assert kept <= before
    if found.used == "entropy":
        assert found.suggestions[0].gain_bits > WORTH_BITS


@pytest.mark.parametrize("seed", range(8))
def test_maps_that_predict_what_came_and_only_they_are_kept(seed):
    """The forecast agrees with the axioms: a map lives on if it foretold the view, or nothing."""
    robot = start_robot(300 + seed)
    kb = know(robot, limit=300)
    if kb is None:
        pytest.skip("too many maps")
    foresight = Foresight(kb.experience, kb.hypotheses, weigh_rivals(kb.ranked))
    graph = build_place_graph(kb.experience, kb.hypotheses[0])
    walk = next(w for w in list_walks(graph, foresight) if not w.way and w.edge is not None)
    count = len(kb.experience)
    robot.follow(graph, walk)
    view = robot.view()
    expected = {
        (h.visits, h.offsets)
        for h, walker, stand in zip(
            kb.hypotheses, foresight.walkers, walk.forecast.stands, strict=True
        )
        if stand is None or walker.view(stand) == view
    }
    found = enumerate_maps(robot.experience).maps
    assert {(h.visits[:count], h.offsets[:count]) for h in found} == expected


def test_the_first_suggestion_tells_twins_apart_for_certain():
    """Two maps of a corridor with a dead end: is the second bend the first one again?"""
    kb = make_rivals()
    found = kb.explore()
    assert found.entropy_bits == pytest.approx(1.0)
    top = found.suggestions[0]
    assert found.used == "entropy"
    assert top.kind == "revisit"
    assert top.gain_bits > 0.3
    kinds = {group.kind for group in top.expects}
    assert kinds == {"view", "anything"}
    assert sorted(n for group in top.expects for n in group.maps) == [1, 2]


def make_rivals() -> KnowledgeBase:
    """A ring of four bends, walked five travels: the fifth bend is the first, or a new one."""
    walk = [(BEND, None, 1), *[(BEND, 2, 1)] * 3, (BEND, 2, None)]
    maps = (Hypothesis((0, 1, 2, 3, 0), (0,) * 5), Hypothesis((0, 1, 2, 3, 4), (0,) * 5))
    return KnowledgeBase(make_experience(walk), RankedMaps(maps, "minimal", minimality="subset"))


def test_weights_are_posteriors_or_equal():
    kb = make_kb()
    assert weigh_rivals(kb.ranked) == pytest.approx(
        [1 / (1 + math.exp(-5.75)), 1 / (1 + math.exp(5.75))]
    )
    assert weigh_rivals(make_rivals().ranked) == pytest.approx([0.5, 0.5])
    assert explore(kb).unit == "m"
    assert explore(make_rivals()).unit == "travels"


def test_only_maps_that_tie_for_the_best_are_rivals_unless_all_are_asked_for():
    robot = start_robot(7)
    experience = robot.experience
    ranked = rank_maps(experience, best=1000)
    kb = KnowledgeBase(experience, ranked)
    assert len(explore(kb).weights) == kb.rows[0].tie
    assert len(explore(kb, every=True).weights) == len(enumerate_maps(experience).maps)


def test_all_maps_are_weighed_by_posterior_where_there_are_displacements():
    kb = make_kb(cells=(0, 1, 2, 5, 4, 1))
    found = kb.explore(every=True)
    assert max(found.weights) > 0.9
    assert list(found.weights) == sorted(found.weights, reverse=True)


def test_where_all_maps_agree_the_agenda_answers_and_says_so():
    walk = [(["a+1", "a-1"], None, 0), (["a+1", "b+1", "a-1", "b-1"], 0, None)]
    found = KnowledgeBase.from_experience(make_experience(walk)).explore()
    assert found.used == "agenda"
    assert "no rival" in found.text
    twins = (Hypothesis((0, 1), (0, 0)), Hypothesis((0, 1), (0, 0), terms={"twin": 1.0}))
    kb = KnowledgeBase(make_experience(walk), RankedMaps(twins, "minimal", minimality="subset"))
    found = kb.explore()
    assert (found.strategy, found.used) == ("entropy", "agenda")
    assert "No observation within reach is expected to tell them apart" in found.text
    assert not document_exploration(found)["informative"]


def test_the_agenda_lists_what_was_neither_left_by_nor_come_back_from():
    crossing = ["a+1", "b+1", "a-1", "b-1"]
    walk = [(crossing, None, 0), (crossing, 0, 1), (crossing, 1, None)]
    kb = KnowledgeBase(
        make_experience(walk), RankedMaps((Hypothesis((0, 1, 2), (0, 0, 0)),), "minimal")
    )
    found = kb.explore("agenda", best=None)
    listed = [(one.walk.place, one.walk.dlp) for one in found.suggestions]
    assert set(listed) == {("P0", k) for k in (1, 2, 3)} | {("P1", 0), ("P1", 3)} | {
        ("P2", k) for k in (0, 1, 2)
    }
    # Nearest first; at one place the sharpest turn first, straight ahead last.
    assert [place for place, _ in listed] == ["P2"] * 3 + ["P1"] * 2 + ["P0"] * 3
    assert listed[2] == ("P2", 1)
    assert found.suggestions[0].tie == 3
    assert "The first 3 tie" in found.text


def test_the_agenda_shrinks_by_leaving_and_by_coming_back():
    robot = start_robot(3, width=3, height=3, holes=0.25)
    for _ in range(6):
        kb = KnowledgeBase(robot.experience, RankedMaps((true_map(robot),), "minimal"))
        try:
            found = kb.explore("agenda", best=None)
        except NoAnswerError:
            return
        top = found.suggestions[0].walk
        robot.follow(found.graph, top)
        after = build_place_graph(robot.experience, true_map(robot))
        assert top.dlp not in after.places[top.place].frontiers
    pytest.fail("the agenda of so small a world is worked off in six walks")


def true_map(robot) -> Hypothesis:
    return Hypothesis(robot.partition, (0,) * len(robot.partition))


def test_rehearsal_tries_a_known_way_from_the_doubted_place():
    """The published example: follow E1 from P?, for if P? is P1 it leads to P2."""
    kb = make_rivals()
    assert find_doubt(kb.hypotheses, weigh_rivals(kb.ranked)) == (4, 0)
    found = kb.explore("rehearsal")
    assert (found.used, found.doubted) == ("rehearsal", 4)
    assert [(s.walk.place, s.walk.edge.goal) for s in found.suggestions] == [("P0", "P1")]
    assert "visit v4 was to P0 again, but map 2 says otherwise" in found.text


def test_rehearsal_plans_on_the_map_that_recognises_even_if_it_is_not_the_first():
    kb = make_rivals()
    turned = RankedMaps(kb.hypotheses[::-1], "minimal", minimality="subset")
    found = replace(kb, ranked=turned).explore("rehearsal")
    assert (found.number, found.doubted) == (2, 4)
    assert [(s.walk.place, s.walk.edge.goal) for s in found.suggestions] == [("P0", "P1")]
    assert [group.maps for group in found.suggestions[0].expects] == [(1,), (2,)]


def test_nothing_to_rehearse_falls_back_to_the_agenda():
    walk = [(CORRIDOR, None, 0), (CORRIDOR, 0, None)]
    found = KnowledgeBase.from_experience(make_experience(walk)).explore("rehearsal")
    assert found.used == "agenda"
    assert "nothing to rehearse" in found.text


def test_route_texts_lead_to_the_places():
    for seed in range(6):
        kb = know(start_robot(seed), limit=500)
        if kb is None:
            continue
        for one in kb.explore("agenda", best=None).suggestions if has_open(kb) else ():
            way, graph = one.walk.way, kb.graph(1)
            assert bool(way) == bool(one.route_text)
            if way:
                start, goal = graph.places[way[0].start], graph.places[one.walk.place]
                steps = describe_route(graph, start, goal, way)
                assert follow_steps(graph, start.label, way[0].dlp, steps) == goal.label


def has_open(kb) -> bool:
    return any(place.frontiers for place in kb.graph(1).places.values())


def test_walks_over_doubted_stretches_say_so():
    walk = [(CORRIDOR, None, 0), (CORRIDOR, 0, 0), (CORRIDOR, 0, None)]
    torn = Hypothesis((0, 1, 2), (0, 0, 0), log_posterior=-1.0, doubted=(2,))
    kb = KnowledgeBase(make_experience(walk), RankedMaps((torn,), "posterior"))
    found = kb.explore("agenda", best=None)
    assert {(s.walk.place, s.walk.dlp) for s in found.suggestions} == {("P2", 0), ("P0", 1)}
    far = next(s for s in found.suggestions if s.walk.place == "P0")
    assert "unnoticed" in far.route_text


def test_refusals():
    kb = make_rivals()
    with pytest.raises(UsageError, match="no strategy 'random'"):
        kb.explore("random")
    bad = [(BEND, None, 0), (BEND, 3, 0), (["a+1", "a-0"], 1, None)]
    shut = make_experience([*bad])
    ranked = RankedMaps((Hypothesis((0, 1), (0, 0)),), "minimal", inconsistent_from=2)
    with pytest.raises(NoAnswerError, match="from v2 on"):
        KnowledgeBase(shut, ranked).explore()
    closed = make_experience([(["a+1", "a-0"], None, 0), (["a+0", "a-1"], 0, None)])
    with pytest.raises(NoAnswerError, match="nothing left to explore"):
        KnowledgeBase.from_experience(closed).explore()


def test_views_do_not_depend_on_where_the_list_of_dlps_begins():
    star = Star.parse(["a+1", "b+1", "a-0", "b-1"])
    for shift in range(4):
        turned = Star(star.dlps[shift:] + star.dlps[:shift])
        assert see_star(turned, (1 - shift) % 4) == see_star(star, 1) == look(star, 1)


def test_words_for_many_ways_on_one_side():
    star = Star.parse(["a+1", "c+1", "b+1", "a-1", "c-0", "b-0"])
    assert word_way(star, 0, 2) == "the second way on the right, counted from straight ahead"
    assert word_view(star, 0) == "ways on ahead and to the right (two)"


def test_document_is_plain_and_complete():
    document = document_exploration(make_rivals().explore())
    assert document["schema"] == "hssh.explore/1"
    assert document["maps"] == 2
    top = document["suggestions"][0]
    assert top["entropy_before_bits"] == pytest.approx(1.0)
    assert top["entropy_after_bits"] == pytest.approx(1.0 - top["gain_bits"], abs=2e-6)
    assert top["travels"] == len(top["route"]["turns"]) + 1


def test_the_agenda_is_a_set_of_frontiers():
    kb = know(start_robot(1), limit=500)
    foresight = Foresight(kb.experience, kb.hypotheses, weigh_rivals(kb.ranked))
    graph = kb.graph(1)
    walks = list_walks(graph, foresight)
    listed = {(w.place, w.dlp) for w in select_agenda(graph, walks)}
    assert listed == {(p.label, k) for p in graph.places.values() for k in p.frontiers}


@pytest.mark.parametrize("seed", range(6))
def test_where_the_list_of_dlps_begins_changes_nothing(seed):
    robot = start_robot(seed, travels=(6, 9))
    gains = []
    for turned in (False, True):
        eyes = replace(SYMBOLS, turned=turned)
        truth = observe(robot.world, robot.walk, eyes, np.random.default_rng(seed))
        visits = tuple(Visit(visit.readings) for visit in truth.experience.visits)
        experience = Experience(visits)
        maps = enumerate_maps(experience).maps
        true = truth.hypothesis()
        lead = [(h.visits, h.offsets) for h in maps].index((true.visits, true.offsets))
        weights = np.full(len(maps), 1 / len(maps))
        foresight = Foresight(experience, maps, weights, lead=lead)
        walks = list_walks(build_place_graph(experience, maps[lead]), foresight)
        gains.append({walk.turns[0]: walk.gain_bits for walk in walks if not walk.way})
    assert gains[0] == pytest.approx(gains[1])


@pytest.mark.parametrize("headings", [True, False])
def test_maps_that_read_the_last_star_differently_leave_it_in_one_direction(headings):
    """One reading has an arm more, and its list of dlps begins elsewhere."""
    ways = (0.0, -math.pi / 2, math.pi, math.pi / 2)
    three, four = ["a+1", "b+1", "a-1", "b-0"], ["b+1", "a-1", "b-1", "a+1"]
    turned = ways[1:] + ways[:1]
    last = Visit(
        (
            Reading(Star.parse(three), 0, None, 0.6, ways if headings else ()),
            Reading(Star.parse(four), 3, None, 0.4, turned if headings else ()),
        )
    )
    first = make_experience([(CORRIDOR, None, 0), (CORRIDOR, 0, None)]).visits[0]
    experience = Experience((first, last))
    maps = (Hypothesis((0, 1), (0, 0)), Hypothesis((0, 1), (0, 0), (0, 1)))
    foresight = Foresight(experience, maps, np.array([0.6, 0.4]))
    back = foresight.step(foresight.start(), 2)
    assert back.stands == (Stand(0, 1), Stand(0, 1) if headings else None)
