import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from perception.continuity import StarReading
from perception.driver import drive
from perception.expectation import ExpectationSettings, expect_readings
from perception.geometry import between
from perception.grid import Frame
from perception.places import PlaceReading, PlaceSettings, PlaceVisit, detect_places
from perception.scanlog import ScanLog
from perception.sightings import Sighting, knows_behind
from perception.simulate import Lidar, cast_rays
from perception.star import Star
from perception.voting import vote_star
from perception.world import load_world

TOUR = ("first corner", "second crossing", "third junction", "third junction west")


@pytest.fixture(scope="module")
def world():
    return load_world()


@pytest.fixture(scope="module")
def log(world):
    return drive(world, tour=TOUR, seed=4, controller="route")


@pytest.fixture(scope="module")
def visits(log):
    return detect_places(log, log.truth)


def test_the_places_of_a_tour_are_found_in_order_and_nothing_else(world, visits):
    at = np.array([world.position(name) for name in TOUR])
    assert len(visits) == len(TOUR)
    for visit, where in zip(visits, at, strict=True):
        assert np.hypot(*(visit.centre_m - where)) < 1.0


def test_stars_and_the_way_through_them(visits):
    first, crossing, junction, _ = visits
    assert first.readings[0].star.isomorphisms(Star.parse(["a+1", "b+1", "a-0", "b-0"]))
    assert crossing.readings[0].star.isomorphisms(Star.parse(["a+1", "b+1", "a-1", "b-1"]))
    # North through the crossing: out by the dlp one faced on arrival.
    assert crossing.readings[0].arrive == crossing.readings[0].depart
    # Left at the junction, whose wall lies to the right: into the stem of a T.
    reading = junction.readings[0]
    assert reading.arrive != reading.depart
    assert abs(abs(reading.headings_rad[reading.depart]) - np.pi) < 0.2
    assert sum(reading.star.alpha) == 3


def test_readings_are_probabilities_best_first(visits):
    for visit in visits:
        weights = [r.weight for r in visit.readings]
        assert sum(weights) == pytest.approx(1.0)
        assert weights == sorted(weights, reverse=True)


def test_the_frame_of_the_drive_does_not_matter(log, visits):
    turned = np.column_stack([-log.truth[:, 1] + 3, log.truth[:, 0], log.truth[:, 2] + np.pi / 2])
    again = detect_places(log, turned)
    assert len(again) == len(visits)
    for a, b in zip(visits, again, strict=True):
        assert np.hypot(*(b.centre_m - [-a.centre_m[1] + 3, a.centre_m[0]])) < 0.4
        assert a.readings[0].star.isomorphisms(b.readings[0].star)


def test_turning_round_on_a_path_is_no_travel(world):
    """Out of a corner, half way down the corridor, back, and on by the other corridor."""
    corner, along, other = (
        np.array(world.position(n))
        for n in ("first corner", "south-west corner", "second crossing")
    )
    half = corner + 0.4 * (along - corner)
    log = walk(
        world,
        [corner + 0.4 * (other - corner), corner, half, corner, corner + 0.7 * (other - corner)],
    )
    visits = detect_places(log, log.truth)
    assert len(visits) == 1
    assert np.hypot(*(visits[0].centre_m - corner)) < 1.0


def walk(world, corners, step_m=0.25):
    """A log of a walk along a polyline, turning on the spot at its corners."""
    poses = []
    for start, end in itertools.pairwise(corners):
        heading = np.arctan2(*(end - start)[::-1])
        if poses:
            turn = (heading - poses[-1][2] + np.pi) % (2 * np.pi) - np.pi
            poses += [[*start, poses[-1][2] + t] for t in np.linspace(0, turn, 12)[1:]]
        for s in np.arange(0, np.hypot(*(end - start)), step_m):
            poses.append([*(start + (end - start) * s / np.hypot(*(end - start))), heading])
    truth = np.array(poses)
    lidar = Lidar()
    ranges = cast_rays(world.segments, truth, lidar.angles_rad, lidar.max_range_m)
    ranges = np.where(np.isfinite(ranges) & (ranges < lidar.max_range_m), ranges, np.nan)
    return ScanLog(
        "walk",
        np.arange(len(truth)) * 0.5,
        ranges.astype(np.float32),
        lidar.angles_rad,
        truth=truth,
    )


def test_an_empty_drive_has_no_places():
    angles = np.deg2rad(np.arange(-90.0, 91.0))
    nothing = ScanLog("dark", np.arange(20.0), np.full((20, 181), np.nan, np.float32), angles)
    poses = np.column_stack([np.arange(20.0), np.zeros((20, 2))])
    assert detect_places(nothing, poses) == ()


@pytest.mark.parametrize(("short_m", "there"), [(1.8, True), (5.0, False)])
def test_a_drive_that_ends_at_the_mouth_of_a_place_has_been_there(world, short_m, there):
    corner, other = (np.array(world.position(n)) for n in ("first corner", "second crossing"))
    ahead = (corner - other) / np.hypot(*(corner - other))
    log = walk(world, [corner - 9.0 * ahead, corner - short_m * ahead])
    ended = [v for v in detect_places(log, log.truth) if v.last_scan == len(log) - 1]
    assert any(np.hypot(*(v.centre_m - corner)) < 0.6 for v in ended) is there


