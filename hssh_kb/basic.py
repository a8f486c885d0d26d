"""The basic SSH: experience as views and actions, where every action may lead anywhere.

It is the theory that the hybrid one is measured by: there a star tells all turns at once, here
each turn, too, may end at a dstate that was known or at a new one.
"""

from __future__ import annotations

import json
import time
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from hssh_kb.basic_tree import BasicTree
from hssh_kb.errors import InputError, UsageError
from hssh_kb.experience import Experience
from hssh_kb.solver import Symbol, solve_all
from hssh_kb.text_files import parse_json, read_text
from hssh_kb.theory import axiom_program, read_programs
from hssh_kb.trace import SCHEMA
from hssh_kb.variant import list_changes
from perception.files import looks_like_json

TRAVEL, TURN_AROUND, FREE_TURN = "travel", "turn around", "turn"
_AXIOMS = (
    "dstate_unique",
    "order_irreflexive",
    "travel_function",
    "dstate_identity",
    "view_function",
)
"""Equations 2 to 7, 9 and 10 hold by the way places, paths and orders follow from the dstates."""


@dataclass(frozen=True)
class BasicExperience:
    """An alternating sequence of views and actions.

    Attributes
    ----------
    views : one symbol a moment.
    actions : what was done between moments; one fewer. "travel", "turn around", "turn" (free:
        where to is not known), and any other text that begins with "turn", such as "turn right".
    source : where it came from, for messages.

    Source
    ------
    Beeson, Modayil & Kuipers 2010, section 3.2.
    """

    views: tuple[str, ...]
    actions: tuple[str, ...]
    source: str = ""


def is_basic_trace(path: str | Path) -> bool:
    """Say by content whether a file is a trace of kind "basic"; False if it cannot be read."""
    if not looks_like_json(path):
        return False
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and data.get("kind") == "basic"


def load_basic_trace(path: str | Path) -> BasicExperience:
    """Read a ``hssh.trace/1`` file of kind "basic".

    Raises
    ------
    InputError : it cannot be read or breaks the format; all faults at once.
    """
    expected = f"a basic trace (JSON, schema {SCHEMA})"
    data = parse_json(read_text(path, expected), str(path), expected)
    return basic_experience_from_data(data, str(path))


def basic_experience_from_data(data: Any, source: str = "trace") -> BasicExperience:  # noqa: ANN401
    """Check a decoded trace of kind "basic".

    Raises
    ------
    InputError : breaks the format; all faults at once.

    Examples
    --------
    >>> trace = {"schema": "hssh.trace/1", "kind": "basic", "views": ["T", "L"],
    ...          "actions": ["travel"]}
    >>> basic_experience_from_data(trace).actions
    ('travel',)
    """
    if not isinstance(data, dict) or data.get("schema") != SCHEMA or data.get("kind") != "basic":
        raise InputError(f'{source}: expected "schema": "{SCHEMA}" and "kind": "basic"')
    views, actions = data.get("views"), data.get("actions")
    faults = []
    if not isinstance(views, list) or not views or not all(isinstance(w, str) for w in views):
        faults.append("'views' must be a list of at least one symbol (text)")
    if not isinstance(actions, list):
        faults.append("'actions' must be a list of texts")
    else:
        faults += [
            f"action {i}: {a!r} is not '{TRAVEL}' and does not begin with 'turn'"
            for i, a in enumerate(actions)
            if not isinstance(a, str) or not (a == TRAVEL or a.startswith("turn"))
        ]
        if isinstance(views, list) and len(actions) != len(views) - 1:
            faults.append(
                f"{len(views)} views need {len(views) - 1} actions between them, "
                f"found {len(actions)}"
            )
    if faults or not isinstance(views, list) or not isinstance(actions, list):
        raise InputError(f"{source}: {'; '.join(faults[:10])}")
    return BasicExperience(tuple(views), tuple(actions), source)


def forget_stars(experience: Experience, *, look_around: bool = False) -> BasicExperience:
    """Return what a robot of the basic SSH lives through on the same drive.

    Its view is what the star looks like from the dlp it faces; a turn is named by how many dlps
    further, clockwise, it faces then.

    Parameters
    ----------
    experience : the drive.
    look_around : at each place the robot first turns from dlp to dlp, clockwise, back to the one
        it faced: the way to see there what a star tells at once.
    """
    views, actions = list[str](), list[str]()
    for visit in experience.visits:
        star, size = visit.star, len(visit.star)
        facing = [k for k in (visit.arrive, visit.depart) if k is not None]
        if look_around and facing:
            facing[:0] = [(facing[0] + i) % size for i in range(size)]
        facing = [k for i, k in enumerate(facing) if not i or k != facing[i - 1]]
        for one, other in pairwise(facing):
            around = other == star.opposite(one)
            actions.append(TURN_AROUND if around else f"turn {(other - one) % size}")
        for k in facing:
            seen = [
                f"{star.alpha[(k + i) % size]}{(star.opposite((k + i) % size) - k - i) % size}"
                for i in range(size)
            ]
            views.append(" ".join(seen))
        if visit.depart is not None:
            actions.append(TRAVEL)
    return BasicExperience(tuple(views), tuple(actions[: len(views) - 1]), experience.source)


