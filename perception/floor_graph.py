"""The place graph of a floor: places, gateways, edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from perception.continuity import StarReading
from perception.floor_places import PlaceKind
from perception.gateway_kinds import GatewayKind
from perception.geometry import Array

Point = tuple[float, float]


@dataclass(frozen=True)
class FloorGateway:
    """A gateway on a floor, in the map frame.

    Attributes
    ----------
    centre_m, ends_m : its middle and its two ends.
    outward_rad : direction away from its place, counter-clockwise.
    width_m : its length.
    kind : "door", "mouth" (where a way opens into a place) or "narrowing".
    """

    centre_m: Point
    ends_m: tuple[Point, Point]
    outward_rad: float
    width_m: float
    kind: GatewayKind


@dataclass(frozen=True, eq=False)
class FloorPlace:
    """A place on a floor.

    Attributes
    ----------
    centre_m : where its paths meet, in the map frame.
    clearance_m : distance to the nearest obstacle there.
    kind : see :data:`perception.floor_places.PlaceKind`.
    gateways : by index.
    readings : ways to read its star, most probable first; ``gateway_out`` are indices into
        ``gateways``, the headings are in the map frame, radians counter-clockwise. Those of weight
        0 are the best one with a path or two broken off at the place.
    names : names of the rooms it lies in.
    base_m : the junctions of the skeleton, or the one other point of it, that make it up.
    """

    centre_m: Point
    clearance_m: float
    kind: PlaceKind
    gateways: tuple[FloorGateway, ...]
    readings: tuple[StarReading, ...]
    names: tuple[str, ...] = ()
    base_m: tuple[Point, ...] = ()


@dataclass(frozen=True, eq=False)
class FloorEdge:
    """A way between two places.

    Attributes
    ----------
    start, goal : numbers of the places.
    start_gateway, goal_gateway : which gateway of each it passes.
    points_m : (n, 2) from the centre of one to that of the other. The second point and the last but
        one are the middles of their base points; the way between follows the skeleton.
    doors : numbers of the gateways of the floor map, doors only, that it passes.
    """

    start: int
    start_gateway: int
    goal: int
    goal_gateway: int
    points_m: Array
    doors: tuple[int, ...]

    @property
    def length_m(self) -> float:
        """Its length."""
        return float(np.hypot(*np.diff(self.points_m, axis=0).T).sum())


@dataclass(frozen=True, eq=False)
class FloorMap:
    """The place graph of a floor.

    Attributes
    ----------
    places, edges : by number.
    gateways : the doors and narrowings of the floor, whether or not a place has them.
    other_parts : the parts of the floor that cannot be reached, largest first: (area in m2, a
        point of it in the map frame).
    skeleton_m : (n, 2) points of the skeleton.
    """

    places: tuple[FloorPlace, ...]
    edges: tuple[FloorEdge, ...]
    gateways: tuple[FloorGateway, ...]
    other_parts: tuple[tuple[float, Point], ...]
    skeleton_m: Array
