"""May these observations and assumptions hold together? Asked of the axiom files themselves.

The twin of :mod:`hssh_kb.oracle` for axioms that are not the packaged ones: slower, and right
whatever the rules say. What is trusted is assumed in one ground program.
"""

from __future__ import annotations

from collections.abc import Sequence

from hssh_kb.congruence import Assumption
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.oracle import Literal, assumption_facts, list_literals
from hssh_kb.program import blame_variant, has_alternatives, make_converter, variant_program
from hssh_kb.solver import AssumingSolver
from hssh_kb.subsets import OutOfTimeError
from hssh_kb.variant import Variant


class ProgramOracle:
    """Answers whether a set of literals has a map under a variant of the theory.

    Parameters
    ----------
    experience, assumptions : what was lived through and what is supposed.
    variant : the axioms.
    planarity : whether this axiom holds.
    end : instant (``time.monotonic``) at which to give up.

    Raises
    ------
    InputError : axioms of one's own that cannot be grounded.
    """

    def __init__(
        self,
        experience: Experience,
        assumptions: Sequence[Assumption],
        variant: Variant,
        *,
        planarity: bool = True,
        end: float | None = None,
    ) -> None:
        self.experience, self.assumptions, self.end = experience, assumptions, end
        self._convert = make_converter(len(experience), has_alternatives(experience))
        program = variant_program(
            experience, variant, planarity=planarity, mode="modes/guarded", further=["assume"]
        )
        doubtable = [f"doubtable({_name(x)})." for x in self.literals()]
        facts = assumption_facts(enumerate(assumptions))
        with blame_variant(variant):
            self._solver = AssumingSolver("\n".join([program, *doubtable, facts]))

    def literals(self) -> list[Literal]:
        """Return all literals, those near the assumptions first."""
        return list_literals(self.experience, self.assumptions)

    def consistent(self, active: frozenset[Literal]) -> bool:
        """Return whether some map agrees with these literals.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        """
        return self.find_map(active) is not None

    def find_map(self, active: frozenset[Literal]) -> Hypothesis | None:
        """Return some map that agrees with these literals, or None if there is none.

        Raises
        ------
        OutOfTimeError : the budget ran out.
        """
        atoms = [f"trusted({_name(x)})" for x in sorted(active)]
        symbols, certain = self._solver.solve(atoms, self.end)
        if not certain:
            raise OutOfTimeError
        return None if symbols is None else self._convert(symbols)


def _name(literal: Literal) -> str:
    return f"{literal.kind}({literal.number})"
