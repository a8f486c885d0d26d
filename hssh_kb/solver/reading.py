"""Reading what users write in the language of the solver: facts and queries."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import clingo
from clingo import ast

from hssh_kb.errors import BudgetError
from hssh_kb.solver.solving import Symbol


def parse_facts(text: str) -> list[tuple[str, int, str]]:
    """Read a text of facts: (predicate, arity, text of the atom) each.

    Raises
    ------
    ValueError : not a text of ground facts; says where and what is wrong.
    """
    facts: list[tuple[str, int, str]] = []
    messages: list[str] = []
    kinds: list[str] = []

    def note(statement: ast.AST) -> None:
        if statement.ast_type == ast.ASTType.Rule and not statement.body:
            head = statement.head
            if head.ast_type == ast.ASTType.Literal and head.sign == ast.Sign.NoSign:
                atom = head.atom
                if atom.ast_type == ast.ASTType.SymbolicAtom:
                    return
        if statement.ast_type not in (ast.ASTType.Program, ast.ASTType.Comment):
            kinds.append(f"line {statement.location.begin.line}: {statement} is not a fact")

    def log(_: clingo.MessageCode, message: str) -> None:
        messages.append(message.strip().replace("<string>:", "line "))

    try:
        ast.parse_string(text, note, logger=log)
        if kinds:
            raise ValueError("; ".join(kinds[:5]))
        control = clingo.Control(["--warn=none"], logger=log)
        control.add("base", [], text)
        control.ground([("base", [])])
    except RuntimeError:
        raise ValueError("; ".join(messages[:5]).replace("<block>:", "line ")) from None
    for atom in control.symbolic_atoms:
        symbol = atom.symbol
        facts.append((symbol.name, len(symbol.arguments), str(symbol)))
    return sorted(facts)


def check_rules(text: str) -> None:
    """Check that rules can be read and are safe; what they speak of may be given elsewhere.

    Raises
    ------
    ValueError : they are not, or hold a script; says where and what is wrong.
    """
    messages: list[str] = []

    def note(statement: ast.AST) -> None:
        if statement.ast_type == ast.ASTType.Script:
            raise ValueError(f"line {statement.location.begin.line}: scripts are not run")

    def log(_: clingo.MessageCode, message: str) -> None:
        told = message.strip().replace("<string>:", "line ").replace("<block>:", "line ")
        messages.append(" ".join(told.split()))

    try:
        ast.parse_string(text, note, logger=log)
        control = clingo.Control(["--warn=none"], logger=log)
        control.add("base", [], text)
        control.ground([("base", [])])
    except RuntimeError:
        raise ValueError("; ".join(messages[:5])) from None


@dataclass(frozen=True)
class Term:
    """A ground term: functor and the texts of its arguments."""

    name: str
    arguments: tuple[str, ...]


def read_term(symbol: Symbol) -> Term:
    """Return functor and arguments of a symbol, strings without their quotes."""
    return Term(symbol.name, tuple(show_term(argument) for argument in symbol.arguments))


def show_term(symbol: Symbol) -> str:
    """Return the text of a symbol, a string without its quotes."""
    return symbol.string if symbol.type == clingo.SymbolType.String else str(symbol)


def answer_query(
    query: str,
    facts: Sequence[tuple[str, tuple[str, ...]]],
    known: set[tuple[str, int]],
    *,
    budget_s: float | None = None,
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Answer a conjunction over several sets of facts at once.

    Parameters
    ----------
    query : literals with commas between them.
    facts : predicate and arguments, the first of which is the number of the set.
    known : the predicates, with their arities (the number of the set not counted).
    budget_s : seconds to spend.

    Returns
    -------
    (variables of the query, instances: number of the set and values of the variables).

    Raises
    ------
    ValueError : not a conjunction of literals over known predicates, or unsafe.
    BudgetError : the budget was spent.
    """
    messages: list[str] = []
    complaints: list[str] = []
    rules: list[ast.AST] = []

    def log(_: clingo.MessageCode, message: str) -> None:
        complaints.append(message)
        messages.append(message.strip().splitlines()[0].partition("error: ")[2] or message.strip())

    try:
        ast.parse_string(f"answer :- {query}.", rules.append, logger=log)
    except RuntimeError:
        raise ValueError(f"cannot be read ({'; '.join(messages)})") from None
    rules = [rule for rule in rules if rule.ast_type != ast.ASTType.Program]
    if len(rules) != 1 or rules[0].ast_type != ast.ASTType.Rule:
        raise ValueError("must be one conjunction of literals")
    indexed = _IndexQuery(known)
    body = [str(indexed.visit(literal)) for literal in rules[0].body]
    if not indexed.positive:
        raise ValueError("needs at least one predicate that is not negated")
    variables = tuple(indexed.variables)
    head = f"answer({','.join((_INDEX, *variables))})"
    body += [f"0 = @tick({','.join(names)})" for names in indexed.prefixes[1:] if names]
    program = f"#show. #show {head} : {head}. {head} :- {'; '.join(body)}.\n"
    used = [f"{name}({','.join(values)})." for name, values in facts if name in indexed.names]
    control = clingo.Control(["1"], logger=log)
    try:
        control.add("base", [], program + "\n".join(used))
        control.add("base", [], "".join(f"#defined {n}/{a + 1}. " for n, a in known))
        control.ground([("base", [])], context=_Watch(budget_s))
    except RuntimeError:
        told = _tell_unsafe(complaints) or f"cannot be answered ({'; '.join(messages)})"
        raise ValueError(told) from None
    atoms = control.symbolic_atoms.by_signature("answer", len(variables) + 1)
    return variables, [tuple(map(show_term, atom.symbol.arguments)) for atom in atoms]


