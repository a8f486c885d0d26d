"""The simulated lidar and odometry."""

import numpy as np
import pytest

from perception.errors import InputError
from perception.geometry import between
from perception.simulate import (
    Lidar,
    OdometryNoise,
    cast_discs,
    cast_rays,
    drift_odometry,
    measure_scans,
)
from perception.world import load_world


def cast_plainly(segments, pose, angles):
    """The same by the book: every beam against every segment."""
    heading = pose[2] + angles[:, None]
    d = np.stack([np.cos(heading), np.sin(heading)])
    p = segments[:, :2] - pose[:2]
    e = segments[:, 2:] - segments[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = d[0] * e[:, 1] - d[1] * e[:, 0]
        distance = (p[:, 0] * e[:, 1] - p[:, 1] * e[:, 0]) / across
        along = (p[:, 0] * d[1] - p[:, 1] * d[0]) / across
    hit = (distance >= 0) & (along >= -1e-9) & (along <= 1 + 1e-9)
    return np.where(hit, distance, np.inf).min(axis=1)


@pytest.mark.parametrize("fov_deg", [90, 180, 270, 360])
def test_casting_agrees_with_the_plain_way(fov_deg):
    rng = np.random.default_rng(1)
    segments = rng.uniform(-10, 10, (80, 4))
    angles = Lidar(fov_deg=fov_deg, beams=181).angles_rad
    poses = np.column_stack([rng.uniform(-8, 8, (60, 2)), rng.uniform(-7, 7, 60)])
    found = cast_rays(segments, poses, angles, 1e6)
    wanted = np.array([cast_plainly(segments, pose, angles) for pose in poses])
    np.testing.assert_allclose(np.nan_to_num(found, nan=np.inf), wanted, rtol=1e-9)


def test_no_beam_slips_through_the_corners_of_a_closed_room():
    turn = np.linspace(0, 2 * np.pi, 9)[:-1]
    corners = 5 * np.column_stack([np.cos(turn), np.sin(turn)])
    segments = np.hstack([corners, np.roll(corners, -1, axis=0)])
    angles = Lidar(fov_deg=360, beams=721).angles_rad  # beams right into every corner
    poses = np.array([[0, 0, 0], [0, 0, np.pi / 4], [1, 1, 0.1]])
    assert np.isfinite(cast_rays(segments, poses, angles)).all()


def test_a_wall_seen_edge_on_begins_at_its_nearer_end():
    wall = np.array([[3.0, 0.3, 8.0, 0.3], [9.0, 0.3, 9.0, 5.0]])
    for turn in np.linspace(0, 6, 25):  # rounding differs from one frame to the next
        c, s = np.cos(turn), np.sin(turn)
        rotated = (wall.reshape(-1, 2) @ np.array([[c, s], [-s, c]])).reshape(-1, 4)
        at = np.array([[c, s], [-s, c]]).T @ [0.0, 0.3]
        pose = np.array([[*at, turn]])
        found = cast_rays(rotated, pose, np.array([-0.5, 0.0, 0.5]))[0, 1]
        assert found == pytest.approx(3.0, abs=1e-6)


def test_ranges_end_at_the_maximum():
    wall = np.array([[10.0, -50, 10, 50]])
    angles = Lidar(beams=5).angles_rad
    assert np.isnan(cast_rays(wall, np.zeros((1, 3)), angles, 9.0)).all()
    assert cast_rays(wall, np.zeros((1, 3)), angles, 12.0)[0, 2] == pytest.approx(10)


def test_a_person_stands_before_the_wall():
    poses = np.array([[0, 0, 0.0], [0, 0, np.pi / 2]])
    centres = np.array([[[3.0, 0.0]], [[3.0, 0.0]]])
    distance = cast_discs(centres, 0.25, poses, np.array([-0.5, 0.0, 0.5]))
    assert distance[0].tolist() == [np.inf, 2.75, np.inf]
    assert np.isinf(distance[1]).all()
    wall = np.array([[10.0, -50, 10, 50]])
    rng = np.random.default_rng(0)
    scans = measure_scans(wall, poses[:1], Lidar(beams=3, dropout=0), rng, centres[:1])
    assert scans[0, 1] == pytest.approx(2.75, abs=0.1)


def test_noise_and_dropout_are_as_told():
    wall = np.array([[4.0, -500, 4, 500]])
    lidar = Lidar(fov_deg=10, beams=3, noise_m=0.02, dropout=0.1)
    scans = measure_scans(wall, np.zeros((4000, 3)), lidar, np.random.default_rng(0))
    middle = scans[:, 1]
    assert np.isnan(middle).mean() == pytest.approx(0.1, abs=0.02)
    assert np.nanstd(middle) == pytest.approx(0.02, rel=0.1)
    assert np.nanmean(middle) == pytest.approx(4.0, abs=0.002)


def test_odometry_drifts_with_the_way_and_not_with_the_number_of_steps():
    noise = OdometryNoise(veer_rad_per_m=0, scale=0)
    ends = {}
    for steps in (50, 500):
        truth = np.column_stack([np.linspace(0, 100, steps + 1), np.zeros((steps + 1, 2))])
        ends[steps] = np.array(
            [drift_odometry(truth, np.random.default_rng(s), noise)[-1] for s in range(400)]
        )
    for found in ends.values():
        assert found[:, 2].std() == pytest.approx(np.sqrt(100 * noise.turn_by_way), rel=0.15)
    assert ends[50][:, 0].std() == pytest.approx(ends[500][:, 0].std(), rel=0.2)


def test_odometry_without_noise_is_the_truth():
    rng = np.random.default_rng(0)
    truth = np.cumsum(rng.normal(0, 0.1, (50, 3)), axis=0)
    silent = OdometryNoise(0, 0, 0, 0, 0, 0)
    odometry = drift_odometry(truth, rng, silent)
    np.testing.assert_allclose(between(truth[:1], truth), odometry, atol=1e-9)


def test_seeds_decide():
    world = load_world()
    poses = np.array([[10.0, 5.0, 0.3]])
    first, again, other = (
        measure_scans(world.segments, poses, Lidar(), np.random.default_rng(s)) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other, equal_nan=True)


@pytest.mark.parametrize(
    "wrong", [{"fov_deg": 400}, {"beams": 2}, {"max_range_m": 0}, {"noise_m": -1}, {"dropout": 1}]
)
def test_impossible_lidars_are_refused(wrong):
    with pytest.raises(InputError, match="lidar"):
        Lidar(**wrong)


def test_uneven_beams_are_refused():
    with pytest.raises(InputError, match="evenly spaced"):
        cast_rays(np.zeros((1, 4)), np.zeros((1, 3)), np.array([0.0, 0.1, 0.5]))
