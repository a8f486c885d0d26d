"""Each clause of each axiom has a smallest witness that breaks only that axiom, and is needed."""

import random
import re
from dataclasses import replace

import pytest
import worlds

from hssh_kb.basic import BasicExperience, basic_facts
from hssh_kb.facts import experience_to_facts
from hssh_kb.finished import check_hypothesis, check_map_facts, claim_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.solver import is_satisfiable, solve_best
from hssh_kb.theory import axiom_program, list_axioms, read_messages, read_programs
from hssh_kb.trace import experience_from_data, experience_to_data, make_experience

PLUS = ["a+1", "b+1", "a-1", "b-1"]
CORNER = ["c+1", "d+1", "c-0", "d-0"]
TURN = (CORNER, 2, 1)  # comes in through c+, faces c-, leaves along d+

FACTS = {
    ("dstate_unique", "nowhere"): "dstate(q). along(q,h,plus).",
    ("dstate_unique", "no_path"): "dstate(q). at(q,a).",
    ("dstate_unique", "two_places"): "at(q,a). at(q,b).",
    ("dstate_unique", "two_paths"): "along(q,h,plus). along(q,g,plus).",
    ("turn_keeps_place", "turn"): "schema(q,right,r). is_turn(right). at(q,a).",
    ("travel_keeps_path", "travel"): "schema(q,go,r). is_travel(go). along(q,h,plus).",
    (
        "turn_around_reverses",
        "turn_around",
    ): "schema(q,about,r). is_turn_around(about). along(q,h,plus).",
    ("place_on_path", "off"): "at(q,a). along(q,h,plus).",
    ("travel_orders", "unordered"): (
        "schema(q,go,r). is_travel(go). at(q,a). at(r,b). along(q,h,plus). along(r,h,plus). "
        "on(h,a). on(h,b)."
    ),
    ("order_on_path", "off"): "order(h,plus,a,b). order(h,minus,b,a).",
    ("order_irreflexive", "itself"): "order(h,plus,a,a). order(h,minus,a,a). on(h,a).",
    ("order_reverses", "one_way"): "order(h,plus,a,b). on(h,a). on(h,b).",
    ("order_transitive", "gap"): (
        "order(h,plus,a,b). order(h,plus,b,c). order(h,minus,b,a). order(h,minus,c,b). "
        "on(h,a). on(h,b). on(h,c)."
    ),
    ("travel_function", "two_results"): "schema(q,go,r). schema(q,go,s).",
    ("dstate_identity", "double"): ("at(q,a). at(r,a). along(q,h,plus). along(r,h,plus). on(h,a)."),
    (
        "alpha",
        "blocked",
    ): "star(a,0,h,plus,0). order(h,plus,a,b). order(h,minus,b,a). on(h,a). on(h,b).",
}
WHOLE = (
    "dstate(q). dstate(r). at(q,a). at(r,b). along(q,h,plus). along(r,h,plus). on(h,a). on(h,b). "
    "schema(q,go,r). is_travel(go). order(h,plus,a,b). order(h,minus,b,a). star(a,0,h,plus,1)."
)


def loop(last):
    """Out along a+, round a corner, and back into the first place, seen as ``last``."""
    return make_experience([(PLUS, None, 0), TURN, last]), Hypothesis((0, 1, 0), (0, 0, 0))


def typed(experience):
    """The first dlp is a corridor at the first visit; at the last, a way along a wall."""
    data = experience_to_data(experience)
    for v, told in ((0, "MIDLINE"), (-1, "LEFTWALL")):
        data["visits"][v]["types"] = [told, *[None] * 3]
    return data


CLAIMS = {
    ("star_isomorphism", "size"): loop((["a+1", "b+1", "c+1", "a-1", "b-1", "c-1"], 4, None)),
    ("star_isomorphism", "alpha"): loop((["a+1", "b+1", "a-1", "b-0"], 3, None)),
    ("star_isomorphism", "opposite"): (
        make_experience(
            [
                (["a+1", "b+1", "c+1", "a-1", "b-1", "c-1"], None, 0),
                TURN,
                (["a+1", "b+1", "c+1", "a-1", "c-1", "b-1"], 5, None),
            ]
        ),
        Hypothesis((0, 1, 0), (0, 0, 0)),
    ),
    ("travel_function", "two_outcomes"): (
        make_experience([(PLUS, None, 0), TURN, (PLUS, 3, 0), (CORNER, 2, None)]),
        Hypothesis((0, 1, 0, 3), (0, 0, 0, 0)),
    ),
    ("reversibility", "two_ways_in"): (
        make_experience([(PLUS, None, 0), (PLUS, 0, 1), TURN, (PLUS, 0, None)]),
        Hypothesis((0, 1, 2, 1), (0, 0, 0, 0)),
    ),
    ("reversibility", "not_back"): (
        make_experience([(PLUS, None, 0), (PLUS, 0, 2), (PLUS, 0, None)]),
        Hypothesis((0, 1, 2), (0, 0, 0)),
    ),
    ("order_irreflexive", "twice"): (
        make_experience([(PLUS, None, 0), (PLUS, 0, 0), (PLUS, 0, None)]),
        Hypothesis((0, 1, 0), (0, 0, 0)),
    ),
    ("path_types", "type"): (
        experience_from_data(typed(loop((PLUS, 3, None))[0])),
        Hypothesis((0, 1, 0), (0, 0, 0)),
    ),
    # Two loops through one crossing, from a+ round to a- and from b+ round to b-: a torus.
    ("planarity", "genus"): (
        make_experience([(PLUS, None, 0), TURN, TURN, (PLUS, 0, 1), TURN, TURN, (PLUS, 1, None)]),
        Hypothesis((0, 1, 2, 0, 4, 5, 0), (0,) * 7),
    ),
}


