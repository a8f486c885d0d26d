"""The glossary of predicates, read from the axiom files themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from hssh_kb.theory import axiom_directory, list_axioms

_MEANING = re.compile(r"%   (?P<atom>[a-z]\w*\([^)]*\))\s{2,}(?P<text>\S.*)")
_MORE = re.compile(r"%\s{10,}(?P<text>\S.*)")
_NAME = re.compile(r"(?<![\w'#@])([a-z]\w*)\(")
_TERMS = {"star", "travel", "assumption", "q", "path", "leg", "turn"}
"""Functors that also occur inside terms, where they are no predicates."""


@dataclass(frozen=True)
class Predicate:
    """One predicate of the theory.

    Attributes
    ----------
    name, arity : such as ``place`` and 3.
    atom : with the letters of its arguments, a letter standing for a sort.
    meaning : in words.
    derived_by, read_by : names of files; "given" stands for an input.
    """

    name: str
    arity: int
    atom: str
    meaning: str
    derived_by: tuple[str, ...]
    read_by: tuple[str, ...]


def format_glossary() -> str:
    """Return the glossary as a Markdown table."""
    rows = ["| predicate | meaning | derived by | read by |", "|---|---|---|---|"]
    for p in list_predicates():
        derived, read = _shorten(p.derived_by), _shorten(p.read_by)
        rows.append(f"| `{p.atom}` | {p.meaning} | {derived} | {read} |")
    return "\n".join(rows) + "\n"


def format_axiom_table() -> str:
    """Return number, name, statement, source and status of all axioms as a Markdown table."""
    rows = ["| no. | name | statement | source | status |", "|---|---|---|---|---|"]
    rows += [
        f"| {a.number} | `{a.name}` | {a.text} | {a.source} | {a.status} |" for a in list_axioms()
    ]
    return "\n".join(rows) + "\n"


def _shorten(files: tuple[str, ...]) -> str:
    """Name files without ending, numbered ones by their numbers."""
    words = [re.sub(r"^(\d\d)_.*", r"\1", file.removesuffix(".lp")) for file in files]
    return " ".join(words)


def list_predicates() -> tuple[Predicate, ...]:
    """Return all predicates that one file derives, or is given, and another reads.

    Examples
    --------
    >>> next(p.meaning for p in list_predicates() if p.name == "at")
    'dstate Q is at place P'
    """
    heads: dict[tuple[str, int], set[str]] = {}
    bodies: dict[tuple[str, int], set[str]] = {}
    meanings: dict[tuple[str, int], tuple[str, str]] = {}
    for path in sorted(axiom_directory().rglob("*.lp")):
        name = path.relative_to(axiom_directory()).as_posix()
        text = path.read_text(encoding="utf-8")
        meanings.update(_read_meanings(text))
        for statement in split_statements(text):
            head, body = scan_statement(statement)
            for key in head:
                heads.setdefault(key, set()).add(name)
            for key in body:
                bodies.setdefault(key, set()).add(name)
    out = []
    for key in sorted(set(heads) | set(bodies)):
        derived, read = heads.get(key, set()), bodies.get(key, set())
        if not (read - derived or len(derived) > 1) and key not in meanings:
            continue  # a helper of one file
        atom, meaning = meanings.get(key, (f"{key[0]}/{key[1]}", ""))
        given = tuple(sorted(derived)) or ("given",)
        out.append(Predicate(*key, atom, meaning, given, tuple(sorted(read))))
    return tuple(out)


def split_statements(text: str) -> list[str]:
    """Return the statements of a program, comments taken out."""
    text = re.sub(r"%.*", "", text)
    return [part.strip() for part in re.split(r"\.(?=\s|\Z)", text) if part.strip()]


def scan_statement(statement: str) -> tuple[set[tuple[str, int]], set[tuple[str, int]]]:
    """Return the predicates in head and body of a statement, with their arities."""
    if statement.startswith(("#defined", "#include", "#const")):
        return set(), set()
    if statement.startswith(("#minimize", "#show")):
        return set(), set(_find_atoms(statement))
    head, _, body = statement.partition(":-")
    inner = re.search(r"\{([^}]*)\}", head)
    if inner:
        chosen, _, condition = inner[1].partition(":")
        return set(_find_atoms(chosen)), set(_find_atoms(f"{condition},{body}"))
    return set(_find_atoms(head)), set(_find_atoms(body))


def _find_atoms(text: str) -> Iterator[tuple[str, int]]:
    """Yield the predicates of the atoms of a text; functors inside atoms are left out."""
    position = 0
    while match := _NAME.search(text, position):
        depth, commas, end = 1, 0, match.end()
        while end < len(text) and depth:
            depth += {"(": 1, ")": -1}.get(text[end], 0)
            commas += depth == 1 and text[end] == ","
            end += 1
        yield match[1], commas + 1
        position = end


def _read_meanings(text: str) -> Iterator[tuple[tuple[str, int], tuple[str, str]]]:
    atom, words = "", list[str]()
    for line in [*text.splitlines(), ""]:
        match, more = _MEANING.match(line), _MORE.match(line)
        if atom and more and not match:
            words.append(more["text"])
            continue
        if atom:
            yield (atom.partition("(")[0], atom.count(",") + 1), (atom, " ".join(words))
            atom = ""
        if match:
            atom, words = match["atom"], [match["text"].strip()]
