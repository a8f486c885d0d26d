"""What witnesses are made of: a question to some files, put to the solver, and its answer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from clauses import Read

from hssh_kb.solver import Symbol, solve_all, solve_best, solve_minimal
from hssh_kb.theory import axiom_program, list_axioms

MOST = 400
"""More answers than any witness has; a clause taken out may let in very many."""


@dataclass(frozen=True)
class Witness:
    """A question to some files.

    Attributes
    ----------
    name : what is asked. files : the top files read; what they include counts as well.
    ask : takes what reads files, returns the answer. expected : the right answer.
    """

    name: str
    files: tuple[str, ...]
    ask: Callable[[Read], Any]
    expected: Any

    def fails(self, read: Read) -> bool:
        """Whether the theory, as read, answers wrongly, or not at all."""
        return bool(self.ask(read) != self.expected)


def show(symbols: Sequence[Symbol]) -> tuple[str, ...]:
    return tuple(sorted(map(str, symbols)))


def axioms_but(*left_out: str) -> list[str]:
    return [axiom_program(a.name) for a in list_axioms() if a.name not in left_out]


def make_witness(
    name: str,
    files: Iterable[str],
    facts: str,
    expected: Any,
    solve: Callable[[str], Any],
) -> Witness:
    tops = tuple(files)
    return Witness(name, tops, lambda read: solve(read(tops) + "\n" + facts), expected)


def list_clauses(program: str) -> list[tuple[str, ...]]:
    """The clauses violated in the best models; where faces are guessed there are several."""
    names = [
        [_name(s) for s in model]
        for model in solve_best(program + _COUNTED, list, limit=MOST).found
    ]
    return sorted({tuple(sorted(set(clauses))) for clauses in names})


def _name(symbol: Symbol) -> str:
    """Axiom and clause of a violation; anything else as it is."""
    if symbol.name != "violation":
        return str(symbol)
    return f"{symbol.arguments[0]}:{symbol.arguments[1].name}"


_COUNTED = "\n#minimize { 0@8 : #true }.\n"
"""So that the solver has something to prove least, even where no violation is possible."""


def list_maps(program: str) -> list[tuple[str, ...]]:
    return sorted(solve_all(program, show, limit=MOST).found)


def list_best(program: str) -> tuple[list[tuple[str, ...]], int]:
    models = solve_best(program, show, limit=MOST)
    return sorted(models.found), len(models.cost)


def count_levels(program: str) -> int:
    return len(solve_best(program, show, limit=MOST).cost)


def minimal_by(levels: Any) -> Callable[[str], list[tuple[str, ...]]]:
    return lambda program: sorted(solve_minimal(program, levels, show, limit=MOST).found)


def is_dear(program: str) -> bool:
    """Whether the best models violate anything."""
    return any(find_cost(program))


def find_cost(program: str) -> tuple[int, ...]:
    return solve_best(program, show, limit=MOST).cost


def find_sides(program: str) -> tuple[list[int], list[int], list[int], int]:
    found = solve_minimal(program, [[("abnormal", 2)]], list, limit=MOST).found
    sides = [
        {
            name: {s.arguments[2].number for s in m if str(s.arguments[1]) == name}
            for name in ("left", "right")
        }
        for m in ([s for s in m if s.name == "beside"] for m in found)
    ]
    odd = {s.arguments[1].number for m in found for s in m if s.name == "abnormal"}
    left = set.intersection(*(side["left"] for side in sides)) if sides else set()
    right = set.intersection(*(side["right"] for side in sides)) if sides else set()
    return sorted(left), sorted(right), sorted(odd), len(found)
