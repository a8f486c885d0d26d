"""Facts: what is written is what was lived through; the instance stands alone."""

import random
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import worlds

from hssh_kb.experience import Experience, Visit
from hssh_kb.facts import candidate_facts, experience_to_facts, price_of_reading, write_instance
from hssh_kb.solver import parse_facts, solve_all
from hssh_kb.theory import read_program
from hssh_kb.trace import load_trace

TRACES = Path(__file__).resolve().parents[1] / "traces"


def test_facts_count_what_there_is():
    experience = load_trace(TRACES / "grid-3x3-ltplus.json")
    facts = parse_facts(experience_to_facts(experience))
    names = [name for name, _, _ in facts]
    assert names.count("visit") == 17
    assert names.count("travelled") == 16
    assert names.count("dlp") == sum(len(visit.star) for visit in experience.visits)
    assert names.count("arrives") == names.count("departs") == 16
    assert "price" not in names


def test_some_visits_only_and_travels_between_neighbours():
    experience = load_trace(TRACES / "ring-2x2-l.json")
    facts = {text for _, _, text in parse_facts(experience_to_facts(experience, [1, 2, 5]))}
    assert {f for f in facts if f.startswith("travelled")} == {"travelled(1,2)"}
    assert {f for f in facts if f.startswith("visit")} == {"visit(1)", "visit(2)", "visit(5)"}


def test_alternatives_have_prices():
    rng = random.Random(1)
    experience = worlds.with_alternatives(rng, worlds.grid(2, 2).drive(worlds.RING))
    facts = {text for _, _, text in parse_facts(experience_to_facts(experience))}
    for v, visit in enumerate(experience.visits):
        for r, reading in enumerate(visit.readings):
            fact = f"price({v},{r},{price_of_reading(reading.weight)})"
            assert (fact in facts) == (len(visit.readings) > 1)


def test_candidates_are_those_of_the_tight_generator():
    rng = random.Random(2)
    experience = worlds.with_alternatives(rng, worlds.grid(3, 2).drive(worlds.FIGURE8))
    program = read_program("tight") + experience_to_facts(experience)
    program += "#show. #show candidate/3.\n"
    (model,) = solve_all(program, lambda symbols: set(map(str, symbols))).found
    given = {text for _, _, text in parse_facts(candidate_facts(experience))}
    assert given == model


def test_instance_tells_names_in_comments_and_nothing_strange_escapes():
    experience = load_trace(TRACES / "office-section5.json")
    visits = tuple(
        Visit(visit.readings, visit.displacement, "a\nvisit(99).") for visit in experience.visits
    )
    text = write_instance(Experience(visits, source="x\nvisit(98)."))
    assert "python -m clingo" in text
    assert all("visit(9" not in fact for _, _, fact in parse_facts(text))
