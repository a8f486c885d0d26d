"""Places, edges and paths of a hypothesis, against the path classes of the solver's side."""

import numpy as np
import pytest
from small_kbs import make_kb, true_map, walk_true
from symbolic_walks import Eyes, make_grid, observe, walk_randomly

from hssh_kb.hypothesis import Hypothesis
from hssh_kb.maps import count_paths, enumerate_maps
from hssh_kb.place_graph import build_place_graph
from hssh_kb.ranking import count_map
from hssh_kb.trace import load_trace, make_experience


@pytest.mark.parametrize("name", ["ring-2x2-l", "figure8-3x2-lt", "grid-3x3-ltplus"])
def test_paths_are_counted_as_the_solver_counts_them(traces, name):
    experience = load_trace(traces / f"{name}.json")
    for hypothesis in enumerate_maps(experience).maps:
        graph = build_place_graph(experience, hypothesis)
        assert len(graph.paths) == count_paths(experience, hypothesis)
        assert count_map(experience, hypothesis) == (len(graph.paths), len(graph.places))
        assert len(graph.places) == len(hypothesis.places)
        assert not any(path.circular for path in graph.paths)


@pytest.mark.parametrize("seed", range(5))
def test_every_travel_is_an_edge_seen_from_both_ends(seed):
    rng = np.random.default_rng(seed)
    world = make_grid(4, 4, holes=0.3, rng=rng)
    truth = observe(world, walk_randomly(world, 40, rng), Eyes(turned=False), rng)
    graph = build_place_graph(truth.experience, true_map(truth))
    sizes = len(graph.paths), len(graph.places)
    assert count_map(truth.experience, true_map(truth)) == sizes
    for v in range(1, len(truth.places)):
        start, goal = (f"P{truth.partition[w]}" for w in (v - 1, v))
        edge = graph.edge_at[start, truth.experience.visits[v - 1].depart]
        assert (edge.goal, edge.arrive) == (goal, truth.experience.visits[v].arrive)
        assert v in edge.travels
    for edge in graph.edges:
        back = graph.edge_at[edge.goal, graph.places[edge.goal].star.opposite(edge.arrive)]
        assert (back.goal, back.path, back.length_m) == (edge.start, edge.path, edge.length_m)
        assert back.forward != edge.forward
        on_path = next(path for path in graph.paths if path.name == edge.path).places
        first, second = (edge.start, edge.goal) if edge.forward else (edge.goal, edge.start)
        assert on_path.index(first) < on_path.index(second)


def test_frontiers_are_the_open_dlps_never_travelled():
    truth = walk_true(3, 3, [0, 1, 2])
    graph = build_place_graph(truth.experience, true_map(truth))
    open_dlps = {
        (label, k)
        for label, place in graph.places.items()
        for k, alpha in enumerate(place.star.alpha)
        if alpha
    }
    told = {(label, k) for label, place in graph.places.items() for k in place.frontiers}
    assert told == open_dlps - set(graph.edge_at)
    assert len(told) == 3


def test_a_doubted_travel_is_no_edge():
    experience = make_experience(
        [(["a+1", "a-1"], None, 0), (["b+1", "b-1"], 0, 0), (["c+1", "c-1"], 0, None)]
    )
    graph = build_place_graph(experience, Hypothesis((0, 1, 2), (0, 0, 0), doubted=(2,)))
    assert {(edge.start, edge.goal) for edge in graph.edges} == {("P0", "P1"), ("P1", "P0")}
    assert graph.places["P2"].frontiers == (0, 1)
    assert [(e.start, e.goal, e.doubted) for e in graph.doubted] == [
        ("P1", "P2", True),
        ("P2", "P1", True),
    ]
    assert {edge.goal for edge in graph.believed_or_not.edges} == {"P0", "P1", "P2"}


def test_names_by_visit_win_over_names_in_the_experience():
    graph = make_kb({0: "lobby", 7: "junction"}).graph()
    assert graph.places["P0"].name == "lobby"
    assert graph.places["P1"].name == "junction"
    assert graph.places["P2"].title == "P2"


def test_lengths_are_those_driven():
    graph = make_kb().graph()
    lengths = [edge.length_m for edge in graph.edges]
    assert lengths == pytest.approx([5.0] * len(lengths), abs=0.02)


def test_circular_paths_are_said_to_be_so():
    corner = ["a+1", "a-1"]
    experience = make_experience([(corner, None, 0), (corner, 0, 0), (corner, 0, None)])
    graph = build_place_graph(experience, Hypothesis((0, 1, 0), (0, 0, 0)))
    assert graph.paths[0].circular
