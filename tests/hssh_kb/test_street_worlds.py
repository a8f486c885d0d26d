"""Tests of the readers of street and floor graphs: the worlds are such as the theory allows."""

import math
import os
from pathlib import Path

import networkx as nx
import pytest
from street_worlds import check_world, make_town, make_world, read_floor

DATA = Path(os.environ.get("HSSH_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")


def _graph(spots, edges):
    graph = nx.Graph()
    for name, spot in spots.items():
        graph.add_node(name, spot=spot)
    graph.add_edges_from(edges)
    return graph


def _make(graph, **keywords):
    return make_world(graph, merge_m=0.0, look_m=0.0, **{"corners": False, **keywords})


def test_a_crossing_joins_opposite_arms_and_gives_a_bend_a_wall():
    spots = {"m": (0, 0), "e": (10, 1), "w": (-10, 0), "n": (0, 10), "x": (5, 0.4)}
    world = _make(_graph(spots, [("m", "x"), ("x", "e"), ("m", "w"), ("m", "n")]))
    assert len(world.positions) == 4  # x is passed through
    middle = world.dlps[world.positions.index((0, 0))]
    assert sorted(alpha for *_, alpha in middle) == [0, 1, 1, 1]
    names = {round(bearing, 1): name for bearing, name, _, _ in middle}
    assert names[0.1] == names[-3.1]
    assert names[1.6] == names[-1.6]
    assert check_world(world) == ()


def test_corners_are_places_on_floors_only():
    graph = _graph({"a": (0, 0), "b": (5, 0), "c": (5, 5)}, [("a", "b"), ("b", "c")])
    assert len(_make(graph).positions) == 2
    assert len(_make(graph, corners=True).positions) == 3
    lengths = _make(graph).lengths
    assert set(lengths.values()) == {10.0}


def test_what_passes_over_the_streets_is_left_out():
    spots = {(x, y): (float(x), float(y)) for x in range(4) for y in range(4)}
    streets = [((x, y), (x + 1, y)) for x in range(3) for y in range(4)]
    streets += [((x, y), (x, y + 1)) for x in range(4) for y in range(3)]
    plain = _make(_graph(spots, streets), corners=True)
    bridged = _make(_graph(spots, [*streets, ((0, 1), (3, 2))]), corners=True)
    assert plain.corridors.keys() == bridged.corridors.keys()
    assert check_world(bridged) == ()


def test_towns_are_such_as_the_theory_allows():
    one, same, other = (make_town(120, seed) for seed in (0, 0, 1))
    assert check_world(one) == ()
    assert check_world(other) == ()
    assert one == same
    assert one.positions != other.positions
    assert 90 <= len(one.positions) <= 120
    assert max(one.lengths.values()) > 2 * min(one.lengths.values())


def test_a_street_that_would_meet_itself_is_cut():
    turns = 12
    spots = {
        f"ring{k}": (math.cos(2 * math.pi * k / turns), math.sin(2 * math.pi * k / turns))
        for k in range(turns)
    }
    spots |= {f"out {name}": (2 * x, 2 * y) for name, (x, y) in list(spots.items())}
    edges = [(f"ring{k}", f"ring{(k + 1) % turns}") for k in range(turns)]
    edges += [(f"ring{k}", f"out ring{k}") for k in range(turns)]
    world = _make(_graph(spots, edges))
    assert len(world.positions) == 2 * turns
    assert check_world(world) == ()
    ring = [dlps for dlps in world.dlps if sum(a for *_, a in dlps) == 3]
    # Two paths of it: a single one would begin and end at one place.
    assert [len(dlps) for dlps in ring].count(6) == 2


@pytest.mark.parametrize("name", ["GDC3", "AHG1", "UT_Campus"])
def test_floors_break_no_axiom(name):
    path = DATA / "maps" / "amrl" / f"{name}.navigation.json"
    if not path.exists():
        pytest.skip(f"{path.name} is not in the data folder (set HSSH_DATA)")
    world = read_floor(path)
    assert check_world(world) == ()
    for (p, k), (q, j) in world.corridors.items():
        assert world.corridors[q, j] == (p, k)
        assert world.dlps[p][k][3] == 1
