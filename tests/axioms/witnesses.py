"""Small questions to the theory whose answers are known: by hand, or by the twins in Python.

Each names the files that it stands on. Together they notice when any clause of any file is taken
out (``test_clauses.py``).
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import brute_force
import test_basic
import test_path_types
import worlds
from asking import (
    Witness,
    axioms_but,
    count_levels,
    find_cost,
    is_dear,
    list_best,
    list_clauses,
    list_maps,
    make_witness,
    minimal_by,
)
from naming import NamedMap
from streets import STREETS, make_street
from test_independence import CLAIMS, FACTS, PLUS, WHOLE

from hssh_kb.basic import BasicExperience, basic_facts
from hssh_kb.experience import Experience
from hssh_kb.facts import experience_to_facts, price_of_reading
from hssh_kb.finished import claim_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.theory import axiom_program
from hssh_kb.trace import make_experience

LEVELS = {
    "policies/paths_then_places": [[("path", 2)], [("first", 1)], [("dear", 2)]],
    "policies/places_then_paths": [[("first", 1)], [("path", 2)], [("dear", 2)]],
    "policies/places_only": [[("first", 1)], [("dear", 2)]],
}
SEARCHED = ("star_isomorphism", "travel_function", "reversibility", "order_irreflexive")


# Finished maps: which clauses they violate.


def _finished() -> Iterator[Witness]:
    judged = axioms_but("star_isomorphism", "path_types", "view_function")
    files = ["finished", "components", *judged, "modes/diagnose", "show_violations"]
    for name, facts, genus in DRAWN:
        expected = [("planarity:genus",)] if genus else [()]
        yield make_witness(name, [*files, "entailed"], facts, expected, list_clauses)
    for clause, facts in FACTS.items():
        yield make_witness(":".join(clause), files, facts, [(":".join(clause),)], list_clauses)
    yield make_witness("a good map as facts", files, WHOLE, [()], list_clauses)
    for sign in ("plus", "minus"):
        one_way = f"order(h,{sign},a,b). on(h,a). on(h,b)."
        expected = ("order_reverses:one_way",)
        yield make_witness(f"order told only in {sign}", files, one_way, [expected], list_clauses)
        for place in "ab":
            facts = f"order(h,{sign},a,b). on(h,{place})."
            expected = ("order_on_path:off", "order_reverses:one_way")
            yield make_witness(
                f"order_on_path: only {place}, {sign}", files, facts, [expected], list_clauses
            )


def _draw(stars: dict[str, Sequence[str]], paths: dict[str, str]) -> str:
    """A map as its stars and the rows of places along its paths."""
    facts = ""
    for p, star in stars.items():
        for k, h in enumerate(star):
            sign = "plus" if h[-1] == "+" else "minus"
            facts += f"star({p},{k},{h[:-1]},{sign},1). "
    for h, row in paths.items():
        for p, p2 in pairwise(row):
            facts += f"neighbour({h},{p},{p2}). order({h},plus,{p},{p2}). "
    return facts


# Two places, three ways between them: planar only if they lie in opposite orders.
_THREE = {"f": "ab", "g": "ab", "h": "ab"}
_OPPOSITE = {"a": ("f+", "g+", "h+"), "b": ("h-", "g-", "f-")}
_SAME = {"a": ("f+", "g+", "h+"), "b": ("f-", "g-", "h-")}
_APART = {"i": "cd", "j": "cd", "k": "cd"}
DRAWN = (
    ("three ways in the plane", _draw(_OPPOSITE, _THREE), False),
    ("three ways on a torus", _draw(_SAME, _THREE), True),
    (
        "two pieces, both in the plane",
        _draw(_OPPOSITE | {"c": ("i+", "j+", "k+"), "d": ("k-", "j-", "i-")}, _THREE | _APART),
        False,
    ),
    (
        "two pieces, one on a torus",
        _draw(_SAME | {"c": ("i+", "j+", "k+"), "d": ("k-", "j-", "i-")}, _THREE | _APART),
        True,
    ),
    ("a row of three", _draw({"a": ("f+",), "b": ("f-", "f+"), "c": ("f-",)}, {"f": "abc"}), False),
    (
        "a row drawn backwards",
        _draw({"c": ("f+",), "b": ("f-", "f+"), "a": ("f-",)}, {"f": "cba"}),
        False,
    ),
    (
        "a row whose middle was named last",
        _draw({"a": ("f+",), "c": ("f-", "f+"), "b": ("f-",)}, {"f": "acb"}),
        False,
    ),
    ("at and along", "dstate(q). at(q,a). along(q,f,plus).", False),
    ("order alone", "order(f,minus,a,b). order(f,minus,b,c).", False),
)


# Claimed maps of an experience.


SPELT_OUT = {
    ("travel_function", "two_outcomes"): ["travel_function:two_results"],
    ("order_irreflexive", "twice"): ["order_irreflexive:itself"],
}
"""The clauses for named dstates say the same of a map in words."""


def _claims() -> Iterator[Witness]:
    files = ["experience", "map", "named", "components", *axioms_but("view_function")]
    files += ["modes/diagnose", "show_violations"]
    for clause, (experience, hypothesis) in CLAIMS.items():
        facts = claim_to_facts(experience, hypothesis)
        broken = tuple(sorted([":".join(clause), *SPELT_OUT.get(clause, ())]))
        yield make_witness(":".join(clause), files, facts, [broken], list_clauses)
    # Round a corner and back along the crossing's other way: a circular path through one place.
    yield _named("a circle in words", *CIRCLE)
    for seed in (1, 3):
        rng = random.Random(seed)
        experience = worlds.random_experience(rng, 5, triangular=seed == 3)
        plain = brute_force.plain(experience)
        for m in sorted(brute_force.all_maps(plain))[:2]:
            facts = claim_to_facts(experience, Hypothesis(*m[:2]))
            yield make_witness(f"a consistent map of walk {seed}", files, facts, [()], list_clauses)
            yield _named(f"a map of walk {seed} in words", experience, Hypothesis(*m[:2]))


def _named(name: str, experience: Experience, hypothesis: Hypothesis) -> Witness:
    """All that ``named.lp`` says of a map."""
    m = brute_force.Map(hypothesis.visits, hypothesis.offsets, (0,) * len(experience))
    facts = claim_to_facts(experience, hypothesis)
    facts += "#show. " + "".join(f"#show {key}. " for key in NAMED)
    atoms = tuple(sorted(NamedMap(brute_force.plain(experience), m).atoms))
    return make_witness(name, ["experience", "map", "named"], facts, [atoms], list_maps)


CIRCLE = (
    make_experience([(PLUS, None, 0), (PLUS, 0, 0), (PLUS, 1, None)]),
    Hypothesis((0, 1, 0), (0, 0, 0)),
)
NAMED = (
    *("opposite_direction/2", "star_size/2", "opposite_dlp/3", "dstate/1", "at/2", "schema/3"),
    *("is_travel/1", "is_turn/1", "is_turn_around/1", "along/3", "on/2", "order/4"),
)


# All maps of an experience, and the minimal ones.


def _shown(maps: Iterable[brute_force.Map]) -> list[tuple[str, ...]]:
    """Maps of the twin as ``show.lp`` shows them."""
    out = []
    for m in maps:
        atoms = [f"place({v},{p},{m.offsets[v]})" for v, p in enumerate(m.visits) if p != v]
        atoms += [f"reading({v},{r})" for v, r in enumerate(m.readings) if r]
        out.append(tuple(sorted(atoms)))
    return sorted(out)


def walk_of_plus() -> Experience:
    """Round a block of two by two crossings, all alike, with one way in."""
    return worlds.grid(2, 2, stubs=True).drive(worlds.RING[:5])


def walk_of_readings() -> Experience:
    """A short walk on which some visits have two readings."""
    rng = random.Random(2)
    return worlds.with_alternatives(rng, worlds.random_experience(rng, 3))


def _enumerations() -> Iterator[Witness]:
    core = ["experience", "generate", "map", "connected", "modes/strict", "show"]
    files = [*core, *map(axiom_program, SEARCHED)]
    walks = {
        "crossings": walk_of_plus(),
        "readings": walk_of_readings(),
        "corners": worlds.grid(2, 2).drive(worlds.RING[:5]),
    }
    for name, experience in walks.items():
        facts = experience_to_facts(experience)
        plain = brute_force.plain(experience)
        flat = _shown(brute_force.all_maps(plain))
        every = _shown(brute_force.all_maps(plain, planarity=False))
        for generator in ("wide", "tight"):
            yield make_witness(f"{name}, {generator}", [*files, generator], facts, every, list_maps)
        free = _shown(brute_force.all_maps(plain, order=False, planarity=False))
        unordered = [*files[:-1], "tight"]
        yield make_witness(f"{name}, no order", unordered, facts, free, list_maps)
        yield make_witness(f"{name}, all_maps", ["all_maps"], facts, flat, list_maps)
        best = (_shown(brute_force.best_maps(plain)[1]), 3) if name != "readings" else None
        if best:
            yield make_witness(f"{name}, best_maps", ["best_maps"], facts, best, list_best)
        if name == "corners":
            yield make_witness("corners, weighed", ["weighed_maps"], facts, (flat, 1), list_best)
    typed = CLAIMS["path_types", "type"][0]
    agreeing = _shown(
        m for m in brute_force.all_maps(brute_force.plain(typed)) if test_path_types.agree(typed, m)
    )
    facts = experience_to_facts(typed)
    yield make_witness("types", ["all_maps"], facts, agreeing, list_maps)
    yield make_witness("types, weighed", ["weighed_maps"], facts, (agreeing, 1), list_best)
    for clause in WEIGHED:
        experience, claimed = CLAIMS[clause]
        facts = experience_to_facts(experience)
        for v, (p, r) in enumerate(zip(claimed.visits, claimed.offsets, strict=True)):
            facts += f":- not place({v},{p},{r}). "
        weight = f"weight({clause[0]},0)."
        for name, fact, costs in (("weighed", "", True), ("weighed as nothing", weight, False)):
            yield make_witness(
                f"{':'.join(clause)} {name}", ["weighed_maps"], facts + fact, costs, is_dear
            )


WEIGHED = (
    ("star_isomorphism", "alpha"),
    ("travel_function", "two_outcomes"),
    ("reversibility", "two_ways_in"),
    ("order_irreflexive", "twice"),
    ("planarity", "genus"),
    ("path_types", "type"),
)


def _preferences() -> Iterator[Witness]:
    core = ["experience", "generate", "tight", "map", "modes/strict", "show", "objective"]
    core += map(axiom_program, SEARCHED)
    walks = {
        "crossings": walk_of_plus(),
        "readings": walk_of_readings(),
        "triangles": worlds.random_experience(random.Random(0), 3, triangular=True, stubs=True),
    }
    for name, experience in walks.items():
        plain = brute_force.plain(experience)
        facts = experience_to_facts(experience)
        every = brute_force.all_maps(plain, planarity=False)
        prices = {
            (v, r): price_of_reading(reading.weight)  # 0 where there is but one
            for v, visit in enumerate(experience.visits)
            for r, reading in enumerate(visit.readings)
        }
        for policy, levels in LEVELS.items():
            costs = {}
            for m in every:
                paths, places = brute_force.count(plain, m)
                dear = sum(prices[v, r] for v, r in enumerate(m.readings))
                known = {"path": paths, "first": places, "dear": dear}
                costs[m] = tuple(known[level[0][0]] for level in levels)
            least = min(costs.values())
            ties = _shown(m for m, cost in costs.items() if cost == least)
            expected = (ties, len(levels))
            yield make_witness(f"{name}, {policy}", [*core, policy], facts, expected, list_best)
        minimal = _shown(brute_force.subset_minimal(plain, planarity=False))
        levels = LEVELS["policies/paths_then_places"]
        yield make_witness(f"{name}, subset", core, facts, minimal, minimal_by(levels))
    for policy, levels in LEVELS.items():
        yield make_witness(
            f"nothing seen, {policy}", ["objective", policy], "", len(levels), count_levels
        )


# Modes and assumptions.

DOUBT = "doubtable(star(0)). doubtable(travel(1)). doubtable(assumption(0))."


def _modes() -> Iterator[Witness]:
    two = "violation(mine, one). violation(yours, two)."
    yield make_witness("strict", ["modes/strict"], two, [], list_maps)
    yield make_witness("strict, nothing violated", ["modes/strict"], "", [()], list_maps)
    free = "suspendable(mine). #show in_force/1. #show trusted/1. doubtable(star(3))."
    some = [(), ("trusted(star(3))",)]
    yield make_witness(
        "guarded", ["modes/guarded"], free + "violation(mine, one).", some, list_maps
    )
    yield make_witness("guarded, another axiom", ["modes/guarded"], free + two, [], list_maps)
    more = sorted([*some, ("in_force(mine)",), ("in_force(mine)", "trusted(star(3))")])
    yield make_witness("guarded, nothing violated", ["modes/guarded"], free, more, list_maps)
    for name, weights, cost in (
        ("counted", "", (2,)),
        ("weighed", "weight(mine,5).", (6,)),
        ("weighed, nothing else", "weight(mine,5). weight(yours,0).", (5,)),
    ):
        yield make_witness(name, ["modes/diagnose"], two + weights, cost, find_cost)
    yield make_witness("shown", ["show_violations"], "a. " + two, [tuple(_TWO)], list_maps)


_TWO = ("violation(mine,one)", "violation(yours,two)")


def _assumptions() -> Iterator[Witness]:
    experience = walk_of_plus()
    facts = experience_to_facts(experience)
    every = brute_force.all_maps(brute_force.plain(experience), planarity=False)
    core = ["experience", "generate", "tight", "map", "modes/strict", "show", "assume"]
    files = [*core, *map(axiom_program, SEARCHED)]
    for same in (True, False):
        fact = f"assumed_{'same' if same else 'different'}(0,4,0). "
        held = _shown(m for m in every if (m.visits[4] == m.visits[0]) == same)
        name = "v4 = v0" if same else "v4 != v0"
        yield make_witness(name, files, facts + fact, held, list_maps)
        doubted = facts + fact + "doubtable(assumption(0))."
        yield make_witness(f"{name} doubted", files, doubted, _shown(every), list_maps)
    trust = "#show. #show trusted/1. #show travel/2."
    told = tuple(sorted(["travel(0,1)", "trusted(star(0))", "trusted(star(1))"]))
    told = tuple(sorted([*told, "trusted(travel(1))"]))
    two = experience_to_facts(experience, range(2)) + trust
    yield make_witness("trusted", ["experience"], two, [told], list_maps)
    yield make_witness("doubted", ["experience"], two + DOUBT, [("trusted(star(1))",)], list_maps)


# The basic SSH.


def _basic() -> Iterator[Witness]:
    names = ("dstate_unique", "order_irreflexive", "travel_function", "dstate_identity")
    strict = ["basic", *map(axiom_program, (*names, "view_function"))]
    strict += ["modes/strict", "show_basic"]
    judged = ["basic", *axioms_but("star_isomorphism", "planarity", "path_types")]
    judged += ["modes/diagnose", "show_violations"]
    for number, moves in enumerate(BASIC):
        expected = []
        for part in test_basic.partitions(moves.views):
            if test_basic.holds(moves, part):
                atoms = [f"is({i},{q})" for i, q in enumerate(part) if i != q]
                expected.append(tuple(sorted(atoms)))
        facts = basic_facts(moves)
        yield make_witness(f"basic walk {number}", strict, facts, sorted(expected), list_maps)
        name = f"basic walk {number}, basic_maps"
        yield make_witness(name, ["basic_maps"], facts, sorted(expected), list_maps)
        yield make_witness(f"basic walk {number} judged", judged, facts, (0,), find_cost)
        if () in expected:  # all moments may be at new dstates
            new = facts + "".join(f":- not is({i},{i}). " for i in range(len(moves.views)))
            name = f"basic walk {number}, all new"
            yield make_witness(name, judged, new, [()], list_clauses)
    yield make_witness(*VIEWS, [("view_function:looks",)], list_clauses)


BASIC = (
    # The smallest walks that tell axioms 8, 1, 17, 16 and 12 from their absence.
    BasicExperience(("w", "w"), ("travel",)),
    BasicExperience(("w", "w"), ("turn around",)),
    BasicExperience(("w", "u"), ("turn right",)),
    BasicExperience(("w",) * 3, ("turn around", "turn around")),
    BasicExperience(("w",) * 3, ("turn right", "turn right")),
    BasicExperience(("w",) * 4, ("travel", "turn around", "travel")),
    BasicExperience(("w",) * 5, ("travel", "turn right", "travel", "turn around")),
    BasicExperience(("w",) * 5, ("turn around", "travel", "travel", "turn")),
    BasicExperience(("u", "w", "w", "u", "w"), ("turn right", "turn right", "travel", "travel")),
    BasicExperience(("w",) * 5, ("travel", "turn around", "travel", "turn around")),
)
# There and back: turning around, travelling and turning around again is where one began.
VIEWS = (
    "two looks of one dstate",
    [
        "basic",
        *axioms_but("star_isomorphism", "planarity", "path_types"),
        "modes/diagnose",
        "show_violations",
    ],
    basic_facts(
        BasicExperience(
            ("door", "end", "end", "door", "window"),
            ("travel", "turn around", "travel", "turn around"),
        )
    )
    + ":- not is(4,0). :- not is(2,2). :- not is(3,3). :- not is(1,1).",
)


WITNESSES: tuple[Witness, ...] = (
    *_finished(),
    *_claims(),
    *_enumerations(),
    *_preferences(),
    *_modes(),
    *_assumptions(),
    *_basic(),
    *map(make_street, STREETS),
)
