"""A claimed map of an experience, read from the document that ``hssh maps --json`` prints.

Source: ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

from hssh_kb.check import Check, check
from hssh_kb.consistency import MapState
from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, hold_types
from hssh_kb.text_files import parse_json, read_text
from hssh_kb.variant import Variant

_EXPECTED = "a document of schema hssh.maps/1 ('hssh maps --json')"
_MOST_STEPS = 30_000
"""At most so many ways to turn and to read the stars of a claimed map are tried."""
_HINTS = "offsets", "readings"


class Claim(NamedTuple):
    """Which visit is which place, and what is not to be believed.

    Attributes
    ----------
    places : for each visit the first visit of its place.
    doubted : travels, by the visit they lead to, that the map does not believe.
    offsets, readings : how each star is turned and read, as hints; both empty if not told.
    """

    places: tuple[int, ...]
    doubted: frozenset[int] = frozenset()
    offsets: tuple[int, ...] = ()
    readings: tuple[int, ...] = ()


def read_claim(path: str | Path, number: int = 1) -> Claim:
    """Read which visit is which place in a map of a ``hssh.maps/1`` document.

    Parameters
    ----------
    path : a JSON file, printed by ``hssh maps`` and edited, or written by another program; a map
        must have ``visits`` and may have ``doubted``, ``offsets`` and ``readings``.
    number : the line of the map in its ``maps``, from 1.

    Raises
    ------
    InputError : the file cannot be read or breaks the format, or holds no such map.
    """
    data = parse_json(read_text(path, _EXPECTED), str(path), _EXPECTED)
    maps = data.get("maps") if isinstance(data, dict) else None
    if not isinstance(maps, list) or data.get("schema") != "hssh.maps/1":
        raise InputError(f"{path}: expected {_EXPECTED}")
    if not 1 <= number <= len(maps):
        raise InputError(f"{path}: there is no map {number}, it holds {len(maps)}")
    row, where = maps[number - 1], f"{path}: map {number}"
    places = _read_places(row, where)
    doubted = row.get("doubted", [])
    known = {f"v{v}": v for v in range(1, len(places))}
    if not isinstance(doubted, list) or not all(isinstance(v, str) and v in known for v in doubted):
        raise InputError(
            f'{where}: expected "doubted", the travels not believed, as the visits they lead to, '
            'such as "v3"'
        )
    offsets, readings = (_read_hints(row, name, len(places), where) for name in _HINTS)
    return Claim(places, frozenset(known[v] for v in doubted), offsets, readings)


def _read_hints(row: dict[str, Any], name: str, visits: int, where: str) -> tuple[int, ...]:
    hints = row.get(name, [])
    whole = isinstance(hints, list) and all(type(hint) is int for hint in hints)
    if not whole or len(hints) not in (0, visits):
        raise InputError(f'{where}: expected "{name}", a whole number for each visit')
    return tuple(hints)


def _read_places(row: Any, where: str) -> tuple[int, ...]:  # noqa: ANN401
    labels = row.get("visits") if isinstance(row, dict) else None
    if not isinstance(labels, list) or not labels:
        raise InputError(f'{where}: expected "visits", the place of each visit such as "P0"')
    places = list[int]()
    for v, label in enumerate(labels):
        digits = label.removeprefix("P") if isinstance(label, str) else ""
        if not (digits.isascii() and digits.isdecimal()) or int(digits) > v:
            raise InputError(
                f"{where}: visit {v} is at {label!r}, expected P and the number of the first "
                f"visit to that place, at most P{v}"
            )
        places.append(int(digits))
        if places[places[v]] != places[v]:
            raise InputError(
                f"{where}: visit {v} is at {label}, but visit {digits} is not the first there"
            )
    return tuple(places)


def list_assumptions(places: Sequence[int]) -> list[str]:
    """Return claimed places as assumptions for :func:`hssh_kb.check.check`.

    Parameters
    ----------
    places : for each visit the first visit of its place.

    Examples
    --------
    >>> list_assumptions((0, 1, 0))
    ['v2=v0', 'v1!=v0']
    """
    same = [f"v{v}=v{first}" for v, first in enumerate(places) if first != v]
    return same + [f"v{b}!=v{a}" for a, b in combinations(sorted(set(places)), 2)]


def check_claim(
    experience: Experience,
    claim: Claim,
    *,
    budget_s: float | None = None,
    variant: Variant | None = None,
) -> Check:
    """Say whether a claimed map is one of an experience; if not, why not.

    A claim that holds once the travels it doubts are left out holds; of any other, the reasons
    take all travels for true.

    Raises
    ------
    InputError : the claim is of another number of visits.

    Source
    ------
    Ours.
    """
    visits = len(experience)
    if len(claim.places) != visits:
        raise InputError(
            f"the claimed map is of {len(claim.places)} visits, the experience has {visits}"
        )
    if variant is not None and not variant.is_plain:
        supposed = list_assumptions(claim.places)
        return check(experience, supposed, budget_s=budget_s, variant=variant)
    experience = hold_types(experience)
    reached, sure = find_clash(experience, claim)
    if reached == visits:
        told = "The claimed map violates no axiom: it is a map of this experience"
        if claim.doubted:
            names = ", ".join(experience.visit_label(v) for v in sorted(claim.doubted))
            told += f", if the travels to {names} are doubted, as it says"
        return Check(True, (), (), "consistent", f"{told}.")
    if claim.doubted:
        reached, sure = find_clash(experience, claim._replace(doubted=frozenset()))
    begun = replace(experience, visits=experience.visits[: reached + 1])
    answer = check(begun, list_assumptions(claim.places[: reached + 1]), budget_s=budget_s)
    if answer.status != "consistent" or sure:
        return answer
    return check(experience, list_assumptions(claim.places), budget_s=budget_s)


def find_clash(experience: Experience, claim: Claim) -> tuple[int, bool]:
    """Return how far the axioms let a claimed map go, whichever way its stars are turned and read.

    Far quicker than :func:`hssh_kb.check.check` on a long walk, as the places are all claimed;
    the reasons are then to be sought among the visits up to the clash.

    Returns
    -------
    reached : the first visit that no way tried of turning and reading the stars reaches; the
        number of visits if the claim holds.
    sure : whether all ways were tried, or one was enough.

    Source
    ------
    Ours.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> bend = ["a+1", "b+1", "a-0", "b-0"]
    >>> walk = make_experience([(bend, None, 0), (bend, 3, 0), (bend, 3, None)])
    >>> find_clash(walk, Claim((0, 1, 2))), find_clash(walk, Claim((0, 1, 1)))
    ((3, True), (2, True))
    """
    number = {first: n for n, first in enumerate(sorted(set(claim.places)))}
    waiting = list[_Step]()
    for i, reading in enumerate(experience.visits[0].readings):
        waiting.append(_Step(0, MapState.start(reading.star), ((0, i),)))
    waiting.sort(key=lambda step: _agrees(claim, step))
    reached = 0
    for _ in range(_MOST_STEPS):
        if not waiting:
            return reached, True
        step = waiting.pop()
        reached = max(reached, step.visit + 1)
        if reached == len(claim.places):
            return reached, True
        steps = _take_visit(experience, claim, number, step)
        waiting += sorted(steps, key=lambda step: _agrees(claim, step))
    return reached, False


class _Step(NamedTuple):
    """A map of the first visits: its state, the offset and the reading of each visit."""

    visit: int
    state: MapState
    taken: tuple[tuple[int, int], ...]


def _agrees(claim: Claim, step: _Step) -> tuple[bool, bool, int]:
    """Return how well the latest visit is turned and read as the claim says; its best reading."""
    v, (offset, reading) = step.visit, step.taken[-1]
    read = bool(claim.readings) and claim.readings[v] == reading
    return read, bool(claim.offsets) and claim.offsets[v] == offset, -reading


def _take_visit(
    experience: Experience, claim: Claim, number: dict[int, int], step: _Step
) -> Iterator[_Step]:
    """Yield the maps with one visit more, at the place claimed."""
    v = step.visit + 1
    first, turned, read = claim.places[v], *step.taken[-1]
    before = experience.visits[v - 1].readings[read]
    if before.depart is None:
        raise InputError(f"visit {v - 1}: lacks 'depart', the dlp left along")
    depart = (before.depart + turned) % len(before.star)
    for i, reading in enumerate(experience.visits[v].readings):
        if reading.arrive is None:
            raise InputError(f"visit {v}: lacks 'arrive', the dlp faced on arrival")
        state, offsets = step.state, tuple[int, ...]((0,))
        if first == v:
            state = state.add_place(reading.star)
        else:
            offsets = reading.isomorphisms(experience.visits[first].readings[step.taken[first][1]])
        for offset in offsets:
            gateway = (reading.star.opposite(reading.arrive) + offset) % len(reading.star)
            ends = number[claim.places[v - 1]], depart, number[first], gateway
            if v in claim.doubted:
                yield _Step(v, state, (*step.taken, (offset, i)))
            elif state.find_refusal(*ends) is None:
                yield _Step(v, state.join(*ends, v), (*step.taken, (offset, i)))
