"""The theory clause by clause: each file without each of its statements in turn."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache

from clingo import ast

from hssh_kb.theory import axiom_directory

Read = Callable[[Iterable[str]], str]
"""Gives the program of some files, named without ``.lp``; what they include comes with them."""

_KINDS = (ast.ASTType.Rule, ast.ASTType.Minimize, ast.ASTType.ShowTerm, ast.ASTType.ShowSignature)
_INCLUDE = re.compile(r'^#include "(?P<name>[^"]+)\.lp"\.\n', re.MULTILINE)
_HEAD = re.compile(r"(?P<name>[a-z]\w*)\(")


@dataclass(frozen=True)
class Mutant:
    """A file without one statement.

    Attributes
    ----------
    file : name without ``.lp``. clause : text of what was taken out. text : what is left of the
        file; predicates that the clause derives are declared, so that nothing is missed but logic.
    """

    file: str
    clause: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}: {self.clause}"


def list_files() -> list[str]:
    """All files of the theory, named without ``.lp``."""
    directory = axiom_directory()
    paths = sorted(directory.rglob("*.lp"))
    return [path.relative_to(directory).as_posix().removesuffix(".lp") for path in paths]


@cache
def read_file(name: str) -> str:
    return (axiom_directory() / f"{name}.lp").read_text(encoding="utf-8")


def make_reader(mutant: Mutant | None = None) -> Read:
    """What reads the theory, one file of it changed; a file twice included is read once."""

    def read(names: Iterable[str]) -> str:
        texts: dict[str, str] = {}

        def add(name: str) -> None:
            if name in texts:
                return
            text = mutant.text if mutant and mutant.file == name else read_file(name)
            texts[name] = _INCLUDE.sub("", text)
            for include in _INCLUDE.findall(text):
                add(include)

        for name in names:
            add(name)
        return "\n".join(texts.values())

    return read


def read_closure_names(names: Iterable[str]) -> frozenset[str]:
    """Some files and all that they include."""
    found: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += _INCLUDE.findall(read_file(name))
    return frozenset(found)


def parse(text: str) -> list[ast.AST]:
    """The statements of a program; includes are taken out first, since they would be followed."""
    statements: list[ast.AST] = []
    ast.parse_string(_INCLUDE.sub(lambda match: "%" + match[0][1:], text), statements.append)
    return statements


def list_mutants(name: str) -> Iterator[Mutant]:
    """The file without each of its rules, costs, shown terms and includes."""
    text = read_file(name)
    for match in _INCLUDE.finditer(text):
        yield Mutant(name, match[0].strip(), text[: match.start()] + text[match.end() :])
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for statement in parse(text):
        if statement.ast_type not in _KINDS:
            continue
        begin, end = (
            starts[position.line - 1] + position.column - 1
            for position in (statement.location.begin, statement.location.end)
        )
        declared = " ".join(f"#defined {key}." for key in _derived(statement))
        yield Mutant(name, text[begin:end], f"{text[:begin]}{declared}{text[end:]}")


class _Atoms(ast.Transformer):
    def __init__(self) -> None:
        self.keys: set[str] = set()

    def visit_SymbolicAtom(self, node: ast.AST) -> ast.AST:  # noqa: N802
        if node.symbol.ast_type == ast.ASTType.Function:
            self.keys.add(f"{node.symbol.name}/{len(node.symbol.arguments)}")
        return node


def _derived(statement: ast.AST) -> list[str]:
    if statement.ast_type != ast.ASTType.Rule:
        return []
    atoms = _Atoms()
    atoms.visit(statement.head)
    return sorted(atoms.keys)
