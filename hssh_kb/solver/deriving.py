"""Why an atom holds: a derivation, found over a program that has one model and needs no search."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from clingo import ast

from hssh_kb.solver.solving import ground

_ANNOTATION = re.compile(r"%@\s*(?P<label>\S+)\s*\|\s*(?P<text>.*\S)")


@dataclass(frozen=True)
class Step:
    """How one atom is derived.

    Attributes
    ----------
    atom : text of the atom. label, sentence : from the annotation of the rule; empty if it has
        none, or for a fact. body : the atoms that the rule needs.
    """

    atom: str
    label: str
    sentence: str
    body: tuple[str, ...]


@dataclass(frozen=True)
class _Rule:
    label: str
    template: str
    variables: tuple[str, ...]


def derive_all(
    program: str, tell: Callable[[str, str], str] = lambda _, value: value
) -> dict[str, Step]:
    """Return one well-founded derivation step for each atom of a program without choices.

    Parameters
    ----------
    program : text of the program.
    tell : how the value of a variable stands in a sentence, given its name and the value.

    Rules are rewritten so that each of their instances shows as a term; a round of forward
    chaining then picks, for each atom, the first rule whose body is derived already.
    """
    rules, rewritten = _rewrite(program)
    control = ground(program + "\n" + "\n".join(rewritten))
    waiting: list[tuple[str, Step]] = []
    known: dict[str, Step] = {}
    for atom in control.symbolic_atoms:
        symbol = atom.symbol
        if symbol.name != "_step":
            continue
        number, head, body, values = symbol.arguments
        rule = rules[number.number]
        named = dict(zip(rule.variables, map(str, values.arguments), strict=True))
        told = {variable: tell(variable, value) for variable, value in named.items()}
        step = Step(
            str(head),
            rule.label,
            _fill(rule.template, told, named),
            tuple(map(str, body.arguments)),
        )
        waiting.append((step.atom, step))
    while waiting:
        fresh: dict[str, Step] = {}
        rest: list[tuple[str, Step]] = []
        for goal, step in waiting:
            if goal in known:
                continue
            if all(part in known for part in step.body):
                fresh.setdefault(goal, step)
            else:
                rest.append((goal, step))
        if not fresh:
            break
        known |= fresh
        waiting = rest
    return known


def _fill(template: str, told: dict[str, str], plain: dict[str, str]) -> str:
    """Fill the placeholders; inside a term such as q({P},{K}) values stay as they are."""
    filled = re.sub(r"(\(|,)\{([^}]+)\}", lambda m: m[1] + plain.get(m[2], m[0]), template)
    return re.sub(r"\{([^}]+)\}", lambda m: told.get(m[1], m[0]), filled)


def _rewrite(program: str) -> tuple[list[_Rule], list[str]]:
    """Return the rules, and for each a rule that shows its instances as ``_step`` atoms."""
    rules: list[_Rule] = []
    rewritten: list[str] = []
    annotation: list[tuple[str, str]] = []

    def visit(node: ast.AST) -> None:
        if node.ast_type == ast.ASTType.Comment:
            match = _ANNOTATION.match(str(node))
            if match:
                annotation[:] = [(match["label"], match["text"])]
            return
        if node.ast_type != ast.ASTType.Rule or not _is_plain(node.head):
            return
        label, template = annotation.pop() if annotation else ("", "")
        variables = tuple(sorted(set(_variables(node))))
        body = [str(literal) for literal in node.body]
        positive = [str(literal) for literal in node.body if _is_plain(literal)]
        head = str(node.head)
        terms = (len(rules), head, _term("b", positive), _term("v", variables))
        rewritten.append(f"_step({','.join(map(str, terms))}) :- {'; '.join(body or ['#true'])}.")
        rules.append(_Rule(label, template, variables))

    ast.parse_string(program, visit)
    return rules, rewritten


def _term(name: str, arguments: Iterable[str]) -> str:
    inside = ",".join(arguments)
    return f"{name}({inside})" if inside else f"{name}"


def _is_plain(node: ast.AST) -> bool:
    """Return whether a node is an atom, not negated."""
    return bool(
        node.ast_type == ast.ASTType.Literal
        and node.sign == ast.Sign.NoSign
        and node.atom.ast_type == ast.ASTType.SymbolicAtom
    )


class _Variables(ast.Transformer):
    def __init__(self) -> None:
        self.names: list[str] = []

    def visit_Variable(self, node: ast.AST) -> ast.AST:  # noqa: N802
        self.names.append(node.name)
        return node

    def visit_BodyAggregate(self, node: ast.AST) -> ast.AST:  # noqa: N802
        return node


def _variables(rule: ast.AST) -> list[str]:
    """Return the variables of head and body, those inside aggregates left out."""
    finder = _Variables()
    finder.visit(rule.head)
    for literal in rule.body:
        finder.visit(literal)
    return [name for name in finder.names if name != "_"]
