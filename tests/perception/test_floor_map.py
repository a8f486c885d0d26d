from __future__ import annotations

import math
from collections import Counter

import cv2
import networkx as nx
import numpy as np
import pytest
from floor_plans import RESOLUTION, Plan, draw_office

from perception.errors import InputError
from perception.floor_graph import FloorMap
from perception.floor_map import explore_floor
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame
from perception.star import Star


def explore(plan: Plan, **options: object) -> FloorMap:
    image = plan.image()
    return explore_floor(image, frame_of(image), **options)


def frame_of(image: np.ndarray) -> Frame:
    return Frame(0.0, image.shape[0] * RESOLUTION, RESOLUTION)


def near(floor: FloorMap, x: float, y: float, reach: float = 1.0) -> list[int]:
    """Return the places near a point of the plan, x right, y down from the top of 18 m."""
    return [k for k, p in enumerate(floor.places) if math.dist(p.centre_m, (x, 18.0 - y)) <= reach]


def degrees(floor: FloorMap) -> list[int]:
    count = Counter[int]()
    for edge in floor.edges:
        count[edge.start] += 1
        count[edge.goal] += 1
    return [count[k] for k in range(len(floor.places))]


def test_an_office_has_its_places():
    floor = explore(draw_office())
    for k in range(3):
        (junction,) = near(floor, 5.45 + 6 * k, 9)
        assert floor.places[junction].kind == "junction"
        assert len(floor.places[junction].gateways) == 3
        (room,) = near(floor, 5.5 + 6 * k, 5.7, 1.6)
        assert floor.places[room].kind == "dead end"
    (corner,) = near(floor, 25, 9)
    assert floor.places[corner].kind == "corner"
    (other,) = near(floor, 25, 15)
    assert floor.places[other].kind == "corner"
    ends = [k for k, p in enumerate(floor.places) if p.kind == "dead end"]
    assert len(ends) == 5  # three rooms and the two ends of the corridor
    assert len(floor.places) == 10
    assert len(floor.edges) == 9


def test_doors_are_found_where_they_are_and_nowhere_else():
    floor = explore(draw_office())
    doors = [g for g in floor.gateways if g.kind == "door"]
    assert len(doors) == 3
    for k, door in enumerate(sorted(doors, key=lambda g: g.centre_m)):
        assert math.dist(door.centre_m, (5.45 + 6 * k, 18 - 7.9)) < 0.2
        assert door.width_m == pytest.approx(0.9, abs=0.12)
        assert abs(math.sin(door.outward_rad)) == pytest.approx(1.0, abs=0.02)
        assert abs(door.ends_m[0][1] - door.ends_m[1][1]) < 0.11
    assert sum(len(edge.doors) for edge in floor.edges) == 3


def test_stars_and_headings_are_those_of_the_plan():
    floor = explore(draw_office())
    (k,) = near(floor, 11.45, 9)
    best = floor.places[k].readings[0]
    assert best.star.isomorphisms(Star.parse(["a+1", "b+1", "a-1", "b-0"]))
    out = {
        round(math.degrees(h)) // 90
        for h, g in zip(best.headings_px, best.gateway_out, strict=True)
        if g is not None
    }
    headings = sorted(
        math.degrees(h) % 360
        for h, g in zip(best.headings_px, best.gateway_out, strict=True)
        if g is not None
    )
    assert len(out) == 3
    assert min(abs(h - 90) for h in headings) < 8  # the door, upward in the map
    assert min(min(abs(h), 360 - h) for h in headings) < 8
    assert min(abs(h - 180) for h in headings) < 8


def test_edges_join_the_places_they_name():
    floor = explore(draw_office())
    for edge in floor.edges:
        assert np.allclose(edge.points_m[0], floor.places[edge.start].centre_m)
        assert np.allclose(edge.points_m[-1], floor.places[edge.goal].centre_m)
        assert edge.length_m >= math.dist(edge.points_m[0], edge.points_m[-1]) - 1e-9
    assert degrees(floor) == [len(place.gateways) for place in floor.places]


def test_a_loop_of_corridors_is_a_loop():
    plan = Plan(20, 18).carve(2, 2, 14, 2).carve(2, 12, 14, 2).carve(2, 2, 2, 12)
    plan.carve(14, 2, 2, 12)
    floor = explore(plan)
    assert len(floor.edges) == len(floor.places) == 4
    assert {place.kind for place in floor.places} == {"corner"}


