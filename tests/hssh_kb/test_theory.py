"""Glossary, axiom table, messages and files agree."""

import pytest

from hssh_kb.errors import UsageError
from hssh_kb.glossary import (
    format_axiom_table,
    format_glossary,
    list_predicates,
    scan_statement,
)
from hssh_kb.theory import (
    POLICIES,
    axiom_directory,
    find_axiom,
    list_axioms,
    policy_levels,
    policy_program,
    read_program,
)


def test_readme_holds_the_axioms_and_the_glossary_of_the_files():
    text = (axiom_directory() / "README.md").read_text(encoding="utf-8")
    assert format_axiom_table() in text
    assert format_glossary() in text


def test_every_predicate_has_a_meaning_and_letters():
    for predicate in list_predicates():
        assert predicate.meaning, predicate
        assert predicate.atom.count(",") + 1 == predicate.arity


def test_every_predicate_is_derived_or_given_and_what_axioms_read_is_in_the_glossary():
    known = {f"{p.name}/{p.arity}" for p in list_predicates()}
    for axiom in list_axioms():
        assert set(axiom.reads) <= known, axiom.name


def test_headers_name_all_that_the_rules_read():
    own = {"violation/2"}
    for axiom in list_axioms():
        heads, bodies = set(), set()
        for statement in read_program(axiom.file.removesuffix(".lp")).split(".\n"):
            lines = [line for line in statement.splitlines() if not line.startswith(("%", "#"))]
            head, body = scan_statement(" ".join(lines).strip())
            heads |= {f"{name}/{arity}" for name, arity in head}
            bodies |= {f"{name}/{arity}" for name, arity in body}
        assert bodies - heads - own == set(axiom.reads), axiom.name


def test_unknown_names_are_told_with_what_there_is():
    with pytest.raises(UsageError, match="order_irreflexive"):
        find_axiom("order")
    with pytest.raises(UsageError, match="paths-then-places"):
        policy_program("fewest")


@pytest.mark.parametrize("policy", POLICIES)
def test_policy_file_minimises_what_its_levels_say(policy):
    text = read_program(policy_program(policy))
    counted = {level[0][0].replace("dear", "reading") for level in policy_levels(policy)}
    found = [name for name in ("path", "first", "reading") if f" {name}(" in text]
    assert set(found) == counted
