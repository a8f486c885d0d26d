"""Why something holds: trees that end in what was given, with the equations named."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import worlds

from hssh_kb.errors import InputError, NoAnswerError
from hssh_kb.finished import claim_to_facts
from hssh_kb.maps import minimal_maps
from hssh_kb.solver import derive_all, solve_all
from hssh_kb.theory import read_programs
from hssh_kb.why import explain_holds

WORLD, ROUTE = worlds.REFERENCES["figure8-3x2-lt"][:2]
WALK = WORLD.drive(ROUTE)
MAP = minimal_maps(WALK).maps[0]
PROGRAM = read_programs(["experience", "map", "named"]) + claim_to_facts(WALK, MAP)


def test_every_atom_of_the_model_is_derived_and_nothing_else():
    text = PROGRAM + "#show. #show at/2. #show on/2. #show along/3. #show order/4. #show schema/3."
    (model,) = solve_all(text, lambda symbols: set(map(str, symbols))).found
    steps = derive_all(PROGRAM)
    kinds = ("at", "on", "along", "order", "schema")
    assert {atom for atom in steps if atom.partition("(")[0] in kinds} == model


def test_trees_are_well_founded_and_name_their_equations():
    steps = derive_all(PROGRAM)
    orders = [atom for atom in steps if atom.startswith("order(")]
    assert orders
    for atom in orders[:12]:
        tree = explain_holds(WALK, MAP, atom)
        equations = set()

        def walk(node, above, equations=equations):
            assert node.atom not in above, "a reason that rests on itself"
            assert node.sentence
            assert not node.sentence.count("{")
            equations.add(node.equation)
            if not node.because:
                assert node.atom.partition("(")[0] in ("place", "travel"), node.atom
            for child in node.because:
                walk(child, {*above, node.atom})

        walk(tree, set())
        assert tree.equation in ("6", "9", "10")
        assert "6" in equations
        assert next(iter(tree.lines())).endswith(f"(equation {tree.equation})")


def test_what_does_not_hold_is_said():
    with pytest.raises(NoAnswerError, match="does not hold in this map"):
        explain_holds(WALK, MAP, "on(path(0,0),99)")


@pytest.mark.parametrize("text", ["", "on(", "on(H,1)", "on(path(0,0),0). at(1,1)", "not on(a,b)"])
def test_what_is_no_atom_is_told(text):
    with pytest.raises(InputError):
        explain_holds(WALK, MAP, text)
