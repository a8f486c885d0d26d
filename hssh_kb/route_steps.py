"""Typed route steps: made from a way through the place graph, and followed again.

The follower knows nothing of labels or geometry: only what the words of a step say. It is run
over every route, so that no text is given that fits another place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hssh_kb.place_graph import Edge, Place, PlaceGraph
from perception.geometry import wrap_angle
from perception.star import Star

Anchor = Literal["place", "end", "t", "corner", "ordinal", "junction", "spot"]
"""How the place to act at is told, see :func:`choose_anchor`."""

_MAX_ORDINAL = 3
_SLIGHT_RAD, _SHARP_RAD = np.deg2rad(55), np.deg2rad(125)


@dataclass(frozen=True)
class Step:
    """One step of a route.

    Attributes
    ----------
    action : "orient" (how to stand at the start), "travel", "turn" or "arrive".
    at : label of the place where it happens; for a travel where it starts.
    along : name of the path one is on afterwards.
    direction : "left", "right", "slight left", "sharp right", "straight" and so on; for orient
        also "towards", "out", "wall", "behind".
    anchor : how the place is told, see :func:`choose_anchor`; for orient the neighbour's label.
    count : which opening, junction or place, from 1; None where the anchor needs none.
    nth : which of several openings on the same side at one place, from straight ahead, from 1;
        0 if there is only one.
    name : user name of the place, where the anchor is "place".
    past : names of the named places passed on the way; counts begin after the last of them.
    passed : number of junctions passed on the way.
    text : English.
    """

    action: Literal["orient", "travel", "turn", "arrive"]
    at: str
    along: str | None = None
    direction: str | None = None
    anchor: str | None = None
    count: int | None = None
    nth: int = 0
    name: str | None = None
    past: tuple[str, ...] = ()
    passed: int = 0
    text: str = ""


@dataclass(frozen=True)
class Outlook:
    """What lies open at a place to one who faces a dlp: indices, from ahead to behind."""

    ahead: bool
    left: tuple[int, ...]
    right: tuple[int, ...]

    @property
    def ways_on(self) -> int:
        """How many ways lead on without turning back."""
        return self.ahead + len(self.left) + len(self.right)

    def side(self, name: str) -> tuple[int, ...]:
        """Return the openings on a side, "left" or "right"."""
        return self.left if name == "left" else self.right


def look_out(star: Star, facing: int) -> Outlook:
    """Say what lies ahead, left and right of one who faces a dlp of a star.

    Examples
    --------
    >>> look_out(Star.parse(["a-0", "b+1", "a+1", "b-1"]), 0)
    Outlook(ahead=False, left=(3,), right=(1,))
    """
    size, back = len(star), star.opposite(facing)
    to_back = (back - facing) % size
    right = [(facing + i) % size for i in range(1, to_back)]
    left = [(facing - i) % size for i in range(1, size - to_back)]
    return Outlook(
        bool(star.alpha[facing]),
        tuple(k for k in left if star.alpha[k]),
        tuple(k for k in right if star.alpha[k]),
    )


@dataclass(frozen=True)
class _Leg:
    """Stretches walked straight on, up to a turn or the goal."""

    edges: tuple[Edge, ...]
    onward: int | None  # dlp taken at its end; None at the goal


def _split_legs(edges: Sequence[Edge]) -> list[_Leg]:
    legs, current = list[_Leg](), list[Edge]()
    for i, edge in enumerate(edges):
        current.append(edge)
        onward = edges[i + 1].dlp if i + 1 < len(edges) else None
        if onward is None or onward != edge.arrive:
            legs.append(_Leg(tuple(current), onward))
            current = []
    return legs


def describe_route(
    graph: PlaceGraph, start: Place, goal: Place, edges: Sequence[Edge]
) -> tuple[Step, ...]:
    """Return the typed steps (without text) of a way."""
    if not edges:
        return (Step("arrive", goal.label, anchor="place"),)
    steps = [_orient(graph, start, edges[0])]
    for leg in _split_legs(edges):
        last = leg.edges[-1]
        end = graph.places[last.goal]
        between = [graph.places[edge.goal] for edge in leg.edges[:-1]]
        outlooks = [look_out(graph.places[edge.goal].star, edge.arrive) for edge in leg.edges]
        side, direction, nth = "", None, 0
        if leg.onward is not None:
            side, direction, nth = _name_turn(end, last.arrive, leg.onward)
        # Openings and junctions are counted from the last place that is named on the way.
        named = [i for i, place in enumerate(between) if place.name]
        since = named[-1] + 1 if named else 0
        anchor, count = choose_anchor(end, between, outlooks, side, since=since)
        travel = Step(
            "travel",
            leg.edges[0].start,
            last.path,
            "straight",
            anchor,
            count,
            name=end.name if anchor == "place" else None,
            past=tuple(place.name for place in between if place.name),
            passed=sum(outlook.ways_on > 1 for outlook in outlooks[:-1]),
        )
        steps.append(travel)
        if leg.onward is None:
            steps.append(replace(travel, action="arrive", at=goal.label, direction=None))
        else:
            path = graph.path_of_dlp[end.label, leg.onward][0]
            steps.append(
                replace(
                    travel, action="turn", at=end.label, along=path, direction=direction, nth=nth
                )
            )
    return tuple(steps)


def choose_anchor(
    end: Place, between: Sequence[Place], outlooks: Sequence[Outlook], side: str, *, since: int = 0
) -> tuple[Anchor, int | None]:
    """Choose how to tell where a leg ends.

    Parameters
    ----------
    end : the place where it ends. between : the places passed.
    outlooks : what lies open at those places and, last, at the end.
    side : "left" or "right" if one turns there, "" at the goal.
    since : how many of the places passed do not count, for one passes a named place there.

    Returns
    -------
    (anchor, count), by precedence: "place", a turn at a named place; "end", nothing straight
    ahead and a junction passed before, or a dead end; "t", nothing ahead and both sides open;
    "corner", one way on, and not ahead; "ordinal", the count-th opening on the side; "junction",
    the count-th place with a choice; "spot", the count-th place of any kind.

    Source
    ------
    Ours; the order of preference follows how people word routes.
    """
    here, passed = outlooks[-1], sum(outlook.ways_on > 1 for outlook in outlooks[:-1])
    if side and end.name and end.name not in {place.name for place in between}:
        return "place", None
    if not here.ahead:
        if passed or not here.ways_on:
            return "end", None
        if here.left and here.right:
            return "t", None
        if here.ways_on == 1:
            return "corner", None
        return "end", None
    counted = outlooks[since:]
    side = "" if side == "back" else side
    junctions = sum(outlook.ways_on > 1 for outlook in counted)
    if side and junctions > 1:
        openings = [len(outlook.side(side)) for outlook in counted]
        if max(openings) == 1 and sum(openings) <= _MAX_ORDINAL:
            return "ordinal", sum(openings)
    if here.ways_on > 1:
        return "junction", junctions
    return "spot", len(counted)


def _name_turn(place: Place, facing: int, onward: int) -> tuple[str, str, int]:
    """Return (side, direction, nth) of a turn at a place."""
    outlook = look_out(place.star, facing)
    for side in ("left", "right"):
        openings = outlook.side(side)
        if onward in openings:
            nth = openings.index(onward) + 1 if len(openings) > 1 else 0
            return side, _qualify(place, facing, onward, side, openings), nth
    return "back", "back", 0


def _qualify(place: Place, facing: int, onward: int, side: str, openings: tuple[int, ...]) -> str:
    """Add "slight" or "sharp" where several openings lie on one side, or by the angle."""
    if len(openings) == 2:
        return f"{'slight' if onward == openings[0] else 'sharp'} {side}"
    if len(openings) > 2:
        return side  # the step says which by its nth
    if place.headings_rad:
        angle = abs(float(wrap_angle(place.headings_rad[onward] - place.headings_rad[facing])))
        if angle < _SLIGHT_RAD:
            return f"slight {side}"
        if angle > _SHARP_RAD:
            return f"sharp {side}"
    return side


def _orient(graph: PlaceGraph, start: Place, edge: Edge) -> Step:
    """Say how to leave the start, relative to something one can see or knows."""
    star, ahead = start.star, graph.places[edge.goal]

    def tell(direction: str, anchor: str | None = None) -> Step:
        return Step("orient", start.label, edge.path, direction, anchor)

    if ahead.name and ahead.label != start.label:
        return tell("towards", ahead.label)
    if sum(star.alpha) == 1:
        return tell("out")
    walls = [k for k, alpha in enumerate(star.alpha) if not alpha]
    if len(walls) == 1:
        facing = star.opposite(walls[0])
        if facing == edge.dlp:
            return tell("straight", "wall")
        outlook = look_out(star, facing)
        for side in ("left", "right"):
            if outlook.side(side) == (edge.dlp,):
                return tell(side, "wall")
    behind = graph.edge_at.get((start.label, star.opposite(edge.dlp)))
    if behind and graph.places[behind.goal].name and behind.goal != start.label:
        return tell("behind", behind.goal)
    return tell("towards", ahead.label)


def follow_steps(graph: PlaceGraph, start: str, dlp: int, steps: Sequence[Step]) -> str | None:
    """Follow typed steps from a place, leaving along a dlp.

    Returns
    -------
    Label of the place where they end; None if a step cannot be followed.
    """
    here, onward = start, dlp
    for step in steps:
        if step.action not in {"turn", "arrive"}:
            continue
        edge = _walk_to_anchor(graph, here, onward, step)
        if edge is None:
            return None
        here = edge.goal
        if step.action == "arrive":
            return here
        star = graph.places[here].star
        side = (step.direction or "").split()[-1]
        if side == "back":
            onward = star.opposite(edge.arrive)
            continue
        openings = look_out(star, edge.arrive).side(side)
        if len(openings) < max(step.nth, 1) or (step.nth == 0 and len(openings) > 1):
            return None
        onward = openings[max(step.nth, 1) - 1]
    return here


def _walk_to_anchor(graph: PlaceGraph, here: str, onward: int, step: Step) -> Edge | None:
    """Walk straight on until the anchor of a step is met; return the last stretch."""
    side = (step.direction or "").split()[-1] if step.action == "turn" else ""
    side = "" if side == "back" else side
    seen = junctions = walked = 0
    to_pass = list(step.past)
    for _ in graph.edges:
        edge = graph.edge_at.get((here, onward))
        if edge is None:
            return None
        place = graph.places[edge.goal]
        outlook = look_out(place.star, edge.arrive)
        walked += 1
        seen += len(outlook.side(side)) if side else 0
        junctions += outlook.ways_on > 1
        if to_pass:
            if place.name == to_pass[0]:
                del to_pass[0]
                seen = junctions = walked = 0
        elif _meets(step, place, outlook, (seen, junctions, walked)):
            return edge
        if not outlook.ahead:
            return None
        here, onward = edge.goal, edge.arrive
    return None


def _meets(step: Step, place: Place, outlook: Outlook, counts: tuple[int, int, int]) -> bool:
    seen, junctions, walked = counts
    match step.anchor:
        case "place":
            return place.name is not None and place.name == step.name
        case "end":
            return not outlook.ahead
        case "t":
            return not outlook.ahead and bool(outlook.left and outlook.right)
        case "corner":
            return not outlook.ahead and outlook.ways_on == 1
        case "ordinal":
            return seen == step.count
        case "junction":
            return junctions == step.count
        case _:
            return walked == step.count
