"""Queries, policies, basic traces, maps drawn by hand, and reasons, through ``main(argv)``."""

import json

import pytest

BASIC = {
    "schema": "hssh.trace/1",
    "kind": "basic",
    "views": ["T", "L", "L2", "T2", "T"],
    "actions": ["travel", "turn around", "travel", "turn around"],
}
DRAWN = {
    "schema": "hssh.map/1",
    "paths": {"Main Street": ["hall", "lobby", "yard"], "Back Lane": ["lobby", "shed"]},
    "stars": {
        "lobby": ["Main Street+1", "Back Lane+1", "Main Street-1", "Back Lane-0"],
    },
}


def write(path, data):
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


@pytest.fixture
def figure8(traces):
    return traces / "figure8-3x2-lt.json"


def test_query_of_all_maps_says_what_is_certain_and_what_is_possible(hssh, figure8):
    answer = hssh("maps", figure8, "--query", "at(V,P), V < P + 1, new(V)", "--json")
    assert answer.code == 0
    document = answer.document
    assert document["schema"] == "hssh.query/1"
    assert (document["maps"], document["complete"]) == (11, True)
    assert document["variables"] == ["V", "P"]
    every = hssh("maps", figure8, "--all", "--json").document["maps"]
    for row in document["some"]:
        v, p = row["instance"]
        assert row["maps"] == sum(m["visits"][int(v)] == f"P{p}" == f"P{v}" for m in every)
    certain = [row["instance"] for row in document["some"] if row["maps"] == 11]
    assert document["every"] == certain
    assert ["0", "0"] in certain
    text = hssh("maps", figure8, "--query", "at(V,P), new(V)").out
    assert "Asked of all consistent maps: 11 maps." in text
    assert "every" in text


def test_query_of_the_best_maps_of_a_trace_and_of_a_kb(hssh, figure8, drive_kb):
    best = hssh("maps", figure8, "--best", 2, "--query", "paths(N), places(M)", "--json").document
    assert (best["maps"], best["asked_of"]) == (2, "the 2 best maps")
    assert best["every"] == [["5", "6"]]
    stored = hssh("maps", drive_kb, "--query", "at(V,P)", "--json").document
    assert "stored" in stored["asked_of"]
    one = hssh("maps", drive_kb, "--best", 1, "--query", "at(V,P)", "--json").document
    assert one["maps"] == 1


def test_a_query_with_no_answer_is_code_1(hssh, figure8):
    answer = hssh("maps", figure8, "--query", "order(H,D,P,P)")
    assert answer.code == 1
    assert "No answer holds" in answer.out
    assert hssh("maps", figure8, "--query", "at(3,0)").code == 0


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("att(V,P)", "did you mean at?"),
        ("at(V,P), X > 3", "which values X may take"),
        ("not at(V,P)", "not negated"),
        ("at(V)", "at takes 2 arguments, not 1"),
        ("at(V,P), X = 1..100000000", "intervals are not understood"),
        ("at(V,P), P = 9**9**9**9", "powers are not understood"),
        ("at(V,P), V = @tick(P)", "functions are not called"),
        ("at(V,P), #count { X : at(X,P) } > 2", "neither an atom nor a comparison"),
        ("at(V,P). at(V,P)", "one conjunction"),
        ("at(V", "cannot be read"),
        ("", "is empty"),
    ],
)
def test_a_query_that_cannot_be_asked_is_code_3_and_lists_the_predicates(
    hssh, figure8, query, told
):
    answer = hssh("maps", figure8, "--query", query)
    assert answer.code == 3
    assert answer.out == ""
    assert told in answer.err
    assert "at/2" in answer.err or "at(V,P)" in answer.err


def test_a_query_that_would_run_away_is_stopped(hssh, traces):
    wide = ", ".join(f"at(A{i},B{i})" for i in range(9))
    answer = hssh("maps", traces / "grid-3x3-ltplus.json", "--query", wide, "--budget", "0.4")
    assert answer.code == 4
    assert "budget" in answer.err


def test_policies_order_the_maps(hssh, traces):
    path = traces / "grid-3x3-ltplus.json"
    rows = hssh("maps", path, "--policy", "places-then-paths", "--all", "--json").document
    assert rows["policy"] == "places-then-paths"
    sizes = [(m["places"], m["paths"]) for m in rows["maps"]]
    assert sizes == sorted(sizes)
    only = hssh("maps", path, "--policy", "places-only", "--json").document["maps"]
    assert {m["places"] for m in only} == {min(sizes)[0]}
    assert len(only) == sum(places == min(sizes)[0] for places, _ in sizes)
    assert "fewest places" in hssh("maps", path, "--policy", "places-only").out


