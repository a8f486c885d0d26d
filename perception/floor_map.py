"""A finished floor map as a place graph: a virtual robot goes along its skeleton.

Places with stars and gateways, edges along the skeleton, and what kind of gateway each is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from perception.constrictions import Constriction, find_constrictions
from perception.continuity import StarReading, read_star, read_stars
from perception.core import Arm
from perception.errors import InputError
from perception.floor_crossings import add_crossings
from perception.floor_graph import FloorEdge, FloorGateway, FloorMap, FloorPlace, Point
from perception.floor_level import FloorDoors, choose_closed, close_gateways
from perception.floor_places import PlaceNodes, find_middle, find_places, holds_point
from perception.floor_pruning import open_loops, prune_shallow
from perception.floor_skeleton import build_floor_skeleton
from perception.floor_space import FloorSettings, FloorSpace, find_floor_space
from perception.gateway_kinds import GatewayKind, tell_kinds
from perception.gateways import Gateway, find_gateway
from perception.geometry import Array
from perception.grid import Frame, Image
from perception.skeleton import Branch, Skeleton
from perception.skeleton_graph import SkeletonGraph

HALL = 1.5
"""A gateway wider than so many times M lies in a hall."""


def explore_floor(
    image: Image,
    frame: Frame,
    *,
    settings: FloorSettings | None = None,
    start_m: Point | None = None,
    rooms_m: Mapping[str, Sequence[Array]] | None = None,
    doors: FloorDoors = "keep",
    min_gateway_m: float = 0.0,
) -> FloorMap:
    """Find places, gateways and ways of a finished floor map.

    Parameters
    ----------
    image : (H, W) uint8, dark occupied, light free; row 0 at the top.
    frame : where it lies in the map frame.
    start_m : a point of the part of the floor wanted; the largest part by default.
    rooms_m : (n, 2) polygons of rooms by name, map frame; each holds a place if it can.
    doors : "ignore" leaves out what lies behind the doors of rooms.
    min_gateway_m : what can be reached through narrower gateways only is left out.

    Raises
    ------
    InputError : no free space wide enough for the robot, or none around the start.

    Source
    ------
    Beeson 2008, chapter 6, for place, gateway and star; going over a whole map is ours.

    Examples
    --------
    >>> image = np.zeros((200, 300), np.uint8)
    >>> image[20:50, 20:280] = image[50:180, 120:150] = 254
    >>> floor = explore_floor(image, Frame(0.0, 10.0, 0.05))
    >>> sorted(place.kind for place in floor.places), len(floor.edges)
    (['dead end', 'dead end', 'dead end', 'junction'], 3)
    """
    settings = settings or FloorSettings()
    start_px = None
    if start_m is not None:
        column, row = frame.to_pixels(np.array(start_m, float)).tolist()
        start_px = (column, row)
    space = find_floor_space(image, frame.resolution_m, settings, start_px=start_px)
    skeleton = build_floor_skeleton(
        space, midline_m=settings.midline_m, robot_radius_m=settings.robot_radius_m
    )
    if not skeleton.branches:
        raise InputError(
            f"the free space around ({', '.join(f'{v:.2f}' for v in _start(space, frame))}) m "
            "is one room without a way to go; there is nothing to explore"
        )
    survey = _Survey(space, skeleton, frame)
    if doors != "keep" or min_gateway_m:
        survey.close(doors, min_gateway_m, start_px)
    survey.tidy(settings.midline_m)
    return survey.describe(rooms_m or {}, settings.midline_m)


def _start(space: FloorSpace, frame: Frame) -> list[float]:
    point = space.to_map(np.array(space.region.start, float))
    return [float(v) for v in frame.to_metres(point)]


class _Survey:
    """One exploration under way."""

    def __init__(self, space: FloorSpace, skeleton: Skeleton, frame: Frame) -> None:
        self.space, self.frame = space, frame
        self.constrictions = find_constrictions(space, skeleton)
        self.kinds = tell_kinds(space, skeleton, self.constrictions)
        at = [skeleton.branches[c.branch].points_px[c.point] for c in self.constrictions]
        self.door_of_cell = {
            (float(x), float(y)): k for k, (x, y) in enumerate(at) if self.kinds[k] == "door"
        }
        self.graph = SkeletonGraph(skeleton)

    def close(self, doors: FloorDoors, min_gateway_m: float, start_px: Point | None) -> None:
        """Leave out what lies behind gateways that do not count."""
        resolution = self.space.resolution_m
        closed = choose_closed(
            self.graph,
            self.constrictions,
            self.kinds,
            resolution,
            doors=doors,
            min_gateway_m=min_gateway_m,
        )
        near = None
        if start_px is not None:
            near = (start_px[0] - self.space.corner_px[0], start_px[1] - self.space.corner_px[1])
        close_gateways(self.graph, self.constrictions, closed, resolution, start_px=near)
        self.door_of_cell = {at: k for at, k in self.door_of_cell.items() if k not in closed}

    def tidy(self, midline_m: float) -> None:
        """Note the doors; drop ways around furniture and into niches; cross open halls."""
        for k, branch in self.graph.branches.items():
            for x, y in branch.points_px.tolist() if self.door_of_cell else ():
                if (x, y) in self.door_of_cell:
                    self.graph.tags[k].add(self.door_of_cell[x, y])
        open_loops(self.graph, self.space)
        prune_shallow(self.graph, self.space.resolution_m)
        add_crossings(self.graph, self.space, midline_m=midline_m)

    def describe(self, rooms_m: Mapping[str, Sequence[Array]], midline_m: float) -> FloorMap:
        """Return the place graph."""
        polygons = {
            name: [self._to_crop(polygon) for polygon in parts] for name, parts in rooms_m.items()
        }
        doors = np.array(list(self.door_of_cell), float).reshape(-1, 2)
        found = find_places(
            self.graph,
            doors,
            self.space.resolution_m,
            rooms_px=[polygon for parts in polygons.values() for polygon in parts],
        )
        place_of = {node: k for k, place in enumerate(found) for node in place.nodes}
        arms = _Arms(self, found, place_of, HALL * midline_m / self.space.resolution_m)
        places = [arms.describe_place(k, polygons) for k in range(len(found))]
        edges = arms.list_edges()
        points = [b.points_px for b in self.graph.branches.values()]
        gateways = tuple(
            self._describe_constriction(c, kind)
            for c, kind in zip(self.constrictions, self.kinds, strict=True)
            if kind is not None
        )
        return FloorMap(
            tuple(places),
            tuple(edges),
            gateways,
            tuple((area, self._to_point_of_map(at)) for area, at in self.space.other_parts),
            self.to_metres(np.concatenate(points)),
        )

    def to_metres(self, points_px: Array) -> Array:
        """Carry points of the crop to the map frame."""
        return self.frame.to_metres(self.space.to_map(points_px))

    def to_point(self, point_px: Point) -> Point:
        """Carry one point of the crop to the map frame."""
        x, y = self.to_metres(np.array(point_px)).tolist()
        return float(x), float(y)

    def _to_point_of_map(self, point_px: Point) -> Point:
        x, y = self.frame.to_metres(np.array(point_px)).tolist()
        return float(x), float(y)

    def _to_crop(self, polygon_m: Array) -> Array:
        corner = np.array(self.space.corner_px, float)
        return np.asarray(self.frame.to_pixels(np.asarray(polygon_m, float)) - corner)

    def _describe_constriction(self, c: Constriction, kind: GatewayKind) -> FloorGateway:
        (ax, ay), (bx, by) = c.ends_px
        heading = math.atan2(bx - ax, -(ay - by))  # across the ends, y up
        ends = (self.to_point(c.ends_px[0]), self.to_point(c.ends_px[1]))
        return FloorGateway(self.to_point(c.centre_px), ends, heading, c.width_m, kind)


class _Arms:
    """The branches as arms of places: gateways, stars and edges."""

    def __init__(
        self,
        survey: _Survey,
        places: Sequence[PlaceNodes],
        place_of: Mapping[int, int],
        hall_px: float,
    ) -> None:
        self.survey, self.places, self.place_of = survey, places, place_of
        self.hall_px = hall_px
        self.middles: dict[int, Array] = {}
        self.arms: list[list[tuple[int, bool]]] = [[] for _ in places]
        self.ways: list[int] = []
        self.gateway_of: dict[tuple[int, bool], int] = {}
        graph = survey.graph
        for k, branch in graph.branches.items():
            one, other = place_of[branch.tail], place_of[branch.head]
            if one == other and self._holds(one, branch.points_px).all():
                continue  # within the place
            self.ways.append(k)
            self.arms[one].append((k, True))
            self.arms[other].append((k, False))

    def _holds(self, k: int, points_px: Array) -> Array:
        """Return which points lie in the core of a place."""
        inside = np.zeros(len(points_px), bool)
        for node in self.places[k].nodes:
            here = self.survey.graph.nodes[node]
            inside |= np.hypot(*(points_px - here.point_px).T) <= here.radius_px
        return inside

    def describe_place(self, k: int, rooms_px: Mapping[str, Sequence[Array]]) -> FloorPlace:
        """Return a place with its gateways and star."""
        survey, place = self.survey, self.places[k]
        nodes = [survey.graph.nodes[node] for node in place.nodes]
        base, radii = np.array([n.point_px for n in nodes]), np.array([n.radius_px for n in nodes])
        pixel, kinds = list[Gateway](), list[GatewayKind]()
        for number, (way, forward) in enumerate(self.arms[k]):
            branch = survey.graph.branches[way]
            gateway, kind = self._find_gateway(k, branch if forward else branch.reversed())
            pixel.append(gateway)
            kinds.append(kind)
            self.gateway_of[way, forward] = number
        x, y = self._middle_of_base(k).tolist()
        readings = _read_with_breaks(pixel, (x, y))
        lines = pixel if place.kind != "room" else ()
        middle = self.middles[k] = find_middle(base, radii, lines, self.hall_px)
        gateways = tuple(
            FloorGateway(
                survey.to_point(g.centre_px),
                (survey.to_point(g.ends_px[0]), survey.to_point(g.ends_px[1])),
                math.remainder(-g.outward_rad, 2 * math.pi),
                g.width_px * survey.space.resolution_m,
                kind,
            )
            for g, kind in zip(pixel, kinds, strict=True)
        )
        return FloorPlace(
            survey.to_point((float(middle[0]), float(middle[1]))),
            float(radii.max()) * survey.space.resolution_m,
            place.kind,
            gateways,
            tuple(_in_map_frame(reading) for reading in readings),
            _list_names((x, y), rooms_px),
            tuple(survey.to_point(node.point_px) for node in nodes),
        )

    def _find_gateway(self, k: int, outward: Branch) -> tuple[Gateway, GatewayKind]:
        """Return the gateway of an arm: at the door if one is near, else where the core ends."""
        inside = self._holds(k, outward.points_px)
        edge = len(inside) - 1 if inside.all() else int(np.argmin(inside))
        door = self._next_door(outward)
        size = len(outward.points_px)
        if door is not None and outward.steps_px[door] <= outward.steps_px[edge]:
            edge = door
        edge = min(max(edge, 1), size - 1)
        limit = size if door is None or door <= edge else door + 1
        part = outward.part(0, limit, outward.tail, outward.head)
        length = float(outward.steps_px[-1])
        arm = Arm(part, edge, 2.0 * float(outward.radius_px[edge:].max()), length)
        if door is not None and edge == door:
            whole = Arm(outward, edge, 2.0 * float(outward.radius_px[edge:].max()), length)
            return find_gateway(whole, self.survey.space.region, method="constriction"), "door"
        return find_gateway(arm, self.survey.space.region), "mouth"

    def _next_door(self, outward: Branch) -> int | None:
        """Return the first point of an arm that lies in a door."""
        cells = self.survey.door_of_cell
        for i, (x, y) in enumerate(outward.points_px.tolist()):
            if (x, y) in cells:
                return i
        return None

    def _middle_of_base(self, k: int) -> Array:
        nodes = [self.survey.graph.nodes[node].point_px for node in self.places[k].nodes]
        return np.asarray(np.array(nodes).mean(axis=0))

    def list_edges(self) -> list[FloorEdge]:
        """Return the ways between places."""
        edges = []
        cells = self.survey.door_of_cell
        for way in self.ways:
            branch = self.survey.graph.branches[way]
            one, other = self.place_of[branch.tail], self.place_of[branch.head]
            start, goal = self._middle_of_base(one), self._middle_of_base(other)
            points = np.vstack(
                [self.middles[one], start, branch.points_px, goal, self.middles[other]]
            )
            doors = [cells[x, y] for x, y in branch.points_px.tolist() if (x, y) in cells]
            edges.append(
                FloorEdge(
                    one,
                    self.gateway_of[way, True],
                    other,
                    self.gateway_of[way, False],
                    self.survey.to_metres(points),
                    tuple(doors),
                )
            )
        return edges


def _read_with_breaks(gateways: Sequence[Gateway], centre_px: Point) -> list[StarReading]:
    """Return the readings of a star, and the best one with some of its paths broken."""
    readings = list(read_stars(gateways, centre_px))
    best = readings[0]
    pairs = []
    for k, j in enumerate(best.star.opposites):
        one, other = best.gateway_out[k], best.gateway_out[j]
        if k < j and one is not None and other is not None:
            pairs.append((one, other))
    known = {(reading.star, reading.gateway_out) for reading in readings}
    for size in range(len(pairs) - 1, -1, -1):
        for kept in itertools.combinations(pairs, size):
            reading = read_star(gateways, centre_px, kept, weight=0.0)
            if (reading.star, reading.gateway_out) not in known:
                readings.append(reading)
    return readings


def _in_map_frame(reading: StarReading) -> StarReading:
    """Return a reading whose headings are counter-clockwise, y up."""
    headings = tuple(math.remainder(-heading, 2 * math.pi) for heading in reading.headings_px)
    return StarReading(reading.star, reading.gateway_out, headings, reading.weight)


def _list_names(centre_px: Point, rooms_px: Mapping[str, Sequence[Array]]) -> tuple[str, ...]:
    return tuple(
        name
        for name, parts in rooms_px.items()
        if any(holds_point(part, centre_px) for part in parts)
    )
