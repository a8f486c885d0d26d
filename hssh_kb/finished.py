"""Finished maps against the axioms: a map drawn by hand, or a claimed map of an experience."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience
from hssh_kb.facts import experience_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.program import blame_variant
from hssh_kb.solver import Symbol, Term, parse_facts, read_term, solve_best
from hssh_kb.text_files import parse_json, read_text
from hssh_kb.theory import axiom_program, find_axiom, list_axioms, read_messages, read_programs
from hssh_kb.variant import Variant
from perception.errors import InputError as StarError
from perception.star import Dlp, star_faults

MAP_SCHEMA = "hssh.map/1"
_EXPECTED = "a map drawn by hand (JSON of schema hssh.map/1, or facts)"
_NEEDS_VISITS = ("star_isomorphism", "path_types")
_NEEDS_VIEWS = ("view_function",)
_INPUTS = {
    ("dstate", 1),
    ("at", 2),
    ("along", 3),
    ("on", 2),
    ("order", 4),
    ("schema", 3),
    ("is_turn", 1),
    ("is_travel", 1),
    ("is_turn_around", 1),
    ("star", 5),
    ("neighbour", 3),
}


@dataclass(frozen=True)
class Finding:
    """One violation of an axiom by a finished map.

    Attributes
    ----------
    axiom : name. source : where it comes from. text : one plain sentence in the map's own names.
    witness : the clause and its arguments, as a term.
    names : the arguments, as texts.
    """

    axiom: str
    source: str
    text: str
    witness: str
    names: tuple[str, ...]


def check_map(path: str | Path, variant: Variant | None = None) -> tuple[Finding, ...]:
    """Test a map drawn by hand: JSON of schema ``hssh.map/1``, or facts; told apart by content.

    Returns
    -------
    tuple of Finding : empty if the map violates no axiom.

    Raises
    ------
    InputError : the file cannot be read or breaks the format; all faults at once.
    """
    text = read_text(path, _EXPECTED)
    if not text.lstrip("\ufeff \t\r\n").startswith(("{", "[")):
        return check_map_facts(text, str(path), variant)
    return check_map_data(parse_json(text, str(path), _EXPECTED), str(path), variant)


def check_map_facts(
    text: str, source: str = "map", variant: Variant | None = None
) -> tuple[Finding, ...]:
    """Test a map given as facts, as it stands: what equations 1 to 10 demand must be there.

    Raises
    ------
    InputError : not facts, or facts of predicates that no axiom reads.

    Examples
    --------
    >>> check_map_facts('order(main,plus,a,a). on(main,a). order(main,minus,a,a).')[0].axiom
    'order_irreflexive'
    """
    try:
        facts = parse_facts(text)
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None
    strange = sorted({f"{name}/{arity}" for name, arity, _ in facts} - _known())
    if strange:
        raise InputError(
            f"{source}: no axiom reads {', '.join(strange)}; expected {', '.join(sorted(_known()))}"
        )
    if not facts:
        raise InputError(f"{source}: holds no facts; expected {', '.join(sorted(_known()))}")
    return _find_violations("".join(f"{fact}.\n" for _, _, fact in facts), ("finished",), variant)


def check_map_data(
    data: Any,  # noqa: ANN401
    source: str = "map",
    variant: Variant | None = None,
) -> tuple[Finding, ...]:
    """Test a map given as a decoded ``hssh.map/1`` document.

    ``paths`` gives for each path its places in order, ``stars`` for some places the dlps clockwise
    (path, direction, alpha), ``order`` further claims as [path, direction, place, place]. What
    follows from these by equations 5, 6, 9 and 10 need not be said.

    Raises
    ------
    InputError : breaks the format; all faults at once.
    """
    faults: list[str] = []
    facts = _map_to_facts(data, faults)
    if faults:
        raise InputError(f"{source}: {'; '.join(faults[:10])}")
    text = "".join(f"{fact}.\n" for fact in facts)
    return _find_violations(text, ("finished", "entailed"), variant)


def check_hypothesis(experience: Experience, hypothesis: Hypothesis) -> tuple[Finding, ...]:
    """Test a claimed map of an experience: which visit is which place.

    Raises
    ------
    InputError : the claim speaks of other visits than the experience has.
    """
    facts = claim_to_facts(experience, hypothesis)
    return _find_violations(facts, ("experience", "map", "named"), visits=True)


def claim_to_facts(experience: Experience, hypothesis: Hypothesis) -> str:
    """Return an experience and one map of it as facts, for ``map.lp`` and ``named.lp``.

    Raises
    ------
    InputError : the map speaks of other visits than the experience has.
    """
    count = len(experience)
    if len(hypothesis.visits) != count or len(hypothesis.offsets) != count:
        raise InputError(f"the claimed map has {len(hypothesis.visits)} visits, expected {count}")
    facts = experience_to_facts(experience)
    for v, (p, r) in enumerate(zip(hypothesis.visits, hypothesis.offsets, strict=True)):
        if not 0 <= p <= v or hypothesis.visits[p] != p:
            raise InputError(
                f"the claimed map puts v{v} at the place of v{p}, which is not a first visit"
            )
        facts += f"place({v},{p},{r}). "
        facts += f"reading({v},{hypothesis.readings[v] if hypothesis.readings else 0}).\n"
    facts += "".join(f"doubtable(travel({v})).\n" for v in hypothesis.doubted)
    return facts


def _known() -> set[str]:
    return {f"{name}/{arity}" for name, arity in _INPUTS}


def _find_violations(
    facts: str,
    programs: Sequence[str],
    variant: Variant | None = None,
    *,
    visits: bool = False,
) -> tuple[Finding, ...]:
    variant = variant or Variant()
    left_out = {*_NEEDS_VIEWS, *variant.without, *(() if visits else _NEEDS_VISITS)}
    axioms = [a.name for a in list_axioms() if a.name not in left_out]
    program = read_programs(
        [
            *programs,
            "components",
            *map(axiom_program, axioms),
            "modes/diagnose",
            "show_violations",
        ]
    )

    def convert(symbols: Sequence[Symbol]) -> list[tuple[str, Symbol]]:
        return [(symbol.arguments[0].name, symbol.arguments[1]) for symbol in sorted(symbols)]

    with blame_variant(variant):
        best = solve_best("\n".join([variant.rules, program, facts]), convert, limit=1)
    found = best.found[0] if best.found else []
    findings = [_tell(axiom, witness, variant) for axiom, witness in found]
    number = {axiom.name: axiom.number for axiom in list_axioms()}
    return tuple(sorted(findings, key=lambda f: (number.get(f.axiom, len(number)), f.witness)))


def _tell(name: str, witness: Symbol, variant: Variant) -> Finding:
    term = read_term(witness)
    template = read_messages().get(name, {}).get(term.name)
    if name not in {axiom.name for axiom in list_axioms()}:
        sentence = f"{name} of {variant.source} is violated: it derives {witness}."
        return Finding(name, variant.source, sentence, str(witness), term.arguments)
    axiom = find_axiom(name)
    if template is None:
        sentence = f"Axiom {axiom.number} ({axiom.title}) is violated: it derives {witness}."
        return Finding(name, axiom.source, sentence, str(witness), term.arguments)
    text = template.format_map(name_arguments(axiom.arguments[term.name], term))
    sentence = f"Axiom {axiom.number} ({axiom.title}) is violated: {text}."
    return Finding(name, axiom.source, sentence, str(witness), term.arguments)


class _Words(dict[str, str]):
    """Placeholders; one that the witness does not fill shows as itself."""

    def __missing__(self, key: str) -> str:
        return f"({key})"


def name_arguments(variables: Sequence[str], term: Term) -> dict[str, str]:
    """Return what the placeholders of a message stand for, by the letters of the sorts."""
    stem = {"Q": "q", "P": "p", "H": "h", "A": "act", "V": "visit", "T": "travel", "K": "dlp"}
    words = _Words()
    for i, (variable, value) in enumerate(zip(variables, term.arguments, strict=True)):
        letter, primes = variable[0], variable.count("'")
        if letter not in stem:
            continue
        direction = ""
        if letter == "H" and i + 1 < len(variables) and variables[i + 1][0] == "D":
            direction = {"plus": "+", "minus": "-"}.get(term.arguments[i + 1], "")
        key = stem[letter] + (str(primes + 1) if primes else "")
        while key in words:
            key = f"{stem[letter]}{int(key[len(stem[letter]) :] or 1) + 1}"
        words[key] = value + direction
    if "p" in words:
        words.setdefault("place", words["p"])
    words.setdefault("a", "v" + words.get("visit", ""))
    words.setdefault("b", "v" + words.get("visit2", ""))
    return words


def _quote(name: str) -> str:
    escaped = name.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


def _map_to_facts(data: Any, faults: list[str]) -> list[str]:  # noqa: ANN401
    if not isinstance(data, dict) or data.get("schema") != MAP_SCHEMA:
        faults.append(f'expected a JSON object with "schema": "{MAP_SCHEMA}"')
        return []
    paths, stars = data.get("paths"), data.get("stars", {})
    claims = data.get("order", [])
    if not isinstance(paths, dict) or not paths:
        faults.append("'paths' must give at least one path, a list of its places in order")
        return []
    if not isinstance(stars, dict):
        faults.append("'stars' must give a list of dlps for each place")
        stars = {}
    facts: list[str] = []
    for name, places in paths.items():
        if not isinstance(places, list) or not all(isinstance(p, str) for p in places):
            faults.append(f"path {name!r}: must be a list of names of places, in order")
            continue
        facts += _path_facts(name, places)
    known = {p for places in paths.values() if isinstance(places, list) for p in places}
    for place, texts in stars.items():
        facts += _star_facts(place, texts, paths, faults)
    for i, claim in enumerate(claims if isinstance(claims, list) else [None]):
        facts += _claim_facts(i, claim, paths, known, faults)
    return facts


def _path_facts(name: str, places: Sequence[str]) -> Iterable[str]:
    h = _quote(name)
    for place in places:
        yield f"on({h},{_quote(place)})"
        for sign in ("plus", "minus"):
            q = f"q({_quote(place)},{h},{sign})"
            yield from (f"dstate({q})", f"at({q},{_quote(place)})", f"along({q},{h},{sign})")
    for one, other in pairwise(places):
        a, b = _quote(one), _quote(other)
        yield f"neighbour({h},{a},{b})"
        yield f"order({h},plus,{a},{b})"
        yield f"schema(q({a},{h},plus),travel,q({b},{h},plus))"
        yield f"schema(q({b},{h},minus),travel,q({a},{h},minus))"
    yield "is_travel(travel)"


def _star_facts(
    place: str,
    texts: Any,  # noqa: ANN401
    paths: dict[str, Any],
    faults: list[str],
) -> list[str]:
    if not isinstance(texts, list):
        faults.append(f"star of {place!r}: must be a list of dlps such as 'Main Street+1'")
        return []
    dlps = []
    for text in texts:
        try:
            dlps.append(Dlp.parse(text))
        except StarError as error:
            faults.append(f"star of {place!r}: {error}")
    faults += [f"star of {place!r}: {fault}" for fault in star_faults(dlps)]
    facts = []
    for k, dlp in enumerate(dlps):
        sign = "plus" if dlp.direction == "+" else "minus"
        h = _quote(dlp.path)
        facts.append(f"star({_quote(place)},{k},{h},{sign},{dlp.alpha})")
    unnamed = sorted({dlp.path for dlp in dlps} - set(paths))
    if unnamed:
        faults.append(f"star of {place!r}: no path is called {', '.join(map(repr, unnamed))}")
    return facts


def _claim_facts(
    i: int,
    claim: Any,  # noqa: ANN401
    paths: dict[str, Any],
    known: set[str],
    faults: list[str],
) -> list[str]:
    if (
        not isinstance(claim, list)
        or len(claim) != 4
        or claim[0] not in paths
        or claim[1] not in ("+", "-")
        or not {str(claim[2]), str(claim[3])} <= known
    ):
        faults.append(f"order[{i}]: must be [path, '+' or '-', place, place] with known names")
        return []
    sign = "plus" if claim[1] == "+" else "minus"
    names = f"{_quote(claim[0])},{sign},{_quote(claim[2])},{_quote(claim[3])}"
    return [f"order({names})"]
