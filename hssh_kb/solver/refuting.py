"""The best models of a program, some of which Python refutes, with the reason."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import clingo

from hssh_kb.solver.solving import Models, Symbol, collect_best, ground

T = TypeVar("T")
Atom = tuple[str, tuple[int, ...]]
"""Name and arguments."""
Refute = Callable[[Sequence[tuple[int, ...]]], Iterable[Sequence[tuple[Atom, bool]]]]


class _Refuter(clingo.Propagator):
    """Asks Python about each complete assignment, and learns from its answer."""

    def __init__(self, shown: tuple[str, int], spoken: tuple[str, int], refute: Refute) -> None:
        self.shown, self.spoken, self.refute = shown, spoken, refute
        self._literals: dict[Atom, int] = {}
        self._shown: list[tuple[tuple[int, ...], int]] = []

    def init(self, init: clingo.PropagateInit) -> None:
        """Note the literals of the atoms that are looked at."""
        init.check_mode = clingo.PropagatorCheckMode.Total
        for name, arity in (self.shown, self.spoken):
            for atom in init.symbolic_atoms.by_signature(name, arity):
                arguments = tuple(argument.number for argument in atom.symbol.arguments)
                literal = init.solver_literal(atom.literal)
                self._literals[name, arguments] = literal
                if name == self.shown[0]:
                    self._shown.append((arguments, literal))

    def check(self, control: clingo.PropagateControl) -> None:
        """Refute a complete assignment, or let it pass."""
        is_true = control.assignment.is_true
        for together in self.refute([atom for atom, literal in self._shown if is_true(literal)]):
            nogood = []
            for atom, truth in together:
                literal = self._literals.get(atom)
                if literal is not None:
                    nogood.append(literal if truth else -literal)
            if not control.add_nogood(nogood):
                return


def solve_best_refuting(
    program: str,
    convert: Callable[[Sequence[Symbol]], T | None],
    shown: tuple[str, int],
    spoken: tuple[str, int],
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
    shown, spoken : name and arity of the atoms that are looked at, and of those that reasons
        speak of; their arguments are numbers. Models are told apart by what they show.
    refute : is given the arguments of the shown atoms that are true; it returns reasons against
        them, none if they may stand: atoms with truth values that they cannot have together. An
        atom that there is not is false.
    options : further options of the solver.
    """
    begin = time.monotonic()
    control = ground(program, ["0", "--opt-mode=optN", "--project=show", *options])
    control.register_propagator(_Refuter(shown, spoken, refute))
    rest = None if budget_s is None else budget_s - (time.monotonic() - begin)
    return collect_best(control, convert, limit, rest)