def test_maps_of_a_basic_trace(hssh, tmp_path):
    path = write(tmp_path / "basic.json", BASIC)
    document = hssh("maps", path, "--all", "--json").document
    assert document["schema"] == "hssh.basic-maps/1"
    assert document["complete"] is True
    assert document["consistent"] == len(document["maps"]) > 0
    assert all(len(m["at"]) == 5 for m in document["maps"])
    # Turning, travelling back and turning again is where one began.
    best = hssh("maps", path, "--json").document["maps"][0]
    assert (best["paths"], best["places"]) == (1, 2)
    assert "basic SSH" in hssh("maps", path).out
    assert hssh("maps", path, "--query", "at(V,P)").code == 2
    refused = hssh("route", path, "P0", "P1")
    assert refused.code == 3
    assert "basic trace" in refused.err


def test_faults_of_a_basic_trace_are_code_3(hssh, tmp_path):
    path = write(tmp_path / "basic.json", {**BASIC, "actions": ["fly"]})
    answer = hssh("maps", path)
    assert answer.code == 3
    assert "'fly'" in answer.err


def test_a_map_drawn_by_hand(hssh, tmp_path):
    path = write(tmp_path / "drawn.map", DRAWN)
    fine = hssh("check", path)
    assert (fine.code, fine.out) == (0, "The map violates no axiom.\n")
    wrong = {**DRAWN, "order": [["Main Street", "+", "yard", "hall"]]}
    answer = hssh("check", write(path, wrong))
    assert answer.code == 1
    assert "Axiom 8" in answer.out
    assert "Main Street" in answer.out
    document = hssh("check", path, "--json").document
    assert document["schema"] == "hssh.finished/1"
    assert document["consistent"] is False
    assert {v["axiom"] for v in document["violations"]} >= {"order_irreflexive"}
    broken = hssh("check", write(path, {**DRAWN, "paths": {"Main Street": "hall"}}))
    assert broken.code == 3
    assert hssh("check", path, "--assume", "v1=v0").code == 2


def test_a_map_given_as_facts_is_told_by_its_content(hssh, tmp_path):
    path = write(tmp_path / "drawn.txt", "% by hand\nat(q,a). along(q,h,plus).\n")
    answer = hssh("check", path)
    assert answer.code == 1
    assert "Axiom 5" in answer.out
    unknown = hssh("check", write(path, "att(q,a).\n"))
    assert unknown.code == 3
    assert "att/2" in unknown.err


def test_why_it_holds(hssh, figure8):
    document = hssh("check", figure8, "--why", "on(path(0,0),1)", "--json").document
    assert document["schema"] == "hssh.why/1"
    assert document["derivation"]["equation"] == "5"
    assert document["derivation"]["because"]
    text = hssh("check", figure8, "--why", "on(path(0,0),1)").out
    assert text.startswith("place P1 is on path(0,0) (equation 5)\n  ")
    no = hssh("check", figure8, "--why", "on(path(0,0),99)")
    assert (no.code, no.out) == (1, "")
    assert "what does hold: on(path(0,0),0)" in no.err
    tree = hssh("check", figure8, "--why", "order(path(0,0),plus,0,2)").out.splitlines()
    assert tree[0].startswith("P0 comes before P2 on path(0,0), plus: P1 is between them")
    told = [line.strip() for line in tree if "travel from v0 to v1 led" in line]
    assert len(told) == 2
    assert [line.endswith(", as said above") for line in told] == [False, True]
    assert hssh("check", figure8, "--why", "on(").code == 3
    assert hssh("check", figure8, "--why", "at(1,1)", "--assume", "v1=v0").code == 2


def test_why_a_visit_is_a_new_place(hssh, figure8):
    document = hssh("check", figure8, "--why-new", "v2", "--json").document
    assert document["schema"] == "hssh.new-place/1"
    assert document["new_in_map"] is True
    assert document["forced"] is True
    assert [e["visit"] for e in document["earlier"]] == ["v0", "v1"]
    assert all(e["axiom"] for e in document["earlier"])
    known = hssh("check", figure8, "--why-new", "v6")
    assert known.code == 1
    assert "is not new: it is at P0" in known.out
    assert hssh("check", figure8, "--why-new", "v99").code == 3


def test_glossary_and_policies(hssh):
    document = hssh("axioms", "--glossary", "--json").document
    assert {p["name"] for p in document["predicates"]} >= {"at", "along", "on", "order", "place"}
    assert "places-only" in document["policies"]
    assert "dstate Q is at place P" in hssh("axioms", "--glossary").out
    assert "places-then-paths" in hssh("axioms").out
