"""The one seam to clingo: programs in, plain Python out, with budgets in models and seconds."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import clingo
import clingo.backend
from clingo import ast

from hssh_kb.errors import InternalError

Symbol = clingo.Symbol
Control = clingo.Control
T = TypeVar("T")
_POLL_S = 0.2


@dataclass(frozen=True)
class Models(Generic[T]):
    """What a solver call found.

    Attributes
    ----------
    found : the converted models.
    complete : False if a budget ended the search.
    cost : cost vector of the optimum, highest priority first; empty without optimisation.
    """

    found: tuple[T, ...]
    complete: bool
    cost: tuple[int, ...] = ()


def ground(program: str, options: Sequence[str] = ()) -> Control:
    """Ground a program.

    Raises
    ------
    InternalError : clingo has a message about it; every program of ours grounds in silence.
    """
    messages: list[str] = []
    control = clingo.Control(list(options), logger=lambda _, text: messages.append(text.strip()))
    try:
        control.add("base", [], program)
        control.ground([("base", [])])
    except RuntimeError as error:
        raise InternalError(
            f"the program does not ground: {'; '.join(messages)} ({error})"
        ) from None
    if messages:
        raise InternalError(f"the program grounds with messages: {'; '.join(messages)}")
    return control


class _Collector(Generic[T]):
    """Collects converted models until a limit."""

    def __init__(self, convert: Callable[[Sequence[Symbol]], T | None], limit: int | None) -> None:
        self.convert, self.limit = convert, limit
        self.found: list[T] = []
        self.cost: tuple[int, ...] = ()
        self.optimising = False

    def __call__(self, model: clingo.Model) -> bool:
        if self.optimising:
            if tuple(model.cost) != self.cost:
                self.found.clear()
                self.cost = tuple(model.cost)
            elif not model.optimality_proven:
                return True
            elif self.found and not self.proven:
                self.found.clear()
            self.proven = model.optimality_proven
        converted = self.convert(model.symbols(shown=True))
        if converted is not None:
            self.found.append(converted)
        return self.limit is None or len(self.found) < self.limit

    proven = False


def _run(
    control: Control,
    on_model: Callable[[clingo.Model], bool],
    budget_s: float | None,
    assumptions: Sequence[int] = (),
) -> clingo.SolveResult:
    """Solve in the background, so that a budget or Ctrl-C can end it."""
    end = None if budget_s is None else time.monotonic() + budget_s
    with control.solve(assumptions, on_model=on_model, async_=True) as handle:
        while True:
            rest = _POLL_S if end is None else min(_POLL_S, end - time.monotonic())
            if handle.wait(max(rest, 0)):
                break
            if end is not None and time.monotonic() >= end:
                handle.cancel()
                break
        result: clingo.SolveResult = handle.get()
        return result


def solve_all(
    program: str,
    convert: Callable[[Sequence[Symbol]], T | None],
    *,
    limit: int | None = None,
    budget_s: float | None = None,
    options: Sequence[str] = (),
) -> Models[T]:
    """Enumerate the models of a program.

    Parameters
    ----------
    program : text of the program.
    convert : turns the shown symbols of a model into what is collected; None is left out.
    limit : at most so many models.
    budget_s : at most so many seconds, grounding included.
    """
    begin = time.monotonic()
    control = ground(program, ["0", *options])
    collect = _Collector(convert, None if limit is None else limit + 1)
    rest = None if budget_s is None else budget_s - (time.monotonic() - begin)
    result = _run(control, collect, rest)
    complete = bool(result.exhausted) and not result.interrupted
    if limit is not None and len(collect.found) > limit:
        del collect.found[limit:]
        complete = False
    return Models(tuple(collect.found), complete)


def solve_best(
    program: str,
    convert: Callable[[Sequence[Symbol]], T | None],
    *,
    limit: int | None = None,
    budget_s: float | None = None,
) -> Models[T]:
    """Enumerate the optimal models of a program, each once, with their common cost."""
    begin = time.monotonic()
    control = ground(program, ["0", "--opt-mode=optN"])
    collect = _Collector(convert, None if limit is None else limit + 1)
    collect.optimising = True
    rest = None if budget_s is None else budget_s - (time.monotonic() - begin)
    result = _run(control, collect, rest)
    complete = bool(result.exhausted) and not result.interrupted
    if limit is not None and len(collect.found) > limit:
        del collect.found[limit:]
        complete = False
    return Models(tuple(collect.found), complete, collect.cost)


def is_satisfiable(program: str, budget_s: float | None = None) -> bool | None:
    """Return whether a program has a model; None if the budget ran out first."""
    begin = time.monotonic()
    control = ground(program, ["1"])
    rest = None if budget_s is None else budget_s - (time.monotonic() - begin)
    result = _run(control, lambda _: False, rest)
    return None if result.satisfiable is None else bool(result.satisfiable)


class _MinimalSets(Generic[T]):
    """Enumerates the models that are subset-minimal level by level.

    The domain heuristic makes the first model of every call minimal: it decides the atoms of the
    levels first, and decides them false.
    """

    def __init__(
        self,
        control: Control,
        levels: Sequence[Sequence[tuple[str, int]]],
        convert: Callable[[Sequence[Symbol]], T | None],
        limit: int | None,
        end: float | None,
    ) -> None:
        self.control, self.convert, self.limit, self.end = control, convert, limit, end
        self.found: list[T] = []
        self.complete = True
        self.levels = [
            [
                atom.literal
                for name, arity in level
                for atom in control.symbolic_atoms.by_signature(name, arity)
                if not atom.is_fact
            ]
            for level in levels
        ]
        with control.backend() as backend:
            for rank, literals in enumerate(self.levels):
                for literal in literals:
                    weight = len(self.levels) - rank
                    backend.add_heuristic(
                        literal, clingo.backend.HeuristicType.Level, weight, 1, []
                    )
                    backend.add_heuristic(literal, clingo.backend.HeuristicType.Sign, -1, 1, [])

    def collect(self, rank: int, fixed: list[int]) -> None:
        """Collect the models that are minimal from level ``rank`` on, given ``fixed`` literals."""
        if rank == len(self.levels):
            self._collect_all(fixed)
            return
        with self.control.backend() as backend:
            context = backend.add_atom()
            backend.add_rule([context], [], choice=True)
        while self.complete:
            true = self._find_first(rank, [*fixed, context])
            if true is None:
                break
            exact = [x if x in true else -x for x in self.levels[rank]]
            self.collect(rank + 1, [*fixed, context, *exact])
            with self.control.backend() as backend:
                backend.add_rule([], [context, *sorted(true)])
        with self.control.backend() as backend:
            backend.add_rule([], [context])

    def _solve(
        self, fixed: list[int], models: int, on_model: Callable[[clingo.Model], bool]
    ) -> bool:
        solve = self.control.configuration.solve
        solve.models = models  # type: ignore[union-attr]
        rest = None if self.end is None else self.end - time.monotonic()
        result = _run(self.control, on_model, rest, fixed)
        if result.interrupted:
            self.complete = False
        return bool(result.satisfiable)

    def _find_first(self, rank: int, fixed: list[int]) -> set[int] | None:
        true: set[int] = set()

        def note(model: clingo.Model) -> bool:
            true.update(x for x in self.levels[rank] if model.is_true(x))
            return False

        return true if self._solve(fixed, 1, note) else None

    def _collect_all(self, fixed: list[int]) -> None:
        def note(model: clingo.Model) -> bool:
            if self.limit is not None and len(self.found) >= self.limit:
                self.complete = False
                return False
            converted = self.convert(model.symbols(shown=True))
            if converted is not None:
                self.found.append(converted)
            return True

        self._solve(fixed, 0, note)


def solve_minimal(
    program: str,
    levels: Sequence[Sequence[tuple[str, int]]],
    convert: Callable[[Sequence[Symbol]], T | None],
    *,
    limit: int | None = None,
    budget_s: float | None = None,
) -> Models[T]:
    """Enumerate the models that are subset-minimal under priorities (circumscription).

    Parameters
    ----------
    program : text of the program.
    levels : predicates (name, arity) to be minimised, highest priority first; all else varies.
    convert, limit, budget_s : as in :func:`solve_all`.

    Source
    ------
    Ours; a plain domain-recording enumeration is wrong under priorities.
    """
    end = None if budget_s is None else time.monotonic() + budget_s
    control = ground(program, ["--heuristic=Domain"])
    minimal = _MinimalSets(control, levels, convert, limit, end)
    minimal.collect(0, [])
    return Models(tuple(minimal.found), minimal.complete)


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
