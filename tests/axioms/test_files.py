"""The files: headers, and silence when grounding."""

import re
from pathlib import Path

import pytest

from hssh_kb.facts import experience_to_facts
from hssh_kb.solver import ground
from hssh_kb.theory import axiom_directory, list_axioms, read_program
from hssh_kb.trace import load_trace

TRACES = Path(__file__).resolve().parents[1] / "traces"
FILES = sorted(axiom_directory().rglob("*.lp"))
NAMES = [path.relative_to(axiom_directory()).as_posix() for path in FILES]
INCLUDE = re.compile(r'#include "(?P<name>[^"]+)\.lp"\.')


def statements(text):
    """The statements of a program, comments taken out."""
    text = re.sub(r"%.*", "", text)
    return [part.strip() for part in re.split(r"\.(?=\s|\Z)", text) if part.strip()]


def test_equations_one_to_ten_are_all_there():
    numbers = [axiom.number for axiom in list_axioms()]
    assert numbers == list(range(1, len(numbers) + 1))
    for axiom in list_axioms()[:10]:
        assert f"equation {axiom.number};" in axiom.source
        assert f"equation 3.{axiom.number}" in axiom.source
        assert axiom.status.startswith("as published")


def test_headers_name_what_the_rules_derive():
    for axiom in list_axioms():
        text = read_program(axiom.file.removesuffix(".lp"))
        heads = re.findall(rf"^violation\({axiom.name}, (\w+)", text, re.MULTILINE)
        assert set(heads) == set(axiom.clauses)
        assert "violation(" not in text.split("% Derives")[0]
        for part in statements(text):
            assert not part.startswith(":-") or axiom.name == "planarity"


def closure(name):
    """The files that a file stands on, by its includes."""
    text = read_program(name)
    for include in INCLUDE.findall(text):
        text += closure(include)
    return INCLUDE.sub("", text)


@pytest.mark.parametrize("name", ["all_maps", "best_maps", "weighed_maps"])
def test_top_files_ground_in_silence(name):
    facts = experience_to_facts(load_trace(TRACES / "ring-2x2-l.json"))
    ground(closure(name) + facts)


@pytest.mark.parametrize("name", [name.removesuffix(".lp") for name in NAMES])
def test_each_file_grounds_alone_in_silence(name):
    ground(closure(name))
