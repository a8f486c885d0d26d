"""Models that are subset-minimal under priorities: circumscription."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import clingo
import clingo.backend

from hssh_kb.solver.solving import Control, Models, Symbol, ground, run_solver

T = TypeVar("T")


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
        result = run_solver(self.control, on_model, rest, fixed)
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