def _tell_unsafe(messages: Sequence[str]) -> str:
    """Return which variables are unsafe, in words; empty if that is not the trouble."""
    found = dict.fromkeys(re.findall(r"'(\w+)' is unsafe", "\n".join(messages)))
    if not found:
        return ""
    names = ", ".join(found)
    return (
        f"unsafe: nothing says which values {names} may take; each variable must also occur in a "
        "predicate that is not negated"
    )


_INDEX = "SetOfFacts"
_LOOK_EVERY = 256


class _Watch:
    """Looks at the clock while a query is joined, which nothing else can interrupt."""

    def __init__(self, budget_s: float | None) -> None:
        self.budget_s, self.count = budget_s, 0
        self.end = None if budget_s is None else time.monotonic() + budget_s

    def tick(self, *_: Symbol) -> Symbol:
        """Count one partial answer; called by the grounder.

        Raises
        ------
        BudgetError : the budget was spent.
        """
        self.count += 1
        late = self.end is not None and self.count % _LOOK_EVERY == 1
        if late and self.end is not None and time.monotonic() > self.end:
            raise BudgetError(f"the budget of {self.budget_s:g} s was spent on the query")
        return clingo.Number(0)


class _IndexQuery(ast.Transformer):
    """Gives each atom of a query the set of facts as its first argument."""

    def __init__(self, known: set[tuple[str, int]]) -> None:
        self.known = known
        self.names: set[str] = set()
        self.variables: dict[str, None] = {}
        self.positive = False
        self.prefixes: list[tuple[str, ...]] = []

    def visit_Literal(self, node: ast.AST) -> ast.AST:  # noqa: N802
        """Check a literal; rewrite its atom."""
        if node.atom.ast_type == ast.ASTType.SymbolicAtom:
            self.positive |= node.sign == ast.Sign.NoSign
        elif node.atom.ast_type != ast.ASTType.Comparison:
            raise ValueError(f"{node} is neither an atom nor a comparison")
        changed = node.update(**self.visit_children(node))
        is_atom = node.atom.ast_type == ast.ASTType.SymbolicAtom
        if is_atom and node.sign == ast.Sign.NoSign:
            self.prefixes.append((_INDEX, *self.variables))
        return changed

    def visit_ConditionalLiteral(self, node: ast.AST) -> ast.AST:  # noqa: N802
        """Refuse conditions."""
        raise ValueError(f"{node} is neither an atom nor a comparison")

    def visit_SymbolicAtom(self, node: ast.AST) -> ast.AST:  # noqa: N802
        """Add the argument."""
        term = node.symbol
        if term.ast_type != ast.ASTType.Function:
            raise ValueError(f"{node} is no atom of a map")
        key = (term.name, len(term.arguments))
        if key not in self.known:
            arities = sorted(arity for name, arity in self.known if name == term.name)
            if arities:
                raise ValueError(
                    f"{term.name} takes {' or '.join(map(str, arities))} "
                    f"argument{'s' * (arities != [1])}, not {key[1]}"
                )
            near = get_close_matches(term.name, sorted({name for name, _ in self.known}), 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise ValueError(f"there is no predicate {key[0]}/{key[1]}{hint}")
        self.names.add(term.name)
        self.visit_children(node)
        index = ast.Variable(term.location, _INDEX)
        return node.update(symbol=term.update(arguments=[index, *term.arguments]))

    def visit_Interval(self, node: ast.AST) -> ast.AST:  # noqa: N802
        """Refuse intervals, which could be of any length."""
        raise ValueError(f"{node}: intervals are not understood; compare instead, as in V >= 1")

    def visit_Function(self, node: ast.AST) -> ast.AST:  # noqa: N802
        """Refuse calls of functions."""
        if node.external:
            raise ValueError(f"{node}: functions are not called")
        return node.update(**self.visit_children(node))

    def visit_BinaryOperation(self, node: ast.AST) -> ast.AST:  # noqa: N802
        """Refuse powers, which no number of a map needs."""
        if node.operator_type == ast.BinaryOperator.Power:
            raise ValueError(f"{node}: powers are not understood")
        return node.update(**self.visit_children(node))

    def visit_Variable(self, node: ast.AST) -> ast.AST:  # noqa: N802
        """Note a variable."""
        if node.name != "_":
            self.variables[node.name] = None
        return node
