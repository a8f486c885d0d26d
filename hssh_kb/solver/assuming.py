"""One program, grounded once, solved again and again under other assumptions."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

import clingo

from hssh_kb.solver.solving import Symbol, ground, run_solver


class AssumingSolver:
    """Solves a program while some of its atoms are assumed to be true.

    Parameters
    ----------
    program : text of the program, grounded at once.
    """

    def __init__(self, program: str) -> None:
        self._control = ground(program, ["1"])
        self._literals: dict[str, int] = {
            str(atom.symbol): atom.literal for atom in self._control.symbolic_atoms
        }

    def solve(
        self, atoms: Iterable[str], end: float | None = None
    ) -> tuple[Sequence[Symbol] | None, bool]:
        """Return the shown symbols of a model in which atoms are true, and whether it is certain.

        Parameters
        ----------
        atoms : to be true; one that nothing derives cannot be.
        end : instant (``time.monotonic``) at which to give up.

        Returns
        -------
        (symbols, or None if there is no model; False if the time ran out first).
        """
        assumed = []
        for atom in atoms:
            literal = self._literals.get(atom)
            if literal is None:
                return None, True
            assumed.append(literal)
        found: list[Sequence[Symbol]] = []

        def note(model: clingo.Model) -> bool:
            found.append(model.symbols(shown=True))
            return False

        rest = None if end is None else max(end - time.monotonic(), 0.0)
        result = run_solver(self._control, note, rest, assumed)
        return (found[0] if found else None), result.satisfiable is not None
