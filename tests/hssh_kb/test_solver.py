"""The seam to clingo: silence, budgets, optima each once, circumscription."""

import time

import pytest

from hssh_kb.errors import InternalError
from hssh_kb.solver import (
    ground,
    is_satisfiable,
    parse_facts,
    solve_all,
    solve_best,
    solve_minimal,
)


def texts(symbols):
    return tuple(sorted(map(str, symbols)))


def test_messages_of_the_solver_are_our_own_fault():
    with pytest.raises(InternalError, match="does not occur in any rule head"):
        ground("a :- b.")
    with pytest.raises(InternalError, match="does not ground"):
        ground("a :- ")


def test_limit_and_completeness():
    program = "{a;b;c}."
    assert len(solve_all(program, texts).found) == 8
    some = solve_all(program, texts, limit=3)
    assert len(some.found) == 3
    assert not some.complete
    assert solve_all(program, texts, limit=8).complete


def test_none_is_left_out():
    found = solve_all("{a;b}.", lambda symbols: texts(symbols) or None)
    assert set(found.found) == {("a",), ("b",), ("a", "b")}
    assert found.complete


def test_budget_ends_a_long_search():
    pigeons = "1{at(P,H):H=1..10}1 :- P=1..11. :- at(P,H), at(Q,H), P<Q."
    start = time.monotonic()
    assert is_satisfiable(pigeons, budget_s=0.3) is None
    assert time.monotonic() - start < 3.0


def test_each_optimum_once():
    program = "1{a;b;c}. #minimize{1,a:a;1,b:b;1,c:c}."
    found = solve_best(program, texts)
    assert sorted(found.found) == [("a",), ("b",), ("c",)]
    assert found.cost == (1,)
    assert found.complete


def test_no_model_is_no_model():
    found = solve_best("a. :- a.", texts)
    assert found.found == ()
    assert found.complete


def test_circumscription_under_priorities():
    # x or (y and w), v free: of {x}, {y,w} only the second is minimal if x comes first.
    program = "{x;y;w;v}. :- not x, not y. :- not x, not w."
    first = solve_minimal(program, [[("x", 0)], [("y", 0), ("w", 0)]], texts)
    assert sorted(first.found) == [("v", "w", "y"), ("w", "y")]
    flat = solve_minimal(program, [[("x", 0), ("y", 0), ("w", 0)]], texts)
    assert sorted(flat.found) == [("v", "w", "y"), ("v", "x"), ("w", "y"), ("x",)]


def test_facts_only():
    assert parse_facts('p(1). q("a b",c).') == [("p", 1, "p(1)"), ("q", 2, 'q("a b",c)')]
    for text in ("p(X).", "p :- q.", "{p}.", "p", "#script(lua) #end."):
        with pytest.raises(ValueError):
            parse_facts(text)
