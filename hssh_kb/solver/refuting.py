"""The best models of a program, some of which Python refutes, with the reason."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import clingo

from hssh_kb.solver.solving import Models, Symbol, collect_best, ground

T = TypeVar("T")
Refute = Callable[[Sequence[Symbol]], Iterable[Symbol] | None]


class _Refuter(clingo.Propagator):
    """Asks Python about each complete assignment, and learns from its answer."""

    def __init__(self, name: str, arity: int, refute: Refute) -> None:
        self.name, self.arity, self.refute = name, arity, refute
        self._literals: dict[Symbol, int] = {}

    def init(self, init: clingo.PropagateInit) -> None:
        """Note the literals of the atoms that are looked at."""
        init.check_mode = clingo.PropagatorCheckMode.Total
        for atom in init.symbolic_atoms.by_signature(self.name, self.arity):
            self._literals[atom.symbol] = init.solver_literal(atom.literal)

    def check(self, control: clingo.PropagateControl) -> None:
        """Refute a complete assignment, or let it pass."""
        is_true = control.assignment.is_true
        together = self.refute([s for s, literal in self._literals.items() if is_true(literal)])
        if together is not None:
            control.add_nogood([self._literals[symbol] for symbol in together])


def solve_best_refuting(
    program: str,
    convert: Callable[[Sequence[Symbol]], T | None],
    signature: tuple[str, int],
    refute: Refute,
    *,
    limit: int | None = None,
    budget_s: float | None = None,
    options: Sequence[str] = (),
) -> Models[T]:
    """Enumerate the optimal ones of those models that are not refuted, with their common cost.

    Parameters
    ----------
    program, convert, limit, budget_s : as in :func:`hssh_kb.solver.solve_best`.
    signature : name and arity of the atoms that are looked at; models are told apart by what is
        shown.
    refute : is given those that are true, and returns None, or some of them that can not be true
        together.
    options : further options of the solver.
    """
    begin = time.monotonic()
    control = ground(program, ["0", "--opt-mode=optN", "--project=show", *options])
    control.register_propagator(_Refuter(*signature, refute))
    rest = None if budget_s is None else budget_s - (time.monotonic() - begin)
    return collect_best(control, convert, limit, rest)