def test_furniture_makes_neither_places_nor_loops():
    plan = draw_office().block(5, 5, 1.2, 0.8).block(12, 5.2, 0.9, 0.9)
    plan.block(16.6, 4.6, 0.3, 0.3)
    floor = explore(plan)
    assert sum(g.kind == "door" for g in floor.gateways) == 3
    assert len(floor.edges) == len(floor.places) - 1
    assert len(floor.places) <= 12


def test_a_gap_between_furniture_is_no_door():
    plan = Plan(12, 18).carve(1, 1, 8, 8).block(3, 4, 1.5, 1.5).block(5.4, 4, 1.5, 1.5)
    assert not any(g.kind == "door" for g in explore(plan).gateways)


def test_a_row_of_chairs_is_one_thing_that_is_passed_on_both_sides():
    plan = Plan(16, 18).carve(1, 7, 3, 1.5).carve(4, 4, 9, 7).carve(13, 7, 2, 1.5)
    for k in range(6):
        plan.block(5.5 + k, 7.4, 0.75, 0.75)
    floor = explore(plan)
    kinds = Counter(place.kind for place in floor.places)
    assert kinds == {"junction": 2, "corner": 4, "dead end": 2}
    assert len(floor.edges) == len(floor.places)  # one loop
    y = [e.points_m[:, 1] for e in floor.edges if e.length_m > 5]
    assert sorted(round(float(v.mean() - 10.25)) for v in y) == [-2, 2]


def test_a_way_that_saves_a_great_detour_stays_though_a_small_thing_stands_beside_it():
    plan = Plan(26, 18).carve(1, 2, 22, 2.2).carve(1, 14, 22, 2.2).carve(1, 2, 2.2, 14)
    plan.carve(20.8, 2, 2.2, 14).carve(10.3, 4, 3.4, 10).block(11.7, 7, 0.8, 0.8)
    floor = explore(plan)
    middle = [e for e in floor.edges if np.ptp(e.points_m[:, 1]) > 7]
    assert len(middle) == 3  # left, right, and past the thing on one side


def test_a_hall_has_ways_along_its_walls_and_straight_across():
    plan = Plan(40, 26).carve(2, 6, 34, 14).carve(18, 1, 1.5, 5.2).carve(18, 19.8, 1.5, 5.2)
    floor = explore(plan)
    ends = [k for k, p in enumerate(floor.places) if len(p.gateways) == 4]
    assert len(ends) == 2
    assert sorted(abs(floor.places[k].centre_m[1] - 13.0) for k in ends) == pytest.approx(
        [5.5, 5.5], abs=0.7
    )
    across = [e for e in floor.edges if {e.start, e.goal} == set(ends) and e.length_m < 12]
    assert len(across) == 1


def test_nobody_goes_a_great_detour_in_a_hall():
    plan = Plan(40, 26).carve(2, 6, 34, 14).carve(18, 1, 1.5, 5.2).carve(18, 19.8, 1.5, 5.2)
    floor = explore(plan)
    ways = nx.Graph()
    for number, edge in enumerate(floor.edges):
        points = edge.points_m[1:-1]
        names = [edge.start, *((number, k) for k in range(len(points) - 2)), edge.goal]
        for one, other, length in zip(
            names, names[1:], np.hypot(*np.diff(points, axis=0).T), strict=False
        ):
            ways.add_edge(one, other, length=float(length))
            ways.nodes[other]["at"] = points[names.index(other)]
            ways.nodes[one]["at"] = points[names.index(one)]
    nodes = list(ways)
    at = np.array([ways.nodes[node]["at"] for node in nodes])
    for x in np.arange(5.0, 34.0, 2.0):
        high, low = (int(np.hypot(*(at - (x, 13 + y)).T).argmin()) for y in (5.5, -5.5))
        way = nx.shortest_path_length(ways, nodes[high], nodes[low], weight="length")
        assert way <= 1.5 * 11 + 2.0 + 1.0


def test_a_ring_around_the_open_middle_of_a_hall_is_crossed_too():
    plan = Plan(34, 30).carve(2, 8, 28, 16)
    floor = explore(plan)
    assert any(len(place.gateways) >= 3 for place in floor.places)
    assert {edge.start for edge in floor.edges} | {edge.goal for edge in floor.edges} == set(
        range(len(floor.places))
    )


