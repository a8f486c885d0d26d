"""Routes: shortest, worded by the rules, and every text leads home."""

import dataclasses
import itertools
import json
import re
from importlib import resources

import networkx as nx
import numpy as np
import pytest
from small_kbs import make_kb, true_map, walk_true
from symbolic_walks import Eyes, make_grid, observe, walk_randomly

from hssh_kb.errors import InputError, NoAnswerError
from hssh_kb.experience import Experience, Reading, Visit
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.kb import KnowledgeBase
from hssh_kb.place_graph import build_place_graph
from hssh_kb.ranking import RankedMaps
from hssh_kb.route import plan_route
from hssh_kb.route_steps import describe_route, follow_steps
from hssh_kb.trace import load_trace, make_experience
from perception.star import Dlp, Star


def explored(seed, size=4, travels=60):
    rng = np.random.default_rng(seed)
    world = make_grid(size, size, holes=0.35, rng=rng)
    return observe(world, walk_randomly(world, travels, rng), Eyes(turned=False), rng)


def single_kb(experience, hypothesis, names=None):
    return KnowledgeBase(experience, RankedMaps((hypothesis,), "posterior"), names=names or {})


@pytest.mark.parametrize("seed", range(6))
def test_every_route_is_shortest_and_its_words_lead_to_the_goal(seed):
    truth = explored(seed)
    names = {} if seed % 2 else {v: f"room {truth.partition[v]}" for v in (0, 5, 9)}
    graph = build_place_graph(truth.experience, true_map(truth), names=names)
    lengths = nx.MultiDiGraph(graph.graph)
    shortest = dict(nx.all_pairs_dijkstra_path_length(lengths, weight="length_m"))
    for start, goal in itertools.permutations(graph.places, 2):
        edges = plan_route(graph, start, goal)
        assert sum(edge.length_m for edge in edges) == pytest.approx(shortest[start][goal])
        assert [edge.goal for edge in edges[:-1]] == [edge.start for edge in edges[1:]]
        steps = describe_route(graph, graph.places[start], graph.places[goal], edges)
        assert follow_steps(graph, start, edges[0].dlp, steps) == goal


@pytest.mark.parametrize("seed", range(3))
def test_turning_stars_and_renaming_local_paths_changes_no_text(seed):
    truth = explored(seed, size=3, travels=30)
    hypothesis = true_map(truth)
    turn = np.random.default_rng(seed + 100).integers(0, 4, len(truth.partition))

    def alter(v, visit):
        r = int(turn[truth.partition[v]])
        dlps = [
            Dlp(f"way {d.path} {v}", "+-"[d.direction == "+"], d.alpha) for d in visit.star.dlps
        ]
        star = Star(tuple(dlps[(k - r) % 4] for k in range(4)))
        at = [None if k is None else (k + r) % 4 for k in (visit.arrive, visit.depart)]
        headings = tuple(visit.readings[0].headings[(k - r) % 4] for k in range(4))
        return Visit((Reading(star, *at, headings=headings),), visit.displacement)

    altered = Experience(tuple(alter(v, x) for v, x in enumerate(truth.experience.visits)))
    one, other = single_kb(truth.experience, hypothesis), single_kb(altered, hypothesis)
    for start, goal in itertools.permutations(one.graph().places, 2):
        assert one.route(start, goal).text == other.route(start, goal).text


def test_golden_texts(golden, traces):
    """Every route on the reference maps and on a named grid, read and found good."""
    texts = {}
    for name in ("figure8-3x2-lt", "grid-3x3-ltplus"):
        kb = KnowledgeBase.open(traces / f"{name}.json")
        number = len(kb.hypotheses)
        for start, goal in itertools.permutations(kb.graph(number).places, 2):
            texts[f"{name} {start} {goal}"] = kb.route(start, goal, number=number).text
    rows = [0, 1, 2, 3, 4, 9, 8, 7, 6, 5, 10, 11, 12, 13, 14, 9, 8, 13, 12, 7, 2, 1, 6, 11]
    truth = walk_true(5, 3, rows)
    kb = single_kb(truth.experience, true_map(truth), {4: "kitchen", 7: "lift lobby", 10: "lab"})
    for start, goal in itertools.permutations(kb.graph().places, 2):
        texts[f"grid-5x3 {start} {goal}"] = kb.route(start, goal).text
    golden("routes.json", texts)


