"""Floor plans: reading the JSON form, checking it, and drawing its walls as segments."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from perception.geometry import Array

SCHEMA = "hssh.world/1"
DOOR_STATES = ("open", "ajar", "closed")
_LEAF_ANGLE_RAD = {"open": math.radians(95), "ajar": math.radians(22), "closed": 0.0}
_TURN_OF_AXIS = {"x": 0.0, "y": math.pi / 2}
_KINDS = ("L", "T", "+", "dead end", "other")
_DISC_SIDES = 12

Rect = tuple[float, float, float, float]


def find_plan_faults(plan: Any) -> list[str]:  # noqa: ANN401
    """Return one sentence for each fault in the form of a plan; empty if there is none.

    Parameters
    ----------
    plan : a decoded JSON document; see the bundled ``worlds/office.json`` for the form.
    """
    if not isinstance(plan, dict) or plan.get("schema") != SCHEMA:
        return [f'expected a JSON object with "schema": "{SCHEMA}"']
    faults: list[str] = []
    if not _is_numbers(plan.get("size_m"), 2):
        faults.append('"size_m": expected two numbers, width and height in metres')
    if not _is_numbers([plan.get("wall_m")], 1) or plan["wall_m"] <= 0:
        faults.append('"wall_m": expected the thickness of the walls in metres')
    checks = {
        "corridors": _check_area,
        "rooms": _check_area,
        "doors": _check_door,
        "furniture": _check_furniture,
        "places": _check_place,
        "edges": _check_edge,
    }
    for key, check in checks.items():
        items = plan.get(key)
        if not isinstance(items, list):
            faults.append(f'"{key}": expected a list')
            continue
        for index, item in enumerate(items):
            reason = check(item) if isinstance(item, dict) else "expected an object"
            if reason:
                faults.append(f"{key}[{index}]: {reason}")
    tour = plan.get("tour", [])
    if not isinstance(tour, list) or not all(isinstance(name, str) for name in tour):
        faults.append('"tour": expected a list of names of places')
    return faults or _find_reference_faults(plan)


def _is_numbers(value: object, count: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(
            isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v)
            for v in value
        )
    )


def _check_rect(item: Mapping[str, Any]) -> str:
    rect = item.get("rect")
    if not _is_numbers(rect, 4) or rect is None or not (rect[0] < rect[2] and rect[1] < rect[3]):
        return '"rect": expected [left, bottom, right, top] in metres'
    return ""


def _check_area(item: Mapping[str, Any]) -> str:
    if not isinstance(item.get("name"), str) or not item["name"]:
        return '"name": expected a name'
    return _check_rect(item)


def _check_door(item: Mapping[str, Any]) -> str:
    if not isinstance(item.get("name"), str) or not isinstance(item.get("room"), str):
        return 'expected "name" and "room"'
    if not _is_numbers(item.get("at"), 2) or item.get("wall") not in ("x", "y"):
        return 'expected "at": [x, y] and "wall": "x" or "y", the axis along which the wall runs'
    if not _is_numbers([item.get("width_m")], 1) or item["width_m"] <= 0:
        return '"width_m": expected a width in metres'
    if item.get("state") not in DOOR_STATES:
        return f'"state": expected one of {", ".join(DOOR_STATES)}'
    return ""


def _check_furniture(item: Mapping[str, Any]) -> str:
    if "disc" in item:
        ok = _is_numbers(item["disc"], 3) and item["disc"][2] > 0
        return "" if ok else '"disc": expected [x, y, radius] in metres'
    return _check_rect(item)


def _check_place(item: Mapping[str, Any]) -> str:
    if not isinstance(item.get("name"), str) or not _is_numbers(item.get("at"), 2):
        return 'expected "name" and "at": [x, y]'
    return "" if item.get("kind") in _KINDS else f'"kind": expected one of {", ".join(_KINDS)}'


def _check_edge(item: Mapping[str, Any]) -> str:
    ends = item.get("ends")
    is_pair = isinstance(ends, list) and len(ends) == 2 and all(isinstance(e, str) for e in ends)
    return "" if is_pair else '"ends": expected the names of two places'


def _find_reference_faults(plan: Mapping[str, Any]) -> list[str]:
    """Return faults of names and of rectangles against each other."""
    faults = []
    areas = [*plan["corridors"], *plan["rooms"]]
    for key in ("rooms", "doors", "places"):
        names = [item["name"] for item in plan[key]]
        faults += [
            f"{key}: the name {n!r} occurs twice"
            for n in sorted({n for n in names if names.count(n) > 1})
        ]
    rooms = {item["name"] for item in plan["rooms"]}
    faults += [
        f"doors: {door['name']!r} belongs to {door['room']!r}, which is no room"
        for door in plan["doors"]
        if door["room"] not in rooms
    ]
    places = {item["name"] for item in plan["places"]}
    pairs = {frozenset(edge["ends"]) for edge in plan["edges"]}
    faults += [
        f"edges: {name!r} is no place"
        for pair in pairs
        for name in sorted(pair)
        if name not in places
    ]
    tour = plan.get("tour", [])
    faults += [
        f"tour: there is no edge between {a!r} and {b!r}"
        for a, b in itertools.pairwise(tour)
        if frozenset((a, b)) not in pairs
    ]
    width, height = plan["size_m"]
    faults += [
        f"{area['name']!r} reaches beyond the plan of {width:g} m x {height:g} m"
        for area in areas
        if min(area["rect"][:2]) < 0 or area["rect"][2] > width or area["rect"][3] > height
    ]
    return faults + _find_overlaps(plan)


def _find_overlaps(plan: Mapping[str, Any]) -> list[str]:
    """Rooms must keep the thickness of a wall from each other and from corridors."""
    gap = 0.9 * plan["wall_m"]
    corridors = [(item["name"], item["rect"]) for item in plan["corridors"]]
    rooms = [(item["name"], item["rect"]) for item in plan["rooms"]]
    faults = []
    for index, (name, a) in enumerate(rooms):
        for other, b in [*corridors, *rooms[index + 1 :]]:
            apart = max(a[0] - b[2], b[0] - a[2], a[1] - b[3], b[1] - a[3])
            if apart < gap:
                faults.append(f"room {name!r} leaves no wall to {other!r}")
    return faults


def draw_segments(plan: Mapping[str, Any], states: Mapping[str, str]) -> Array:
    """Draw walls, door leaves and furniture as segments.

    Parameters
    ----------
    plan : a plan without faults.
    states : state of each door, by name.

    Returns
    -------
    (n, 4) x0, y0, x1, y1 in metres.
    """
    wall_m = float(plan["wall_m"])
    free: list[Rect] = [tuple(area["rect"]) for area in (*plan["corridors"], *plan["rooms"])]
    centres = {
        room["name"]: np.array(room["rect"]).reshape(2, 2).mean(axis=0) for room in plan["rooms"]
    }
    leaves = []
    for door in plan["doors"]:
        along, across = door["width_m"] / 2, wall_m / 2
        dx, dy = (along, across) if door["wall"] == "x" else (across, along)
        x, y = door["at"]
        free.append((x - dx, y - dy, x + dx, y + dy))
        leaves.append(_draw_leaf(door, centres[door["room"]], states[door["name"]], wall_m))
    furniture = [part for item in plan["furniture"] for part in _draw_furniture(item)]
    return np.vstack([_outline(free), np.array(leaves).reshape(-1, 4), *furniture])


def _outline(free: Sequence[Rect]) -> Array:
    """Return the border (n, 4) of the union of rectangles."""
    rects = np.round(np.array(free), 6)
    xs, ys = np.unique(rects[:, [0, 2]]), np.unique(rects[:, [1, 3]])
    cells = np.zeros((len(xs) + 1, len(ys) + 1), bool)  # one ring of solid cells around
    for x0, y0, x1, y1 in rects:
        left, right = np.searchsorted(xs, [x0, x1]) + 1
        low, high = np.searchsorted(ys, [y0, y1]) + 1
        cells[left:right, low:high] = True
    segments = []
    for i, x in enumerate(xs):
        edge = np.diff((cells[i, 1:-1] != cells[i + 1, 1:-1]).astype(int), prepend=0, append=0)
        starts, stops = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
        segments += [(x, ys[a], x, ys[b]) for a, b in zip(starts, stops, strict=True)]
    for j, y in enumerate(ys):
        edge = np.diff((cells[1:-1, j] != cells[1:-1, j + 1]).astype(int), prepend=0, append=0)
        starts, stops = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
        segments += [(xs[a], y, xs[b], y) for a, b in zip(starts, stops, strict=True)]
    return np.array(segments, float)


def _draw_leaf(
    door: Mapping[str, Any], room_centre: Array, state: str, wall_m: float
) -> list[float]:
    """Return the leaf of a door; it swings into its room."""
    at, width = np.array(door["at"], float), float(door["width_m"])
    turn = _TURN_OF_AXIS[door["wall"]]
    along, across = (
        np.array([math.cos(turn), math.sin(turn)]),
        np.array([-math.sin(turn), math.cos(turn)]),
    )
    side = 1.0 if float((room_centre - at) @ across) > 0 else -1.0
    angle = _LEAF_ANGLE_RAD[state]
    depth = 0.0 if state == "closed" else side * wall_m / 2
    hinge = at - along * width / 2 + across * depth
    tip = hinge + width * (along * math.cos(angle) + across * side * math.sin(angle))
    return [*hinge.tolist(), *tip.tolist()]


def _draw_furniture(item: Mapping[str, Any]) -> list[Array]:
    """Return the outline of a rectangle or of a disc, in one array (k, 4)."""
    if "disc" in item:
        x, y, radius = item["disc"]
        turn = np.linspace(0, 2 * np.pi, _DISC_SIDES, endpoint=False)
        corners = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
    else:
        x0, y0, x1, y1 = item["rect"]
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)
    return [np.hstack([corners, np.roll(corners, -1, axis=0)])]
