"""The robot that drives: routes, gateways, what it records."""

import numpy as np
import pytest

from perception.carmen import read_carmen, write_carmen
from perception.driver import drive, truth_visits
from perception.errors import InputError
from perception.geometry import between, compose
from perception.robot import Body, Crowd, Robot
from perception.scanlog import ScanLog
from perception.simulate import Lidar, OdometryNoise
from perception.world import load_world

SHORT = ("south-west corner", "first corner", "second crossing", "third junction")


@pytest.fixture(scope="module")
def world():
    return load_world()


@pytest.fixture(scope="module")
def whole(world):
    """The whole tour along the route, with few beams."""
    return drive(world, controller="route", seed=3, lidar=Lidar(beams=61))


def test_the_tour_is_driven_as_told(world, whole):
    assert truth_visits(world, whole) == list(world.tour)
    assert whole.notices == ()
    end = whole.truth[-1, :2]
    assert np.hypot(*(end - world.position(world.tour[-1]))) < 0.5


def test_scans_are_close_together(whole):
    step = between(whole.truth[:-1], whole.truth[1:])
    assert np.hypot(step[:, 0], step[:, 1]).max() < 0.3
    assert np.abs(step[:, 2]).max() < 0.4
    assert (np.diff(whole.times_s) > 0).all()


def test_the_robot_moves_like_a_differential_drive(whole):
    step = between(whole.truth[:-1], whole.truth[1:])
    assert step[:, 0].min() > -0.02  # never backwards
    assert np.abs(step[:, 1]).max() < 0.05  # never sideways, but for the arc
    speed = np.hypot(step[:, 0], step[:, 1]) / np.diff(whole.times_s)
    assert speed.max() <= Body().speed_mps + 1e-6


def test_the_robot_keeps_off_the_walls(world, whole):
    robot = Robot(world, whole.truth[0], lidar=Lidar(beams=3), body=Body(), noise=OdometryNoise())
    assert not any(robot._is_blocked(pose) for pose in whole.truth[::5])


def test_odometry_drifts_but_not_from_one_scan_to_the_next(whole):
    start = compose(whole.truth[0], whole.odometry)
    drift = np.hypot(*(start - whole.truth)[:, :2].T)
    assert 1.0 < drift.max() < 60.0
    error = between(
        between(whole.odometry[:-1], whole.odometry[1:]),
        between(whole.truth[:-1], whole.truth[1:]),
    )
    assert np.abs(error).max() < 0.08


@pytest.mark.parametrize("fov_deg", [180, 360])
def test_the_same_seed_gives_the_same_log(world, fov_deg):
    logs = [
        drive(world, tour=SHORT[:2], controller="route", seed=s, fov_deg=fov_deg) for s in (1, 1, 2)
    ]
    np.testing.assert_array_equal(logs[0].ranges_m, logs[1].ranges_m)
    np.testing.assert_array_equal(logs[0].odometry, logs[1].odometry)
    assert not np.array_equal(logs[0].odometry[:50], logs[2].odometry[:50])
    width = np.rad2deg(np.ptp(logs[0].angles_rad))
    assert width == pytest.approx(fov_deg)


@pytest.mark.parametrize("fov_deg", [180, 360])
def test_following_gateways_leads_through_the_tour(world, fov_deg):
    log = drive(world, tour=SHORT, controller="gateways", seed=4, fov_deg=fov_deg)
    assert log.notices == ()
    assert truth_visits(world, log) == list(SHORT)


def test_a_robot_that_loses_its_way_says_so_and_drives_on(world):
    noise = OdometryNoise(veer_rad_per_m=0.5)  # it believes to drive in circles
    log = drive(world, tour=SHORT, controller="gateways", seed=4, noise=noise)
    assert "lost the way after place" in log.notices[0]
    assert truth_visits(world, log)[-1] == SHORT[-1]


def test_pedestrians_are_seen_and_walk_in_the_corridors(world):
    crowd = Crowd(world, 12, np.random.default_rng(0))
    before = crowd.walk(0.0)
    for _ in range(600):
        now = crowd.walk(0.1)
        assert np.hypot(*(now - before).T).max() < 2.0  # no jumps, but round corners
        before = now
        assert all(world.name_at(x, y) in world.corridors for x, y in now)
    empty, busy = (
        drive(world, tour=SHORT[:2], controller="route", seed=1, pedestrians=k) for k in (0, 30)
    )
    count = min(len(empty), len(busy), 20)
    shorter = busy.ranges_m[:count] < empty.ranges_m[:count] - 0.3
    assert shorter.any()


def test_a_drive_goes_through_a_carmen_log(world, tmp_path):
    log = drive(world, tour=SHORT[:2], controller="route", seed=1)
    write_carmen(tmp_path / "drive.log", log)
    back = read_carmen(tmp_path / "drive.log")
    assert back.truth is None
    assert back.corrected is None
    assert back.notices == ()
    np.testing.assert_allclose(between(back.odometry, log.odometry), 0, atol=2e-6)
    np.testing.assert_allclose(back.ranges_m, log.ranges_m, atol=6e-4)


def test_visits_count_a_place_again_only_after_leaving_it(world):
    x, y = world.position("dead end")
    way = np.array([[x, y - d, 0.0] for d in (5, 3, 1, 0, 1.4, 0, 1, 3, 0)])
    nothing = np.ones((len(way), 3), np.float32)
    log = ScanLog("made", np.arange(len(way)), nothing, np.zeros(3), truth=way)
    assert truth_visits(world, log) == ["dead end", "dead end"]
    with pytest.raises(InputError, match="no true poses"):
        truth_visits(world, ScanLog("made", np.arange(9), nothing, np.zeros(3)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tour": ["dead end"]}, "at least two places"),
        ({"tour": "dead end"}, "at least two places"),
        ({"tour": ["dead end", "moon"]}, "no place 'moon'"),
        ({"tour": ["dead end", "lobby corner"]}, "from there it goes to 'east crossing'"),
        ({"controller": "magic"}, "expected 'gateways' or 'route'"),
        ({"pedestrians": -1}, "expected 0 or more"),
        ({"fov_deg": 0}, "a lidar with"),
    ],
)
def test_impossible_drives_are_refused(world, arguments, message):
    with pytest.raises(InputError, match=message):
        drive(world, **arguments)
