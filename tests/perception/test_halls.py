"""Rooms larger than the local map, and places beside each other."""

import numpy as np
import pytest

from perception.places import PlaceSettings, detect_places
from perception.star import Star
from tests.perception.corridor_worlds import Sketch, Way
from tests.perception.place_drives import disturb, follow, simulate

TEE = Star.parse(["a+1", "b+1", "a-1", "b-0"])
ELL = Star.parse(["a+1", "b+1", "a-0", "b-0"])


def rect(x0, y0, x1, y1):
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)


def draw(areas, ways=(), nodes=((-20.0, -12.0), (24.0, 26.0))):
    sketch = Sketch(np.array(nodes, float), ways, np.random.default_rng(0))
    for area in areas:
        sketch.fill(rect(*area))
    return sketch.outline()


def see(segments, corners, seed=1):
    rng = np.random.default_rng(seed)
    truth = follow(np.array(corners, float))
    poses = disturb(truth, rng)
    return detect_places(simulate(segments, truth, rng), poses, PlaceSettings()), truth


@pytest.fixture(scope="module")
def along_the_wall():
    """Into a hall of 30 m x 24 m, along two of its walls, three metres off, and out again."""
    hall = draw([(-1.2, -10, 1.2, 0.1), (-15, 0, 15, 24), (14.9, 8.8, 23, 11.2)])
    way = [(0, -8), (0, 2.4), (0.6, 3), (11.4, 3), (12, 3.6), (12, 9.4), (12.6, 10), (18.5, 10)]
    return see(hall, way)


def test_a_hall_larger_than_the_local_map_has_places_along_its_walls(along_the_wall):
    visits, _ = along_the_wall
    assert len(visits) == 3
    centres = np.array([v.centre_m for v in visits])
    assert np.hypot(*(centres - [(0, 2.7), (12, 2.9), (12.3, 9.9)]).T).max() < 0.8
    mouth, corner, way_out = (v.readings[0] for v in visits)
    assert mouth.star.isomorphisms(TEE)
    assert corner.star.isomorphisms(ELL)
    assert way_out.star.isomorphisms(TEE)
    assert mouth.star.opposite(mouth.arrive) != mouth.depart


def test_the_ways_along_the_walls_of_a_hall_follow_them(along_the_wall):
    """With the wall on the right hand out of the mouth, and on the left hand back to it."""
    mouth, corner, way_out = (v.readings[0] for v in along_the_wall[0])
    assert mouth.types[mouth.depart] == "RIGHTWALL"
    assert mouth.types[mouth.star.opposite(mouth.depart)] == "LEFTWALL"
    assert mouth.types[mouth.star.opposite(mouth.arrive)] == "MIDLINE"
    assert corner.types[corner.depart] == "RIGHTWALL"
    assert corner.types[corner.star.opposite(corner.arrive)] == "LEFTWALL"
    assert way_out.types[way_out.depart] == "MIDLINE"


def test_crossing_a_hall_far_from_all_walls_makes_no_place():
    hall = draw([(-20, -12, 24, 26)])
    visits, _ = see(hall, [(-10, 7), (12, 7)])
    assert visits == ()


@pytest.fixture(scope="module")
def side_ways():
    """Two side ways off one corridor, their gateways on one line."""
    gap = 2.4
    ways = [Way(0, 1, 2.0), Way(1, 2, 2.0), Way(2, 3, 2.0), Way(1, 4, 2.0), Way(2, 5, 2.0)]
    nodes = np.array([[-9, 0], [0, 0], [gap, 0], [gap + 9, 0], [0, 9], [gap, -9]], float)
    return draw([], ways, nodes), [(-7, 0), (gap + 5.5, 0)]


@pytest.fixture(scope="module")
def rooms():
    """Two rooms with a door between them, a corridor into each, and another way out of each."""
    areas = [(-5, -2, -0.08, 2), (0.08, -2, 5, 2), (-0.1, -0.6, 0.1, 0.6)]
    areas += [(-10, -0.8, -4.9, 0.8), (4.9, -0.8, 10, 0.8), (-3, 0, -1.4, 9), (1.4, -9, 3, 0)]
    return draw(areas), [(-9, 0), (8, 0)]


@pytest.mark.parametrize("world", ["side_ways", "rooms"])
def test_places_beside_each_other_are_two_with_a_travel_of_no_length_between(world, request):
    segments, way = request.getfixturevalue(world)
    visits, truth = see(segments, way)
    first, second = visits
    assert first.last_scan == second.first_scan
    assert first.scan < first.last_scan < second.scan
    boundary = truth[first.last_scan, 0]
    assert first.centre_m[0] < boundary < second.centre_m[0]
    for visit in visits:
        reading = visit.readings[0]
        assert reading.star.isomorphisms(TEE)
        assert reading.arrive == reading.depart  # straight on