def broken(findings):
    return {finding.axiom for finding in findings}


def clauses(findings):
    return {(finding.axiom, finding.witness.partition("(")[0]) for finding in findings}


@pytest.mark.parametrize("clause", sorted(FACTS), ids=":".join)
def test_facts_break_only_this_axiom(clause):
    findings = check_map_facts(FACTS[clause])
    assert broken(findings) == {clause[0]}
    assert clauses(findings) == {clause}


@pytest.mark.parametrize("clause", sorted(CLAIMS), ids=":".join)
def test_claimed_map_breaks_only_this_axiom(clause):
    findings = check_hypothesis(*CLAIMS[clause])
    assert broken(findings) == {clause[0]}
    assert clause in clauses(findings)


INTO_ITSELF = (make_experience([(PLUS, None, 0), (PLUS, 2, None)]), Hypothesis((0, 0), (0, 0)))
SEARCHED = ("star_isomorphism", "travel_function", "reversibility", "planarity", "path_types")


def test_a_gateway_that_leads_into_itself_breaks_only_reversibility_where_axiom_8_is_off():
    files = ["experience", "map", "components", *map(axiom_program, SEARCHED)]
    program = read_programs([*files, "modes/diagnose", "show_violations"])
    program += claim_to_facts(*INTO_ITSELF)
    best = solve_best(program, lambda symbols: sorted(map(str, symbols)))
    assert best.found == (["violation(reversibility,into_itself(1,0,0))"],)


@pytest.mark.parametrize("seed", range(4))
def test_axiom_8_implies_that_no_gateway_leads_into_itself(seed):
    rng = random.Random(seed)
    experience = worlds.random_experience(rng, 4, triangular=seed % 2 == 0, stubs=True)
    files = ["experience", "generate", "wide", "map", *map(axiom_program, SEARCHED[2:3])]
    program = read_programs([*files, axiom_program("order_irreflexive")])
    program += experience_to_facts(experience)
    program += "into :- violation(reversibility,into_itself(T,P,K)). :- not into."
    assert is_satisfiable(program)
    assert not is_satisfiable(program + ":- violation(order_irreflexive,X).")


@pytest.mark.parametrize("clause", sorted(FACTS), ids=":".join)
def test_no_fact_of_a_witness_can_be_spared(clause):
    facts = re.findall(r"\w+\([^)]*\)\.", FACTS[clause])
    for i in range(len(facts)):
        fewer = " ".join(facts[:i] + facts[i + 1 :])
        findings = check_map_facts(fewer) if fewer else ()
        assert clauses(findings) != {clause}


@pytest.mark.parametrize("clause", sorted(CLAIMS), ids=":".join)
def test_no_visit_of_a_witness_can_be_spared(clause):
    experience, hypothesis = CLAIMS[clause]
    for count in range(1, len(experience)):
        begun = replace(experience, visits=experience.visits[:count])
        assert (
            check_hypothesis(
                begun, Hypothesis(*(x[:count] for x in (hypothesis.visits, hypothesis.offsets)))
            )
            == ()
        )


def test_two_looks_of_one_dstate_break_only_the_view_function():
    names = [
        a.name
        for a in list_axioms()
        if a.name not in ("star_isomorphism", "planarity", "path_types")
    ]
    names = ["basic", *map(axiom_program, names), "modes/diagnose", "show_violations"]
    # There and back: turning around, travelling and turning around again is where one began.
    moves = BasicExperience(
        ("door", "end", "end", "door", "window"),
        ("travel", "turn around", "travel", "turn around"),
    )
    forced = basic_facts(moves) + ":- not is(4,0). :- not is(2,2). :- not is(3,3). :- not is(1,1)."
    best = solve_best(read_programs(names) + forced, lambda symbols: sorted(map(str, symbols)))
    assert best.found == (["violation(view_function,looks(0,4))"],)


def test_every_clause_has_a_witness():
    stated = {(axiom.name, clause) for axiom in list_axioms() for clause in axiom.clauses}
    elsewhere = {("reversibility", "into_itself"), ("view_function", "looks")}
    assert stated == set(FACTS) | set(CLAIMS) | elsewhere


def test_messages_agree_with_the_clauses():
    stated = {(axiom.name, clause) for axiom in list_axioms() for clause in axiom.clauses}
    told = {(name, clause) for name, texts in read_messages().items() for clause in texts}
    assert told == stated | {("star_isomorphism", "none")}


def test_good_maps_satisfy_every_axiom():
    walk = make_experience([(PLUS, None, 0), TURN, (PLUS, 3, None)])
    assert check_hypothesis(walk, Hypothesis((0, 1, 0), (0, 0, 0))) == ()
    assert check_map_facts(WHOLE) == ()
