"""What a user reads: sentences in their own names, faults of assumptions, golden answers."""

import json
import random
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import worlds

from hssh_kb.check import check, explain_new, parse_assumption
from hssh_kb.errors import InputError, UsageError
from hssh_kb.finished import check_map, check_map_data
from hssh_kb.maps import enumerate_maps

GOLDEN = Path(__file__).resolve().parents[1] / "golden" / "why_not.json"
NAMES = {0: "front door", 2: "lift lobby", 7: "kitchen", 12: "copy room"}


def named_walk():
    world, route = worlds.REFERENCES["grid-3x3-ltplus"][:2]
    experience = world.drive(route)
    visits = [replace(v, name=NAMES.get(i)) for i, v in enumerate(experience.visits)]
    return replace(experience, visits=tuple(visits))


def questions():
    """Forty assumptions about the named walk, some of them two at once."""
    rng = random.Random(11)
    out = []
    while len(out) < 40:
        pairs = [sorted(rng.sample(range(17), 2)) for _ in range(rng.choice([1, 1, 2]))]
        signs = [rng.choice(["=", "=", "=", "!="]) for _ in pairs]
        out.append([f"v{b}{s}v{a}" for (a, b), s in zip(pairs, signs, strict=True)])
    return out


def answer_all():
    experience = named_walk()
    out = []
    for assumptions in questions():
        answer = check(experience, assumptions)
        out.append(
            {
                "assume": assumptions,
                "status": answer.status,
                "text": answer.text,
                "observations": [list(v.observations) for v in answer.violations[:1]],
                "repairs": [list(r) for r in answer.repairs[:2]],
            }
        )
    return out


def test_forty_answers_are_as_filed():
    filed = json.loads(GOLDEN.read_text(encoding="utf-8"))
    answers = answer_all()
    assert answers == filed
    experience = named_walk()
    for answer in answers:
        assert answer["text"]
        if answer["status"] == "violated":
            labels = {experience.visit_label(v) for v in range(17)}
            assert sum(label in answer["text"] for label in labels) >= 2
            assert "axiom" in answer["text"] or "contradict" in answer["text"]


def test_names_of_visits_are_understood_and_used():
    experience = named_walk()
    answer = check(experience, ["kitchen = lift lobby"])
    assert "v7 (kitchen) = v2 (lift lobby)" in answer.text
    assert answer.violations[0].observations == ("v2", "v7")
    assert answer.violations[0].minimal


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("v7", "expected two visits"),
        ("v7==v2", "is no visit"),
        ("v99=v2", "there is no visit v99; the visits are v0 to v16"),
        ("v2=v2", "both sides are visit v2"),
        ("cellar=v2", "'cellar' is no visit"),
        ("", "expected two visits"),
        ("=v2", "expected two visits"),
    ],
)
def test_assumptions_that_make_no_sense_are_told(text, told):
    with pytest.raises(InputError, match="assumption") as caught:
        parse_assumption(named_walk(), text)
    assert told in str(caught.value)


def test_why_a_visit_is_a_new_place():
    experience = named_walk()
    answers = explain_new(experience, 4).earlier
    assert [earlier for earlier, _ in answers] == [0, 1, 2, 3]
    assert all(answer.violations for _, answer in answers)
    maps = enumerate_maps(experience).maps
    for earlier, answer in explain_new(experience, 9).earlier:
        assert answer.consistent == any(h.visits[9] == h.visits[earlier] for h in maps)
    with pytest.raises(InputError, match="no visit v17"):
        explain_new(experience, 17)


def test_bad_budgets_are_told():
    with pytest.raises(UsageError):
        check(named_walk(), budget_s=-1)
    with pytest.raises(UsageError):
        check(named_walk(), limit=0)


def test_consistent_answer_shows_a_map():
    experience = named_walk()
    answer = check(experience, ["v16=v0"])
    assert answer.status == "consistent"
    maps = {(h.visits, h.offsets) for h in enumerate_maps(experience).maps}
    assert (answer.example.visits, answer.example.offsets) in maps


def test_a_map_drawn_by_hand_is_tested(tmp_path):
    data = {
        "schema": "hssh.map/1",
        "paths": {"Main": ["A", "B", "C"], "Side": ["D", "B", "E"]},
        "stars": {"B": ["Main+1", "Side+1", "Main-1", "Side-1"]},
    }
    assert check_map_data(data) == ()
    data["paths"]["Ring"] = ["A", "D", "A"]
    path = tmp_path / "map.json"
    path.write_text(json.dumps(data))
    findings = check_map(path)
    assert {f.axiom for f in findings} == {"order_irreflexive"}
    assert any("on Ring+ the place A comes before itself" in f.text for f in findings)
    assert all(f.source for f in findings)


@pytest.mark.parametrize(
    ("content", "suffix", "told"),
    [
        ("{", ".json", "not valid JSON"),
        ("{}", ".json", "hssh.map/1"),
        ('{"schema": "hssh.map/1", "paths": {}}', ".json", "at least one path"),
        ('{"schema": "hssh.map/1", "paths": {"h": [1]}}', ".json", "list of names"),
        (
            '{"schema": "hssh.map/1", "paths": {"h": ["a"]}, "stars": {"a": ["x+1"]}}',
            ".json",
            "no path is called 'x'",
        ),
        (
            '{"schema": "hssh.map/1", "paths": {"h": ["a"]}, "order": [["h", "*", "a", "a"]]}',
            ".json",
            "order[0]",
        ),
        ("at(q,p", ".lp", "syntax error"),
        ("att(q,p).", ".lp", "no axiom reads att/2"),
        ("at(q,p) :- on(h,p).", ".lp", "is not a fact"),
        ("", ".lp", "holds no facts"),
    ],
)
def test_faults_of_a_drawn_map_are_told(tmp_path, content, suffix, told):
    path = tmp_path / f"map{suffix}"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        check_map(path)
    assert told in str(caught.value)
    assert str(path) in str(caught.value)


def test_missing_map_file_is_told(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        check_map(tmp_path / "none.json")