def test_a_corridor_that_ends_in_a_narrow_gap_is_one():
    plan = Plan(20, 18).carve(1, 12, 18, 2).carve(9, 4, 2, 8.2).carve(9.7, 2.5, 0.6, 1.6)
    floor = explore(plan)
    (junction,) = near(floor, 10, 13)
    assert len(floor.places[junction].gateways) == 3
    assert len(near(floor, 10, 4.5, 0.8)) == 1


def test_a_room_between_two_doors_holds_a_place():
    plan = Plan(16, 18).carve(1, 1, 4, 4).carve(5.3, 1, 4, 4).carve(9.6, 1, 4, 4)
    plan.carve(4.9, 2.5, 0.5, 0.9).carve(9.2, 2.5, 0.5, 0.9)
    floor = explore(plan)
    assert sum(g.kind == "door" for g in floor.gateways) == 2
    (middle,) = near(floor, 7.3, 3, 1.0)
    assert floor.places[middle].kind == "room"


def test_other_parts_are_left_out_and_can_be_chosen():
    plan = draw_office().carve(2, 0.5, 6, 2)
    floor = explore(plan)
    ((area, point),) = floor.other_parts
    assert area == pytest.approx(5.5 * 1.5, rel=0.1)
    assert math.dist(point, (5.0, 18 - 1.5)) < 2.5
    other = explore(plan, start_m=point)
    assert len(other.places) == 2
    assert other.other_parts[0][0] > 50


def test_doors_may_be_ignored():
    floor = explore(draw_office(), doors="ignore")
    assert sorted(place.kind for place in floor.places) == [
        "corner",
        "corner",
        "dead end",
        "dead end",
    ]
    assert sum(g.kind == "door" for g in floor.gateways) == 3  # told all the same
    assert not any(edge.doors for edge in floor.edges)


def test_a_door_between_two_corridors_is_passed_though_doors_are_ignored():
    plan = Plan(56, 18).carve(1, 8, 25, 2).carve(26.3, 8, 27, 2).carve(25.9, 8.5, 0.5, 0.9)
    plan.carve(8, 3, 4, 4.6).carve(9.5, 7.5, 0.9, 0.6)
    assert any(edge.doors for edge in explore(plan, doors="ignore").edges)
    assert len(explore(plan, doors="ignore").places) < len(explore(plan).places)


def test_narrow_gateways_may_be_closed():
    plan = Plan(40, 18).carve(1, 8, 18, 2).carve(19.3, 4, 6, 10).carve(18.9, 8.5, 0.5, 0.9)
    plan.carve(25.6, 4, 6, 10).carve(25.2, 8, 0.5, 1.6)
    assert explore(plan, min_gateway_m=0.6).places[0].centre_m == explore(plan).places[0].centre_m
    wide = explore(plan, min_gateway_m=1.2)
    assert {p.centre_m[0] > 19 for p in wide.places} == {True}
    corridor = explore(plan, min_gateway_m=1.2, start_m=(3.0, 9.0))
    assert {p.centre_m[0] > 19.5 for p in corridor.places} == {False}


@pytest.mark.parametrize("options", [{"doors": "shut"}, {"min_gateway_m": -1.0}])
def test_levels_that_do_not_exist_are_refused(options):
    with pytest.raises(InputError, match="expected"):
        explore(draw_office(), **options)


def test_what_surrounds_a_drawn_plan_is_not_the_floor():
    image = Plan(24, 18).carve(2, 6, 20, 3).carve(2, 9.3, 6, 6).carve(4, 9, 1, 0.4).image()
    image[image == UNKNOWN] = FREE
    floor = explore_floor(image, frame_of(image))
    area, at = floor.other_parts[0]
    assert all(18 - 15.5 < place.centre_m[1] < 18 - 6 for place in floor.places)
    assert area > 150
    outside = explore_floor(image, frame_of(image), start_m=at)
    assert outside.other_parts[0][0] < 100


def test_a_start_in_a_wall_moves_a_little_but_not_far():
    assert len(explore(draw_office(), start_m=(3.0, 18 - 7.8)).places) == 10
    with pytest.raises(InputError, match="no free space"):
        explore(draw_office(), start_m=(29.0, 1.0))
    with pytest.raises(InputError, match="outside the map"):
        explore(draw_office(), start_m=(-50.0, 1.0))


