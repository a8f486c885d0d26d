"""Boundary regions: which places of a map lie to the left and to the right of each path."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from hssh_kb.errors import BudgetError
from hssh_kb.experience import Experience
from hssh_kb.finished import claim_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.search_budget import tell_rest
from hssh_kb.solver import Symbol, solve_all, solve_minimal
from hssh_kb.theory import read_programs

_READ = (
    "along/3",
    "on/2",
    "at/2",
    "schema/3",
    "is_travel/1",
    "star_size/2",
    "opposite_dlp/3",
)
_SIDES = ("left", "right", "abnormal")
Sides = dict[str, frozenset[int]]
CHOICE_LIMIT = 1000
"""At most so many minimal choices of the abnormal places of one path are looked at."""
_MOST_VISITS = 500


@dataclass(frozen=True)
class Boundary:
    """The two boundary regions of a path, as far as the experience says.

    Attributes
    ----------
    path : (place, dlp): the path is named after its first place and the lesser of its dlps there;
        left and right are seen looking along this dlp.
    on : places on the path.
    left, right : places beside it in every minimal choice of what is abnormal.
    abnormal : places that are abnormal in some minimal choice.
    choices : how many minimal choices there are.
    complete : False if there are more than were looked at; the regions may then be too large.
    """

    path: tuple[int, int]
    on: tuple[int, ...]
    left: tuple[int, ...]
    right: tuple[int, ...]
    abnormal: tuple[int, ...]
    choices: int = 1
    complete: bool = True


def find_boundaries(
    experience: Experience,
    hypothesis: Hypothesis,
    *,
    budget_s: float | None = None,
) -> tuple[Boundary, ...]:
    """Return the boundary regions of all paths of a map, by path.

    Parameters
    ----------
    experience, hypothesis : a map of an experience.
    budget_s : seconds to spend; each path has an even share of what is left.

    Raises
    ------
    BudgetError : not one minimal choice was found in time, or the walk is longer than can be
        grounded in any.

    Source
    ------
    ``axioms/boundary.lp``, after Remolina & Kuipers 2004: abnormality is circumscribed.
    """
    if len(experience) > _MOST_VISITS:
        raise BudgetError(
            f"the sides of paths are found for up to {_MOST_VISITS} visits, there are "
            f"{len(experience)}; ask about a part of the walk"
        )
    named = read_programs(["experience", "map", "named"])
    named += claim_to_facts(experience, hypothesis)
    named += "#show. " + " ".join(f"#show {atom}." for atom in _READ)
    symbols = solve_all(named, sorted).found[0]
    facts = "".join(f"{symbol}.\n" for symbol in symbols)
    places: dict[tuple[int, int], list[int]] = {}
    for symbol in symbols:
        if symbol.name == "on":
            path, place = symbol.arguments
            first, dlp = (argument.number for argument in path.arguments)
            places.setdefault((first, dlp), []).append(place.number)
    end = None if budget_s is None else time.monotonic() + budget_s
    found = list[Boundary]()
    for name, on in sorted(places.items()):
        rest = tell_rest(end)
        share = None if rest is None else rest / (len(places) - len(found))
        found.append(_find_regions(name, tuple(sorted(on)), facts, share))
    return tuple(found)


def _find_regions(
    path: tuple[int, int], on: tuple[int, ...], facts: str, budget_s: float | None
) -> Boundary:
    """Return the regions of one path: what all minimal choices agree on."""
    program = read_programs(["boundary"]) + facts
    program += f"asked(path({path[0]},{path[1]})). #show. #show beside/3. #show abnormal/2.\n"
    found = solve_minimal(
        program, [[("abnormal", 2)]], _read_sides, limit=CHOICE_LIMIT, budget_s=budget_s
    )
    if not found.found:
        raise BudgetError(
            f"the time for the sides of path{path} was spent before one choice was found; "
            "give a longer budget"
        )
    left = frozenset.intersection(*(sides["left"] for sides in found.found))
    right = frozenset.intersection(*(sides["right"] for sides in found.found))
    abnormal = frozenset.union(*(sides["abnormal"] for sides in found.found))
    return Boundary(
        path,
        on,
        tuple(sorted(left)),
        tuple(sorted(right)),
        tuple(sorted(abnormal)),
        len(found.found),
        found.complete,
    )


def _read_sides(symbols: Sequence[Symbol]) -> Sides:
    sides: dict[str, set[int]] = {name: set() for name in _SIDES}
    for symbol in symbols:
        if symbol.name == "abnormal":
            sides["abnormal"].add(symbol.arguments[1].number)
        else:
            sides[symbol.arguments[1].name].add(symbol.arguments[2].number)
    return {name: frozenset(places) for name, places in sides.items()}