@pytest.mark.parametrize(("half_m", "found"), [(2.0, 1), (0.2, 0)])
def test_a_wide_gateway_passed_near_its_end_is_a_way_too(half_m, found):
    ends = np.array(
        [
            [[2.0, -1.0 - half_m], [2.0, -1.0 + half_m]],
            [[-2.0, -0.2], [-2.0, 0.2]],
            [[-1, 2], [1, 2]],
        ]
    )
    pixels = Frame(0.0, 0.0, 1.0)
    gateways = [SimpleNamespace(ends_px=pixels.to_pixels(two)) for two in ends]
    star = Star.parse(["a+1", "a-1", "b+1", "b-0"])
    reading = StarReading(star, (0, 1, 2, None), (0.0, np.pi, -1.6, 1.6), 1.0)
    topology = SimpleNamespace(gateways=gateways, readings=[reading])
    sighting = Sighting(0, np.zeros(3), np.zeros(2), 2.0, ends.mean(1), 1.0, topology, pixels)
    readings = vote_star([sighting], [], np.zeros(2), np.pi, -1.6, PlaceSettings())
    assert [r.depart for r in readings] == [0] * found


def test_a_robot_learns_what_lies_behind_it_by_moving_or_turning():
    half, whole = np.pi, 2 * np.pi
    assert not knows_behind(np.zeros((1, 3)), half)
    assert knows_behind(np.zeros((1, 3)), whole)
    assert not knows_behind(np.array([[0, 0, 0], [0.6, 0, 0]]), half)
    assert knows_behind(np.array([[0, 0, 0], [1.2, 0, 0]]), half)
    turned = np.column_stack([np.zeros((9, 2)), np.linspace(0, 2.6, 9)])
    assert knows_behind(turned, half)


def test_more_confirmations_leave_fewer_places(log, visits):
    strict = detect_places(log, log.truth, replace(PlaceSettings(), confirmations=1000))
    assert strict == ()
    assert visits


def test_narrow_gateways_count_where_the_robot_drives_through_them(log, visits):
    wide = detect_places(log, log.truth, replace(PlaceSettings(), min_gateway_m=2.5))
    # Straight on through the crossing is a bare path once its other ways are shut; turns are not.
    expected = (visits[0], *visits[2:])
    assert len(wide) == len(expected)
    for visit, same in zip(wide, expected, strict=True):
        assert np.hypot(*(visit.centre_m - same.centre_m)) < 0.5
    for visit in wide[1:-1]:
        reading = visit.readings[0]
        used = {reading.star.opposite(reading.arrive), reading.depart}
        assert {k for k, alpha in enumerate(reading.star.alpha) if alpha} >= used
    narrow = detect_places(log, log.truth, replace(PlaceSettings(), min_gateway_m=0.5))
    assert [v.readings[0].star for v in narrow] == [v.readings[0].star for v in visits]


PLUS = Star.parse(["a+1", "b+1", "a-1", "b-1"])
TEE = Star.parse(["a+1", "b+1", "a-1", "b-0"])
EAST_SOUTH_WEST_NORTH = (0.0, -np.pi / 2, np.pi, np.pi / 2)


def visit_at(x, star, arrive, depart, scan):
    reading = PlaceReading(
        star, arrive, depart, EAST_SOUTH_WEST_NORTH, ((1, 0), (0, -1), (-1, 0), (0, 1)), 1.0
    )
    tile = np.zeros((3, 3), np.uint8)
    return PlaceVisit(scan, scan, scan, np.array([x, 0.0]), 1.0, (reading,), tile, None)


def line(n, step=5.0):
    return np.column_stack([np.arange(n) * step, np.zeros((n, 2))])


def test_a_star_seen_nearby_becomes_a_reading_at_a_price():
    settings = ExpectationSettings()
    visits = expect_readings(
        [visit_at(0.0, PLUS, 0, 0, 0), visit_at(0.5, TEE, 0, 0, 3)], line(4), settings
    )
    tee, plus = visits[1].readings
    assert (tee.star, plus.star) == (TEE, PLUS)
    assert (plus.arrive, plus.depart) == (0, 0)
    assert plus.weight / tee.weight == pytest.approx(settings.missed)
    back = visits[0].readings
    assert back[1].weight / back[0].weight == pytest.approx(settings.imagined)


def test_a_star_without_the_gateway_the_robot_took_is_no_reading():
    north = [visit_at(0.0, PLUS, 0, 3, 0), visit_at(0.5, TEE, 0, 0, 3)]
    assert len(expect_readings(north, line(4))[0].readings) == 1


def test_places_far_apart_suggest_nothing():
    far = [visit_at(0.0, PLUS, 0, 0, 0), visit_at(30.0, TEE, 0, 0, 3)]
    assert [len(v.readings) for v in expect_readings(far, line(4))] == [1, 1]


def test_relative_poses_of_a_walk_are_small(world):
    log = walk(world, [np.array([8.0, 5.0]), np.array([12.0, 5.0])])
    assert np.hypot(*between(log.truth[:-1], log.truth[1:])[:, :2].T).max() < 0.3