def corridor(*stars, turns=()):
    """A KB of one drive straight through places given as (left open, right open, ahead open)."""
    visits = []
    for v, (left, right, ahead) in enumerate(stars):
        star = [f"a+{ahead:d}", f"b+{right:d}", f"a-{int(v > 0)}", f"b-{left:d}"]
        depart = dict(turns).get(v, 0)
        visits.append((star, None if v == 0 else 0, depart if v < len(stars) - 1 else None))
    count = len(stars)
    experience = make_experience(visits)
    return single_kb(experience, Hypothesis(tuple(range(count)), (0,) * count))


LEFT, RIGHT = 3, 1


@pytest.mark.parametrize(
    ("stars", "turn", "words"),
    [
        # count openings on the side one turns to
        ([(0, 0, 1), (1, 0, 1), (1, 0, 1)], LEFT, "Take the second left"),
        ([(0, 0, 1), (0, 1, 1), (1, 0, 1)], LEFT, "Take the first left"),
        ([(0, 0, 1), (1, 1, 1), (1, 0, 1), (1, 0, 1)], LEFT, "Take the third left"),
        # more than three: count junctions
        ([(0, 0, 1), *[(1, 0, 1)] * 4], LEFT, "At the fourth junction, turn left"),
        ([(0, 0, 1), (1, 1, 1)], RIGHT, "At the next junction, turn right"),
        # nothing ahead
        ([(0, 0, 1), (1, 1, 0)], RIGHT, "At the T junction, turn right"),
        ([(0, 0, 1), (1, 0, 1), (1, 1, 0)], LEFT, "Go to the end of the corridor and turn left"),
        ([(0, 0, 1), (0, 1, 0)], RIGHT, "Follow the corridor round to the right"),
        # a place without a choice is passed in silence
        ([(0, 0, 1), (0, 0, 1), (1, 1, 0)], LEFT, "At the T junction, turn left"),
    ],
)
def test_wording_of_a_turn(stars, turn, words):
    at = len(stars) - 1
    kb = corridor(*stars, (0, 0, 0), turns=[(at, turn)])
    text = kb.route("P0", f"P{at + 1}").text
    assert words in text
    assert not re.search(r"north|south|east|west|metre|degree|\d m\b", text)


def test_corners_in_a_row_are_told_in_one_breath():
    visits = [(["a+1", "a-0"], None, 0)]
    for opening in (LEFT, RIGHT, LEFT):
        star = ["a+0", f"b+{int(opening == RIGHT)}", "a-1", f"b-{int(opening == LEFT)}"]
        visits.append((star, 0, opening))
    visits.append((["a+0", "a-1"], 0, None))
    kb = single_kb(make_experience(visits), Hypothesis(tuple(range(5)), (0,) * 5))
    assert kb.route("P0", "P4").text == (
        "Leave P0 by the only way out. Follow the corridor round to the left, then to the right, "
        "then to the left; then go on to the end of the corridor: that is P4."
    )


@pytest.mark.parametrize(
    ("stars", "words"),
    [
        ([(0, 0, 1), (0, 0, 0)], "Go on to the end of the corridor: that is P1."),
        ([(0, 0, 1), (1, 1, 0)], "Go on to the T junction: that is P1."),
        ([(0, 0, 1), (1, 0, 1), (1, 0, 1)], "Go on to the second junction: that is P2."),
        ([(0, 0, 1), (0, 0, 1)], "Go straight on until you reach P1."),
        ([(0, 0, 1), (1, 0, 0)], "Go on to the corner: that is P1."),
    ],
)
def test_wording_of_the_goal(stars, words):
    kb = corridor(*stars)
    assert kb.route("P0", f"P{len(stars) - 1}").text == f"Leave P0 by the only way out. {words}"


def test_a_place_with_two_ways_on_one_side_is_worded_apart():
    star = ["a+1", "b+1", "c+1", "a-1", "b-0", "c-0"]
    leave = ["x+1", "x-0"]
    visits = [
        (leave, None, 0),
        (star, 0, 1),
        (["y+0", "y-1"], 0, 1),
        (star, 4, 2),
        (leave, 1, None),
    ]
    experience = make_experience(visits)
    kb = single_kb(experience, Hypothesis((0, 1, 2, 1, 4), (0,) * 5))
    assert "bear right" in kb.route("P0", "P2").text
    assert "turn sharp right" in kb.route("P0", "P4").text


def test_first_orientation():
    kb = corridor((1, 1, 1), (0, 0, 0))
    assert kb.route("P0", "P1").text.startswith("At P0, stand with your back to the wall and walk")
    kb = corridor((1, 1, 1), (0, 0, 0), turns=[(0, RIGHT)])
    assert kb.route("P0", "P1").text.startswith(
        "At P0, stand with your back to the wall and turn r"
    )
    named = dataclasses.replace(kb, names={1: "lab"})
    assert named.route("P0", "lab").text.startswith("Leave P0 towards lab.")