def basic_facts(experience: BasicExperience) -> str:
    """Return the facts of a basic experience, for ``axioms/basic.lp``."""
    symbols = {view: i for i, view in enumerate(sorted(set(experience.views)))}
    lines = [f"view({i},{symbols[view]})." for i, view in enumerate(experience.views)]
    names = {a: i for i, a in enumerate(sorted(set(experience.actions) - {FREE_TURN}))}
    for i, action in enumerate(experience.actions):
        # A free turn is another action each time: nothing says that it ends alike.
        name = f"free({i})" if action == FREE_TURN else f"act({names[action]})"
        lines.append(f"did({i},{name},{i + 1}).")
        if action == TRAVEL:
            lines.append(f"is_travel({name}).")
        else:
            lines.append(f"is_turn({name}).")
            if action == TURN_AROUND:
                lines.append(f"is_turn_around({name}).")
    return "\n".join(lines) + "\n"


def write_basic_instance(experience: BasicExperience) -> str:
    """Return a stand-alone ``.lp`` instance, to be run with ``basic_maps.lp`` by stock clingo."""
    head = f"% Experience of {len(experience.views)} moments in the basic SSH"
    head += f" from {experience.source}" if experience.source else ""
    run = "% All maps: python -m clingo AXIOMS/basic_maps.lp THIS_FILE 0"
    where = "% where AXIOMS is the directory of the axioms; its README.md says more."
    lines = [head.replace("\n", " "), run, where, "", basic_facts(experience)]
    return "\n".join(lines)


def enumerate_basic_maps(
    experience: BasicExperience,
    *,
    order: bool = True,
    limit: int | None = None,
    budget_s: float | None = None,
    engine: str = "tree",
) -> tuple[tuple[tuple[int, ...], ...], bool]:
    """Find all maps of a basic experience.

    Parameters
    ----------
    experience : views and actions.
    order : whether axiom 8 holds.
    limit, budget_s : at most so many maps and seconds.
    engine : "program" asks the solver; "tree" grows the same maps sooner.

    Returns
    -------
    (maps, complete) : a map gives for each moment the first moment at the same dstate.

    Source
    ------
    Beeson 2008, Algorithm 3.1.
    """
    if engine not in ("tree", "program"):
        raise UsageError(f"the engine is 'tree' or 'program', not {engine!r}")
    if engine == "tree" and not list_changes():
        end = None if budget_s is None else time.monotonic() + budget_s
        tree = make_basic_tree(experience, order=order, limit=limit, end=end)
        complete = tree.run()
        return tuple(sorted(tree.found)), complete
    axioms = [name for name in _AXIOMS if order or name != "order_irreflexive"]
    program = read_programs(
        ["basic", *map(axiom_program, axioms), "modes/strict", "show_basic"]
    ) + basic_facts(experience)
    count = len(experience.views)

    def convert(symbols: Sequence[Symbol]) -> tuple[int, ...]:
        dstates = list(range(count))
        for symbol in symbols:
            moment, first = symbol.arguments
            dstates[moment.number] = first.number
        return tuple(dstates)

    models = solve_all(program, convert, limit=limit, budget_s=budget_s)
    return tuple(sorted(models.found)), models.complete


def make_basic_tree(
    experience: BasicExperience,
    *,
    order: bool = True,
    limit: int | None = None,
    end: float | None = None,
) -> BasicTree:
    """Return the tree of maps of a basic experience, not yet grown; see :class:`BasicTree`."""
    moves = [_read_move(i, action) for i, action in enumerate(experience.actions)]
    return BasicTree(experience.views, moves, order=order, limit=limit, end=end)


def _read_move(i: int, action: str) -> tuple[Hashable, str]:
    """Return name and kind of an action; a free turn is another action each time."""
    if action == FREE_TURN:
        return (FREE_TURN, i), "turn"
    return action, action if action in (TRAVEL, TURN_AROUND) else "turn"


@dataclass(frozen=True)
class BasicMap:
    """One map of a basic experience.

    Attributes
    ----------
    dstates : for each moment the first moment at the same dstate.
    places : for each moment the first moment at the same place.
    paths : for each moment the path it faces along, named after the first moment on it, and
        whether it faces the way that moment did.
    """

    dstates: tuple[int, ...]
    places: tuple[int, ...]
    paths: tuple[tuple[int, bool], ...]

    @property
    def size(self) -> tuple[int, int]:
        """Number of paths and of places."""
        return len({path for path, _ in self.paths}), len(set(self.places))


def describe_basic_map(experience: BasicExperience, dstates: Sequence[int]) -> BasicMap:
    """Return places and paths of a map, as equations 2, 3 and 4 give them.

    Examples
    --------
    >>> there_and_back = BasicExperience(("T", "L", "L", "T"), ("travel", "turn around", "travel"))
    >>> describe_basic_map(there_and_back, (0, 1, 2, 3)).size
    (1, 3)
    """
    place = {q: q for q in dstates}
    way = {q: (q, True) for q in dstates}
    for i, action in enumerate(experience.actions):
        q, r = dstates[i], dstates[i + 1]
        if action in (TRAVEL, TURN_AROUND):
            (one, forth), (other, back) = way[q], way[r]
            if one != other:
                same = (forth == back) == (action == TRAVEL)
                low, high = min(one, other), max(one, other)
                for x, (path, faces) in way.items():
                    if path == high:
                        way[x] = (low, faces == same)
        if action != TRAVEL:
            low, high = sorted((place[q], place[r]))
            place = {x: low if p == high else p for x, p in place.items()}
    return BasicMap(
        tuple(dstates), tuple(place[q] for q in dstates), tuple(way[q] for q in dstates)
    )
