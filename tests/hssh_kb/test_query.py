"""Queries over all maps: what is certain, what is possible, and faults in the user's own words."""

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import worlds

import hssh_kb
from hssh_kb.errors import InputError
from hssh_kb.maps import count_paths, enumerate_maps
from hssh_kb.query import VOCABULARY, query_maps

WORLD, ROUTE = worlds.REFERENCES["grid-3x3-ltplus"][:2]
WALK = WORLD.drive(ROUTE)
MAPS = enumerate_maps(WALK).maps


def test_every_and_some_agree_with_the_maps():
    answer = query_maps(WALK, MAPS, "visit(V), at(V,P), not new(V)")
    assert answer.variables == ("V", "P")
    assert answer.maps == 62
    counts = {}
    for h in MAPS:
        for v, p in enumerate(h.visits):
            if v != p:
                counts[str(v), str(p)] = counts.get((str(v), str(p)), 0) + 1
    assert dict(answer.some) == counts
    assert set(answer.every) == {pair for pair, count in counts.items() if count == 62}


def test_sizes_are_those_of_the_maps():
    answer = query_maps(WALK, MAPS, "paths(K), places(N)")
    counts = {}
    for h in MAPS:
        key = (str(count_paths(WALK, h)), str(len(h.places)))
        counts[key] = counts.get(key, 0) + 1
    assert dict(answer.some) == counts


def test_order_runs_both_ways_and_no_place_follows_itself():
    forth = query_maps(WALK, MAPS, "order(H,plus,P,P')")
    back = query_maps(WALK, MAPS, "order(H,minus,P,P')")
    assert {(h, q, p, n) for (h, p, q), n in forth.some} == {
        (h, p, q, n) for (h, p, q), n in back.some
    }
    assert query_maps(WALK, MAPS, "order(H,D,P,P)").some == ()


@pytest.mark.parametrize("name", sorted({name for name, _ in VOCABULARY} - {"name"}))
def test_each_predicate_of_the_vocabulary_has_answers(name):
    for other, arity in VOCABULARY:
        if other == name:
            variables = ",".join(f"X{i}" for i in range(arity))
            assert query_maps(WALK, MAPS[:3], f"{name}({variables})").some


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ("", "is empty"),
        ("at(V", "cannot be read"),
        ("att(V,P)", "did you mean at?"),
        ("at(V)", "at takes 2 arguments, not 1"),
        ("not at(V,P)", "not negated"),
        ("at(V,P), X > 3", "unsafe"),
        ("at(V,P). at(V,P)", "one conjunction"),
        ("#count { V : at(V,P) } > 1, place(P)", "neither an atom nor a comparison"),
    ],
)
def test_faults_of_a_query_are_told(query, told):
    with pytest.raises(InputError) as caught:
        query_maps(WALK, MAPS[:2], query)
    assert told in str(caught.value)


def test_only_the_seam_imports_the_solver():
    root = Path(hssh_kb.__file__).parent
    seen = {
        path.relative_to(root).parts[0]
        for path in root.rglob("*.py")
        if re.search(r"^\s*(import|from) clingo", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert seen == {"solver"}