def test_named_rooms_hold_a_place_each():
    square = np.array([[7.0, 9.0], [9.0, 9.0], [9.0, 9.9], [7.0, 9.9]])  # in mid corridor
    room = np.array([[3, 18 - 7.7], [8, 18 - 7.7], [8, 18 - 3.5], [3, 18 - 3.5]], float)
    floor = explore(draw_office(), rooms_m={"copier": [square - [0, 0.6]], "office": [room]})
    named = {name: k for k, place in enumerate(floor.places) for name in place.names}
    assert set(named) == {"copier", "office"}
    assert floor.places[named["copier"]].kind == "room"
    assert floor.places[named["office"]].kind == "dead end"


@pytest.mark.parametrize("turn", [90, 180, 270])
def test_turning_the_plan_changes_nothing(turn):
    image = draw_office().image()
    plain = explore_floor(image, frame_of(image))
    image = np.ascontiguousarray(np.rot90(image, turn // 90))
    turned = explore_floor(image, frame_of(image))
    for kind in ("junction", "corner", "dead end", "room"):
        count = [sum(p.kind == kind for p in floor.places) for floor in (plain, turned)]
        assert count[0] == count[1], kind
    assert len(plain.edges) == len(turned.edges)
    doors = [sum(g.kind == "door" for g in floor.gateways) for floor in (plain, turned)]
    assert doors[0] == doors[1] == 3


@pytest.mark.parametrize("angle_deg", [10.0, 33.0])
def test_slanting_plans_have_the_same_places(angle_deg):
    image = draw_office().image()
    height, width = image.shape
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), angle_deg, 1.0)
    matrix[:, 2] += (900 - np.array([width, height])) / 2
    image = cv2.warpAffine(image, matrix, (900, 900), flags=cv2.INTER_NEAREST, borderValue=UNKNOWN)
    floor = explore_floor(image, frame_of(image))
    assert sum(g.kind == "door" for g in floor.gateways) == 3
    assert sum(p.kind == "junction" for p in floor.places) == 3
    assert len(floor.edges) == len(floor.places) - 1


def test_rough_walls_bear_no_places():
    image = draw_office().image()
    rng = np.random.default_rng(7)
    edge = cv2.dilate((image == OCCUPIED).astype(np.uint8), np.ones((3, 3))) > 0
    image[edge & (rng.random(image.shape) < 0.25) & (image == FREE)] = OCCUPIED
    floor = explore_floor(image, frame_of(image))
    assert sum(p.kind == "junction" for p in floor.places) == 3
    assert sum(g.kind == "door" for g in floor.gateways) == 3
    assert len(floor.places) == 10


def test_no_way_at_all_is_told():
    image = np.full((100, 100), UNKNOWN, np.uint8)
    with pytest.raises(InputError, match="no free space"):
        explore_floor(image, frame_of(image))
    image[50, 5:95] = FREE  # a slit
    with pytest.raises(InputError, match="no free space"):
        explore_floor(image, frame_of(image))


@pytest.mark.parametrize("seed", range(4))
def test_any_grid_is_explored_or_refused(seed):
    rng = np.random.default_rng(seed)
    for _ in range(8):
        height, width = rng.integers(3, 160, 2)
        image = rng.choice([OCCUPIED, UNKNOWN, FREE], size=(height, width), p=[0.06, 0.04, 0.9])
        if rng.random() < 0.5:
            image = np.where(
                cv2.GaussianBlur(rng.random((height, width)), (0, 0), 4) > 0.49, 254, 0
            )
        resolution = float(rng.choice([0.05, 0.1, 0.3]))
        frame = Frame(0.0, height * resolution, resolution)
        doors = str(rng.choice(["keep", "ignore"]))
        try:
            floor = explore_floor(
                image.astype(np.uint8), frame, doors=doors, min_gateway_m=float(rng.choice([0, 1]))
            )
        except InputError:
            continue
        assert degrees(floor) == [len(place.gateways) for place in floor.places]


def test_a_bay_does_not_draw_a_crossing_aside():
    plan = Plan(20, 16).carve(1, 2, 18, 2).carve(9, 2, 2, 13).carve(5.5, 4, 3.5, 2.5)
    floor = explore(plan)
    crossing = next(p for p in floor.places if len(p.gateways) == 3)
    bare = explore(Plan(20, 16).carve(1, 2, 18, 2).carve(9, 2, 2, 13))
    wanted = next(p for p in bare.places if len(p.gateways) == 3).centre_m
    drawn_aside = math.dist(crossing.base_m[0], wanted)
    assert math.dist(crossing.centre_m, wanted) < min(0.5, 0.5 * drawn_aside)
