"""Solving: all models, the best ones, or whether there is any; with budgets."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import clingo

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


def run_solver(
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
    result = run_solver(control, collect, rest)
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
    rest = None if budget_s is None else budget_s - (time.monotonic() - begin)
    return collect_best(control, convert, limit, rest)


def collect_best(
    control: Control,
    convert: Callable[[Sequence[Symbol]], T | None],
    limit: int | None,
    budget_s: float | None,
) -> Models[T]:
    """Enumerate the optimal models of what is ground, each once, with their common cost."""
    collect = _Collector(convert, None if limit is None else limit + 1)
    collect.optimising = True
    result = run_solver(control, collect, budget_s)
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
    result = run_solver(control, lambda _: False, rest)
    return None if result.satisfiable is None else bool(result.satisfiable)
