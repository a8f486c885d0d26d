"""``hssh maps --changes``: how the favourite changed as the visits arrived."""

import json

import pytest

EAST, SOUTH, WEST, NORTH = range(4)  # the order of the dlps of every star, clockwise
STEPS = {EAST: (1, 0), SOUTH: (0, -1), WEST: (-1, 0), NORTH: (0, 1)}
ROUTE = (EAST, EAST, NORTH, WEST, WEST, SOUTH, EAST, NORTH, EAST)  # a 3 x 2 block, from the corner


def tell_walk(slip_y):
    """Return the trace of the route; the fifth displacement is told too low by ``slip_y``."""
    x, y, visits = 0, 0, []
    for v, way in enumerate((*ROUTE, None)):
        open_ways = {k for k, (dx, dy) in STEPS.items() if 0 <= x + dx <= 2 and 0 <= y + dy <= 1}
        star = [f"{name}{int(k in open_ways)}" for k, name in enumerate(("a+", "b-", "a-", "b+"))]
        visit = {"star": star, "arrive": ROUTE[v - 1] if v else None, "depart": way}
        if v:
            dx, dy = STEPS[ROUTE[v - 1]]
            sigma = 0.3 if v == 5 else 0.05
            dy -= slip_y if v == 5 else 0
            cov = [[sigma**2, 0, 0], [0, sigma**2, 0], [0, 0, 1e-4]]
            visit["displacement"] = {"x": dx, "y": dy, "theta": 0.0, "cov": cov}
        visits.append(visit)
        if way is not None:
            x, y = x + STEPS[way][0], y + STEPS[way][1]
    visits[0]["name"] = "lift lobby"
    return {"schema": "hssh.trace/1", "visits": visits}


@pytest.fixture
def misled(tmp_path):
    path = tmp_path / "misled.json"
    path.write_text(json.dumps(tell_walk(1.0)))
    return path


def test_a_refuted_favourite_is_told_with_its_axiom(hssh, misled):
    answer = hssh("maps", misled, "--best", "2", "--changes")
    assert answer.code == 0
    told = " ".join(answer.out.split())
    assert "- When v6 arrived, another map took the lead: v5 was held to be the place of v0" in told
    assert "axiom 12 (one travel, one outcome) forbids it." in told
    document = hssh("maps", misled, "--best", "2", "--changes", "--json").document
    first = document["changes"][0]
    assert (first["visit"], first["axiom"], first["travels"]) == ("v6", "travel_function", ["v1"])
    assert first["beliefs"] == [{"visit": "v5", "before": "P0", "after": "P5"}]
    assert "changes" not in hssh("maps", misled, "--json").document


def test_a_favourite_that_never_gave_way_is_told(hssh, tmp_path):
    path = tmp_path / "true.json"
    path.write_text(json.dumps(tell_walk(0.0)))
    answer = hssh("maps", path, "--changes")
    assert "The favourite never changed" in answer.out


def test_without_displacements_there_is_no_story(hssh, traces):
    answer = hssh("maps", traces / "figure8-3x2-lt.json", "--changes")
    assert (answer.code, answer.out) == (2, "")
    assert "--changes needs displacements" in answer.err
