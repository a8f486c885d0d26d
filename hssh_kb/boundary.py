"""Boundary regions: which places of a map lie to the left and to the right of each path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hssh_kb.experience import Experience
from hssh_kb.finished import claim_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.solver import Symbol, solve_all
from hssh_kb.theory import read_programs


@dataclass(frozen=True)
class Boundary:
    """The two boundary regions of a path, as far as the experience says.

    Attributes
    ----------
    path : (place, dlp): the path is named after its first place and the lesser of its dlps there;
        left and right are seen looking along this dlp.
    on : places on the path. left, right : places beside it.
    abnormal : places that would be on both sides, and so are on neither.
    """

    path: tuple[int, int]
    on: tuple[int, ...]
    left: tuple[int, ...]
    right: tuple[int, ...]
    abnormal: tuple[int, ...]


def find_boundaries(experience: Experience, hypothesis: Hypothesis) -> tuple[Boundary, ...]:
    """Return the boundary regions of all paths of a map, by path.

    Source
    ------
    ``axioms/boundary.lp``, after Remolina & Kuipers 2004.
    """
    program = read_programs(["experience", "map", "named", "boundary"])
    program += claim_to_facts(experience, hypothesis)
    program += "#show. #show on/2. #show beside/3. #show abnormal(H,both,P) : abnormal(H,P).\n"

    def convert(symbols: Sequence[Symbol]) -> dict[tuple[int, int], dict[str, list[int]]]:
        regions: dict[tuple[int, int], dict[str, list[int]]] = {}
        for symbol in sorted(symbols):
            first, second = (argument.number for argument in symbol.arguments[0].arguments[:2])
            kinds = regions.setdefault((first, second), {})
            if symbol.name == "on":
                kinds.setdefault("on", []).append(symbol.arguments[1].number)
            elif symbol.name in ("beside", "abnormal"):
                kind = symbol.arguments[1].name
                kinds.setdefault(kind, []).append(symbol.arguments[2].number)
        return regions

    regions = solve_all(program, convert).found[0]
    return tuple(
        Boundary(
            path,
            *(tuple(sorted(kinds.get(kind, ()))) for kind in ("on", "left", "right", "both")),
        )
        for path, kinds in sorted(regions.items())
    )
