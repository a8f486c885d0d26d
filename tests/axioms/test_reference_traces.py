"""The reference table: four traces, three columns, the best maps; by the theory and by its twin."""

from pathlib import Path

import brute_force
import pytest
import worlds

from hssh_kb.maps import count_paths, enumerate_maps, minimal_maps
from hssh_kb.trace import load_trace

TRACES = Path(__file__).resolve().parents[1] / "traces"
COLUMNS = ({"order": False, "planarity": False}, {"planarity": False}, {})
NAMES = sorted(worlds.REFERENCES)


def load(name):
    return load_trace(TRACES / f"{name}.json")


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize("name", NAMES)
def test_theory_gives_the_reference_counts(name, column):
    found = enumerate_maps(load(name), **COLUMNS[column])
    assert found.complete
    assert len(found.maps) == worlds.REFERENCES[name][2][column]


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize("name", NAMES)
def test_twin_gives_the_reference_counts(name, column):
    maps = brute_force.all_maps(brute_force.plain(load(name)), **COLUMNS[column])
    assert len(maps) == worlds.REFERENCES[name][2][column]


@pytest.mark.parametrize("name", NAMES)
def test_best_maps_and_their_ties(name):
    experience = load(name)
    best, ties = worlds.REFERENCES[name][3:]
    found = minimal_maps(experience)
    assert found.complete
    assert len(found.maps) == ties
    assert {cost[:2] for cost in found.costs} == {best}
    sizes = {(count_paths(experience, h), len(h.places)) for h in found.maps}
    assert sizes == {best}
    twin = brute_force.best_maps(brute_force.plain(experience))
    assert twin[0] == best
    assert {m[:2] for m in twin[1]} == {(h.visits, h.offsets) for h in found.maps}


@pytest.mark.parametrize("name", NAMES)
def test_trace_file_is_the_drive_it_stands_for(name):
    world, route = worlds.REFERENCES[name][:2]
    driven = world.drive(route)
    for mine, filed in zip(driven.visits, load(name).visits, strict=True):
        assert mine.star.isomorphisms(filed.star)


def test_architecture_example_is_one_map_of_two_places():
    found = enumerate_maps(load("office-section5"))
    assert [h.visits for h in found.maps] == [(0, 1)]
