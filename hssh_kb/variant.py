"""Variants of the theory: rules changed, left out, weakened or added.

Quick Python twins stand in for the packaged files when maps are sought. As soon as a rule that
they mirror is changed, only the files are right, and clingo runs them.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from hssh_kb.errors import InputError, UsageError
from hssh_kb.solver import check_rules
from hssh_kb.text_files import read_text
from hssh_kb.theory import (
    Axiom,
    axiom_directory,
    find_axiom,
    list_axioms,
    packaged_directory,
)

FINGERPRINTS = {
    "08_order_irreflexive": "0e161f4843dd",
    "11_star_isomorphism": "8415b94b5f97",
    "12_travel_function": "36cf9eb8fb32",
    "13_reversibility": "edd77ac0ee6c",
    "14_planarity": "3c5d0d024ed5",
    "17_view_function": "ab68b0af8196",
    "18_path_types": "0493d45fb809",
    "assume": "ae6323143afc",
    "basic": "9cab4904582f",
    "components": "cebf80e8082b",
    "connected": "a090d88104ad",
    "experience": "db0d3d20e308",
    "generate": "fb4e1a45c73b",
    "map": "f4af317c06e9",
    "modes/guarded": "f68db5032c5c",
    "modes/strict": "1471f999d90d",
    "objective": "8f1f01f096e5",
    "policies/paths_then_places": "ec6a9117e062",
    "policies/places_only": "71dd8469efef",
    "policies/places_then_paths": "2ce3d0469aef",
}
"""The files whose rules the Python twins repeat, with the fingerprint of the rules that the tests
hold equal to them. What else is numbered judges named maps only."""
_NAMED_ONLY = {
    "dstate_unique",
    "turn_keeps_place",
    "travel_keeps_path",
    "turn_around_reverses",
    "place_on_path",
    "travel_orders",
    "order_on_path",
    "order_reverses",
    "order_transitive",
    "alpha",
    "dstate_identity",
    "view_function",
}


@dataclass(frozen=True)
class Variant:
    """What is asked for beyond the axiom files in use.

    Attributes
    ----------
    rules : further rules for ``violation/2``, as text. source : where they come from.
    without : names of axioms that are switched off.
    weights : what a violation of a weakened axiom costs, by name; such an axiom forbids nothing.
    """

    rules: str = ""
    source: str = "rules"
    without: frozenset[str] = frozenset()
    weights: Mapping[str, int] = field(default_factory=dict)

    @property
    def is_plain(self) -> bool:
        """True if the packaged theory holds as it is."""
        return not (self.rules or self.without or self.weights or list_changes())

    def check_effect(self) -> None:
        """Check that what is switched off or weakened is something a search for maps tests.

        Raises
        ------
        UsageError : it judges finished maps only.
        """
        for name in sorted({*self.without, *self.weights} & _NAMED_ONLY):
            raise UsageError(
                f"axiom {find_axiom(name).number} ({name}) holds by the way a map of an experience "
                "is written down; only maps drawn by hand can break it"
            )

    def search_axioms(self) -> tuple[str, ...]:
        """Return the axioms by which a map of an experience can fail, those of one's own included.

        Raises
        ------
        InputError : a directory of one's own holds a file that lacks its header.
        """
        names = [axiom.name for axiom in list_axioms()]
        return tuple(n for n in names if n not in _NAMED_ONLY and n not in self.without)

    def describe(self) -> str:
        """Return what differs from the packaged theory, in words; empty if nothing."""
        told = []
        changes = list_changes()
        if changes:
            told.append(f"changed in {axiom_directory()}: {', '.join(changes)}")
        if self.without:
            told.append(f"switched off: {', '.join(sorted(self.without))}")
        if self.weights:
            weak = (f"{name} (cost {w})" for name, w in sorted(self.weights.items()))
            told.append(f"weakened: {', '.join(weak)}")
        if self.rules:
            told.append(f"added: {self.source}")
        return "; ".join(told)

    def tell(self, *, probable: bool = False) -> str:
        """Return one line that says what differs, and what follows from it; empty if nothing.

        Parameters
        ----------
        probable : whether the most probable maps are sought, for which the files are not read.
        """
        told = self.describe()
        if not told:
            return ""
        if probable:
            return (
                f"axioms {told}; the search for the most probable maps holds to the packaged "
                "axioms, and maps that break those in use are left out"
            )
        return f"axioms {told}; so clingo runs the axiom files, which takes longer"


def list_changes() -> tuple[str, ...]:
    """Return the files in use whose rules differ from what the Python twins repeat.

    Comments and white space make no difference. A file that is missing differs, and so does a
    numbered axiom that is not among the packaged ones.
    """
    directory = axiom_directory()
    return _list_packaged() if directory == packaged_directory() else _compare(directory)


@cache
def _list_packaged() -> tuple[str, ...]:
    return _compare(packaged_directory())


def _compare(directory: Path) -> tuple[str, ...]:
    changed = [
        f"{name}.lp"
        for name, told in FINGERPRINTS.items()
        if fingerprint_rules(directory / f"{name}.lp") != told
    ]
    known = {axiom.file for axiom in list_axioms() if axiom.name in _NAMED_ONLY}
    known |= {f"{name}.lp" for name in FINGERPRINTS}
    changed += [p.name for p in sorted(directory.glob("[0-9][0-9]_*.lp")) if p.name not in known]
    return tuple(changed)


def fingerprint_rules(path: Path) -> str:
    """Return the fingerprint of the rules of a file; one that cannot be read has none."""
    rules = _read_rules(path)
    return hashlib.sha256(rules.encode()).hexdigest()[:12] if rules else ""


def _read_rules(path: Path) -> str:
    """Return the rules of a file without comments and white space; empty if it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
    return re.sub(r"\s+", "", re.sub(r"%.*|#defined[^.]*\.", "", text))


def read_variant(
    rules: Iterable[str | Path] = (),
    without: Iterable[str] = (),
    weaken: Iterable[str] = (),
) -> Variant:
    """Return a variant as a user asks for it, checked.

    Parameters
    ----------
    rules : files with further rules.
    without : axioms to switch off, by name or number.
    weaken : texts such as ``planarity=3``: axiom, by name or number, and cost of a violation.

    Raises
    ------
    InputError : a file cannot be read, or its rules cannot.
    UsageError : there is no such axiom, or a cost is no whole number of at least 1.

    Examples
    --------
    >>> sorted(read_variant(without=["14"], weaken=["order_irreflexive=2"]).without)
    ['planarity']
    """
    files = [Path(path) for path in rules]
    texts = [_load_rules(path) for path in files]
    weights = {}
    for text in weaken:
        name, _, cost = text.partition("=")
        if not cost.strip().isdigit() or int(cost) < 1:
            raise UsageError(f"{text!r}: expected an axiom and a cost, such as planarity=3")
        weights[_find_name(name.strip())] = int(cost)
    for name in list_changes():
        if (axiom_directory() / name).is_file():
            _load_rules(axiom_directory() / name)
    return Variant(
        "\n".join(texts),
        ", ".join(map(str, files)),
        frozenset(_find_name(name) for name in without),
        weights,
    )


def _load_rules(path: Path) -> str:
    text = read_text(path, "rules of a logic program")
    try:
        check_rules(text)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return text


def _find_name(word: str) -> str:
    axioms: Sequence[Axiom] = list_axioms()
    for axiom in axioms:
        if word in (axiom.name, str(axiom.number)):
            return axiom.name
    known = ", ".join(f"{axiom.number} {axiom.name}" for axiom in axioms)
    raise UsageError(f"no axiom is called {word!r}; there are {known}")
