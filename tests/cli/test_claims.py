"""Whole maps claimed of an experience, and the sides of paths, through ``main(argv)``."""

import json
from itertools import product

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hssh_kb.boundary import find_boundaries
from hssh_kb.claims import Claim, check_claim, find_clash, read_claim
from hssh_kb.errors import InputError
from hssh_kb.kb import KnowledgeBase
from hssh_kb.maps import enumerate_maps
from hssh_kb.trace import load_trace


@pytest.fixture
def figure8(traces):
    return traces / "figure8-3x2-lt.json"


@pytest.fixture
def claimed(hssh, figure8, tmp_path):
    """The document of all maps, in a file, and a way to write it anew with other visits."""
    document = hssh("maps", figure8, "--all", "--json").document

    def write(**changes):
        document["maps"][0] |= changes
        path = tmp_path / "claim.json"
        path.write_text(json.dumps(document))
        return path

    return write, document


def test_each_map_printed_is_a_map_when_claimed(hssh, figure8, claimed):
    write, document = claimed
    for number in range(1, len(document["maps"]) + 1):
        answer = hssh("check", figure8, "--claim", write(), "--map", number)
        assert answer.code == 0, answer.out
        assert "violates no axiom" in answer.out


def test_a_wrong_map_has_a_minimal_reason_and_a_mend(hssh, figure8, claimed):
    write, document = claimed
    visits = ["P0" if p == "P10" else p for p in document["maps"][0]["visits"]]
    answer = hssh("check", figure8, "--claim", write(visits=visits), "--json")
    assert answer.code == 1
    assert answer.document["consistent"] is False
    assert ["drop the assumption v10 = v0"] in answer.document["repairs"]
    known = set(answer.document["violations"][0]["observations"])
    assert {"v0", "v10"} <= known
    text = hssh("check", figure8, "--claim", write(visits=visits)).out
    assert "axiom 11" in text


def test_claims_of_small_walks_hold_just_when_the_map_is_enumerated(traces):
    walk = load_trace(traces / "ring-2x2-l.json")
    maps = {one.visits for one in enumerate_maps(walk).maps}
    assert maps
    seen = dict.fromkeys((True, False), 0)
    for places in product(*(range(v + 1) for v in range(min(len(walk), 6)))):
        if any(places[p] != p for p in places):
            continue
        begun = {one[: len(places)] for one in maps}
        holds = find_clash(walk, Claim(places)) == (len(places), True)
        seen[holds] += 1
        if len(places) == len(walk):
            assert holds == (places in maps)
            assert check_claim(walk, Claim(places)).consistent == holds
        else:
            assert holds or places not in begun
    assert min(seen.values()) > 0


def test_a_claim_may_doubt_travels_and_is_told_so(hssh, figure8, claimed):
    write, document = claimed
    visits = ["P0" if p == "P10" else p for p in document["maps"][0]["visits"]]
    doubted = write(visits=visits, offsets=[], doubted=["v10", "v11"])
    answer = hssh("check", figure8, "--claim", doubted)
    assert answer.code == 0
    assert "if the travels to v10, v11 are doubted" in " ".join(answer.out.split())


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"visits": ["P0", "P2"]}, "at most P1"),
        ({"visits": ["P0", "P0", "P1"]}, "not the first"),
        ({"visits": ["P0", 1]}, "expected P and the number"),
        ({"visits": []}, '"visits"'),
        ({"visits": ["P0", "P1"], "offsets": []}, "of 2 visits"),
        ({"doubted": ["v99"]}, '"doubted"'),
        ({"doubted": "v1"}, '"doubted"'),
        ({"offsets": [0.5]}, '"offsets"'),
        ({"readings": [True]}, '"readings"'),
    ],
)
def test_misformed_claims_are_refused_in_one_line(hssh, figure8, claimed, changes, told):
    write, _ = claimed
    base = {"readings": [], "offsets": []}
    answer = hssh("check", figure8, "--claim", write(**(base | changes)))
    assert answer.code == 3
    assert told in answer.err
    assert answer.err.count("\n") == 1


def test_usage_of_claims_and_sides(hssh, figure8, claimed, tmp_path):
    path = claimed[0]()
    both = hssh("check", figure8, "--claim", path, "--assume", "v7=v2")
    assert (both.code, "only one of" in both.err) == (2, True)
    assert hssh("check", figure8, "--sides", "--why-new", "v1").code == 2
    none = hssh("check", figure8, "--claim", path, "--map", 99)
    assert (none.code, "there is no map 99" in none.err) == (3, True)
    assert hssh("check", figure8, "--claim", tmp_path / "no.json").code == 3
    drawn = tmp_path / "drawn.json"
    drawn.write_text('{"schema": "hssh.map/1", "paths": {"A": ["x", "y"]}}')
    assert hssh("check", drawn, "--claim", path).code == 2


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_damaged_claims_are_read_or_refused(claimed, tmp_path, data):
    whole = claimed[0]().read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    junk = data.draw(st.binary(max_size=6))
    path = tmp_path / "damaged.json"
    path.write_bytes(whole[:at] + junk + whole[at + data.draw(st.integers(0, 6)) :])
    try:
        claim, told = read_claim(path), str(path)
    except InputError as error:
        claim, told = Claim(()), str(error)
    assert told.startswith(str(path))
    assert "\n" not in told
    assert all(claim.places[first] == first <= v for v, first in enumerate(claim.places))


def test_sides_are_those_of_the_boundary_regions(hssh, figure8):
    kb = KnowledgeBase.from_experience(load_trace(figure8))
    document = hssh("check", figure8, "--sides", "--json").document
    assert document["schema"] == "hssh.sides/1"
    expected = find_boundaries(kb.experience, kb.hypothesis(1))
    assert [row["path"] for row in document["paths"]] == [
        f"path({one.path[0]},{one.path[1]})" for one in expected
    ]
    assert [row["left"] for row in document["paths"]] == [
        [f"P{p}" for p in one.left] for one in expected
    ]
    assert any(row["left"] or row["right"] for row in document["paths"])
    text = hssh("check", figure8, "--sides").out
    assert "path(0,0) through P0, P1, P2: left of it P8, P9, P10, right of it nothing." in text