def test_named_places_are_anchors():
    kb = corridor((0, 0, 1), (1, 0, 1), (1, 0, 1), (0, 0, 0), turns=[(2, LEFT)])
    named = dataclasses.replace(kb, names={1: "copier", 2: "lift lobby"})
    text = named.route("P0", "P3").text
    assert "go past copier, then at lift lobby, turn left" in text.lower()


def test_holds_in_counts_the_maps_in_which_the_same_words_lead_there(traces):
    kb = KnowledgeBase.open(traces / "figure8-3x2-lt.json")
    held = {
        (s, g): kb.route(s, g, number=2).holds_in
        for s, g in itertools.permutations(kb.graph(2).places, 2)
    }
    assert set(held.values()) == {1, 2}
    assert held["P0", "P1"] == 2  # one travel, the same in both
    assert kb.route("P0", "P1", number=2).maps == 2


def test_start_and_goal_the_same():
    route = make_kb().route("P1", "v1")
    assert (route.text, route.length_m, route.edges) == ("You are already at P1.", 0, ())
    assert route.holds_in == 2


def tear(kb):
    """Take away all that leads to P2."""
    graph = kb.graph()
    kept = tuple(e for e in graph.edges if "P2" not in (e.start, e.goal))
    torn = dataclasses.replace(kb)
    torn.__dict__["graph"] = lambda number=1: dataclasses.replace(graph, edges=kept)
    return torn


def test_a_doubted_stretch_is_used_where_there_is_no_other_way_and_told():
    kb = make_kb()
    doubting = dataclasses.replace(kb.hypothesis(), doubted=(2, 3))
    ranked = RankedMaps((doubting,), "posterior")
    kb = dataclasses.replace(kb, ranked=ranked, layouts=kb.layouts[:1])
    route = kb.route("P0", "P2")
    assert route.doubted == (("P1", "P2"),)
    assert "Beware: between P1 and P2 a place may have gone unnoticed." in route.text
    assert route.holds_in == 1
    assert kb.route("P0", "P3").doubted == ()  # round the other way, all of it believed


def test_no_route_names_the_nearest_place_reached():
    kb = make_kb()
    kb = tear(kb)
    with pytest.raises(NoAnswerError, match=r"from P0 to P2; the nearest place .* P1, 5.0 m"):
        kb.route("P0", "P2")
    assert NoAnswerError.exit_code == 1


def test_an_unknown_place_is_told_with_what_is_near():
    kb = make_kb({2: "lift lobby"})
    with pytest.raises(InputError, match="did you mean 'lift lobby'"):
        kb.route("P0", "lift loby")
    assert kb.route("P0", "LIFT LOBBY").goal.label == "P2"


def test_same_name_twice_is_told():
    with pytest.raises(InputError, match="several places"):
        make_kb({2: "door", 3: "door"}).place("door")


def test_phrases_give_what_their_examples_say():
    table = json.loads(resources.files("hssh_kb").joinpath("phrases/en.json").read_text("utf-8"))
    count = 0
    for group in ("verbs", "orient", "travel", "turn", "arrive"):
        for phrase in table[group].values():
            for example in phrase["examples"]:
                assert phrase["text"].format(**example["with"]) == example["gives"]
                count += 1
    assert count > 25


def test_slight_bends_by_the_measured_angle():
    star, wall = ["a+0", "b+1", "a-1", "b-0"], ["x+1", "x-0"]
    experience = make_experience([(wall, None, 0), (star, 0, 1), (["y+0", "y-1"], 0, None)])
    bent = experience.visits[1].readings[0]
    for degrees, words in ((-30, "slight"), (-90, "right"), (-150, "sharp")):
        angles = tuple(np.deg2rad([0, degrees, 180, degrees + 180]))
        visit = Visit((dataclasses.replace(bent, headings=angles),))
        lived = Experience((experience.visits[0], visit, experience.visits[2]))
        kb = single_kb(lived, Hypothesis((0, 1, 2), (0, 0, 0)))
        turn = next(s for s in kb.route("P0", "P2").steps if s.action == "turn")
        assert words in turn.direction


def test_load_trace_is_what_open_uses(traces):
    path = traces / "ring-2x2-l.json"
    assert KnowledgeBase.open(path).experience == load_trace(path)
