"""Worlds to simulate: a floor plan as wall segments, with the place graph that is true in it."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import cv2
import networkx as nx
import numpy as np

from perception.errors import InputError
from perception.files import read_bytes
from perception.floor_plan import DOOR_STATES, Rect, draw_segments, find_plan_faults
from perception.geometry import Array
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame, Image

_BUNDLED = "worlds/office.json"


@dataclass(frozen=True)
class World:
    """A floor to drive on; frame ``_map``: metres, x east, y north.

    Attributes
    ----------
    name : of the world.
    size_m : width and height.
    segments : (n, 4) x0, y0, x1, y1 of everything that stops a beam or a robot.
    corridors, rooms : rectangle (left, bottom, right, top) by name.
    doors : state of each door by name: open, ajar (a robot cannot pass), closed.
    truth : graph of the true places on the level of corridors; nodes have ``x``, ``y`` and
        ``kind`` (L, T, +, dead end), edges ``length_m`` and ``corridor``.
    tour : names of places, a drive that visits every corridor.
    """

    name: str
    size_m: tuple[float, float]
    segments: Array
    corridors: dict[str, Rect]
    rooms: dict[str, Rect]
    doors: dict[str, str]
    truth: nx.Graph
    tour: tuple[str, ...]

    def position(self, place: str) -> Array:
        """Return the position (2,) of a place.

        Raises
        ------
        InputError : there is no such place.
        """
        if place not in self.truth:
            raise InputError(
                f"world {self.name!r} has no place {place!r}; it has {', '.join(self.truth)}"
            )
        node = self.truth.nodes[place]
        return np.array([node["x"], node["y"]])

    def name_at(self, x_m: float, y_m: float) -> str:
        """Return the name of the room or corridor at a point, ``""`` if none is there."""
        for areas in (self.rooms, self.corridors):
            for name, (x0, y0, x1, y1) in areas.items():
                if x0 <= x_m <= x1 and y0 <= y_m <= y1:
                    return name
        return ""


def load_world(
    path: str | os.PathLike[str] | None = None, *, doors: Mapping[str, str] | None = None
) -> World:
    """Load a world from its JSON form, the bundled office floor unless told otherwise.

    Parameters
    ----------
    path : a file of schema ``hssh.world/1``, plain or packed.
    doors : other states (open, ajar, closed) for some doors, by name.

    Raises
    ------
    InputError : unreadable, no JSON, or faults in the plan; all of them in one message.

    Examples
    --------
    >>> world = load_world()
    >>> world.truth.number_of_nodes(), world.truth.number_of_edges()
    (18, 24)
    """
    if path is None:
        source, data = _BUNDLED, (files("perception") / _BUNDLED).read_bytes()
    else:
        source, data = os.fspath(path), read_bytes(path)
    try:
        plan = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{source}: not a JSON document ({error}); expected a floor plan"
        ) from error
    faults = find_plan_faults(plan)
    states = {} if faults else {door["name"]: door["state"] for door in plan["doors"]}
    for name, state in (doors or {}).items():
        if not faults and name not in states:
            faults.append(f"there is no door {name!r} to set")
        if state not in DOOR_STATES:
            faults.append(f"door {name!r}: state {state!r} is none of {', '.join(DOOR_STATES)}")
        states[name] = state
    if not faults:
        world = _build_world(plan, states)
        faults = _find_truth_faults(world)
    if faults:
        raise InputError(f"{source}: " + "; ".join(faults))
    return world


def _build_world(plan: Mapping[str, Any], states: dict[str, str]) -> World:
    truth = nx.Graph()
    for place in plan["places"]:
        x, y = map(float, place["at"])
        truth.add_node(place["name"], x=x, y=y, kind=place["kind"])
    for edge in plan["edges"]:
        a, b = edge["ends"]
        start, end = truth.nodes[a], truth.nodes[b]
        truth.add_edge(
            a,
            b,
            length_m=math.dist((start["x"], start["y"]), (end["x"], end["y"])),
            corridor=edge.get("corridor", ""),
        )
    width, height = map(float, plan["size_m"])
    return World(
        name=plan.get("name", "unnamed"),
        size_m=(width, height),
        segments=draw_segments(plan, states),
        corridors={item["name"]: tuple(item["rect"]) for item in plan["corridors"]},
        rooms={item["name"]: tuple(item["rect"]) for item in plan["rooms"]},
        doors=states,
        truth=truth,
        tour=tuple(plan.get("tour", ())),
    )


def _find_truth_faults(world: World) -> list[str]:
    """Each edge must run free of walls and furniture."""
    faults = []
    for a, b in world.truth.edges:
        blocked = _crosses(world.position(a), world.position(b), world.segments)
        if blocked.any():
            x, y = world.segments[np.argmax(blocked), :2]
            faults.append(f"edge {a!r} - {b!r} runs into something at ({x:g}, {y:g})")
    return faults


def _crosses(start: Array, end: Array, segments: Array) -> Any:  # noqa: ANN401
    """Tell for each segment (n, 4) whether it crosses the line from start to end."""
    p, q = segments[:, :2], segments[:, 2:]

    def side(a: Array, b: Array, c: Array) -> Array:
        return np.asarray(
            (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
            - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
        )

    apart = side(start, end, p) * side(start, end, q) <= 0
    return apart & (side(p, q, start) * side(p, q, end) <= 0)


def draw_world(world: World, resolution_m: float = 0.05) -> tuple[Image, Frame]:
    """Draw a world as a grid image: corridors and rooms free, walls and furniture occupied.

    Parameters
    ----------
    world : what to draw.
    resolution_m : side of a cell.

    Returns
    -------
    (H, W) uint8 image with the grey levels of :mod:`perception.grid`, and where it lies.
    """
    if not 0.005 <= resolution_m <= 1.0:
        raise InputError(f"resolution {resolution_m} m: expected 0.005 to 1 m")
    width, height = (math.ceil(side / resolution_m) + 1 for side in world.size_m)
    frame = Frame(0.0, height * resolution_m, resolution_m)
    image = np.full((height, width), UNKNOWN, np.uint8)
    for x0, y0, x1, y1 in (*world.rooms.values(), *world.corridors.values()):
        corners = np.rint(frame.to_pixels(np.array([[x0, y1], [x1, y0]]))).astype(int)
        cv2.rectangle(image, corners[0].tolist(), corners[1].tolist(), FREE, -1)
    ends = frame.to_pixels(world.segments.reshape(-1, 2, 2))
    for start, end in np.rint(ends).astype(int).tolist():
        cv2.line(image, start, end, OCCUPIED, 1)
    return image, frame
