import dataclasses

import numpy as np
import pytest
from segment_world import box, drive_log, follow, make_odometry

from perception.errors import InputError, NoAnswerError
from perception.geometry import between, compose, wrap_angle
from perception.localise import Trajectory, covariance_between, localise, relative_pose
from perception.motion import MotionModel, OdometryFit, SteadyMotion
from perception.submap import Submap

RING = np.concatenate(
    [
        box(0, 0, 16, 12),
        box(2, 2, 14, 10),
        *(box(x, 0, x + 0.9, 0.12) for x in (3.0, 6.2, 8.3, 12.1)),
        *(box(15.9, y, 16, y + 0.9) for y in (2.5, 5.0, 7.7)),
        *(box(x, 11.9, x + 0.9, 12) for x in (2.2, 7.0, 11.0)),
    ]
)
ROUTE = [(1, 1), (15, 1), (15, 11), (1, 11), (1, 4)]


@pytest.fixture(scope="module")
def drive():
    rng = np.random.default_rng(11)
    truth = follow(ROUTE, step_m=0.5)
    odometry = make_odometry(truth, rng, scale=0.97, drift_rad_per_m=0.02)
    return drive_log(RING, truth, odometry, rng)


@pytest.fixture(scope="module")
def trajectory(drive):
    return localise(drive)


def measure_errors(trajectory, truth, length):
    """Errors (k, 3) of relative poses over a number of scans."""
    i = np.arange(0, len(truth) - length)
    ours = between(trajectory.poses[i], trajectory.poses[i + length])
    return between(between(truth[i], truth[i + length]), ours)


def test_a_drive_round_a_ring_stays_within_centimetres(drive, trajectory):
    far = np.hypot(*measure_errors(trajectory, drive.truth, 10)[:, :2].T)
    assert np.median(far) < 0.03
    end = relative_pose(trajectory, 0, len(drive) - 1)
    true_end = between(drive.truth[0], drive.truth[-1])
    raw_end = between(drive.odometry[0], drive.odometry[-1])
    assert np.hypot(*(end - true_end)[:2]) < 0.4
    assert np.hypot(*(raw_end - true_end)[:2]) > 3.0
    assert trajectory.matched.all()


def test_covariances_cover_the_errors_without_hiding_behind_them(drive, trajectory):
    for length in (4, 15, 40):
        scores = []
        for i in range(0, len(drive) - length, 3):
            error = between(drive.truth[i], drive.truth[i + length])
            error = relative_pose(trajectory, i, i + length) - error
            error[2] = wrap_angle(error[2])
            covariance = covariance_between(trajectory, i, i + length)
            scores.append(error @ np.linalg.solve(covariance, error) / 3)
        assert 0.01 < np.mean(scores) < 2.0


def test_localisation_is_deterministic_and_reports_progress(drive, trajectory):
    seen = []
    again = localise(drive, progress=lambda done, total: seen.append((done, total)))
    np.testing.assert_array_equal(again.poses, trajectory.poses)
    np.testing.assert_array_equal(again.step_covariances, trajectory.step_covariances)
    assert seen[0] == (1, len(drive))
    assert seen[-1] == (len(drive), len(drive))


def test_without_odometry_a_dense_drive_is_still_followed():
    rng = np.random.default_rng(12)
    truth = follow([(1, 1), (15, 1), (15, 8)], step_m=0.15, step_rad=0.15)
    log = drive_log(RING, truth, None, rng)
    trajectory = localise(log)
    far = np.hypot(*measure_errors(trajectory, truth, 20)[:, :2].T)
    assert np.median(far) < 0.1
    assert far.max() < 0.5


def test_in_a_bare_corridor_odometry_tells_the_way_and_its_doubt_grows():
    rng = np.random.default_rng(13)
    walls = np.array([[[-90.0, -1.0], [90.0, -1.0]], [[-90.0, 1.0], [90.0, 1.0]]])
    truth = follow([(0, 0), (20, 0)], step_m=0.5)
    odometry = make_odometry(truth, rng, spread=(0.0, 0.01, 0.02))
    trajectory = localise(drive_log(walls, truth, odometry, rng, reach_m=20.0))
    np.testing.assert_allclose(trajectory.poses[:, 1], 0.0, atol=0.05)
    np.testing.assert_allclose(trajectory.poses[:, 0], truth[:, 0], atol=0.3)
    near, far = (covariance_between(trajectory, 0, j) for j in (10, 39))
    assert far[0, 0] > 2.5 * near[0, 0]
    assert far[0, 0] > 10 * trajectory.step_covariances[20, 1, 1]
    assert np.sqrt(far[0, 0]) > 0.15


def test_scans_without_returns_fall_back_to_odometry_with_its_covariance(drive):
    blinded = drive.ranges_m.copy()
    blinded[20:24] = np.nan
    blind = localise(dataclasses.replace(drive, ranges_m=blinded))
    assert not blind.matched[20:24].any()
    assert blind.matched[24:].all()
    step = relative_pose(blind, 20, 21)
    odometry = between(drive.odometry[20], drive.odometry[21])
    np.testing.assert_allclose(step, odometry, atol=0.05)
    clear = localise(drive)
    assert np.trace(blind.step_covariances[21]) > 4 * np.trace(clear.step_covariances[21])
    wide, narrow = (covariance_between(t, 18, 26) for t in (blind, clear))
    assert np.trace(wide) > np.trace(narrow) * 0.9
    far = np.hypot(*measure_errors(blind, drive.truth, 10)[:, :2].T)
    assert np.median(far) < 0.06


def test_a_log_of_nothing_but_blind_scans_is_its_odometry():
    odometry = np.column_stack([np.arange(6.0), np.zeros((6, 2))])
    truth = odometry.copy()
    log = drive_log(RING + 500.0, truth, odometry, np.random.default_rng(0))
    trajectory = localise(log)
    np.testing.assert_allclose(trajectory.poses, odometry)
    assert not trajectory.matched[1:].any()
    model = MotionModel()
    for k in range(1, 6):
        expected = model.predict(np.array([1.0, 0.0, 0.0]))
        np.testing.assert_allclose(trajectory.step_covariances[k], expected)


def test_a_slipping_turn_is_caught(drive):
    slipped = drive.odometry.copy()
    at = 40
    bend = between(slipped[at - 1], slipped[at])
    bend[2] += np.radians(25)
    moved = compose(slipped[at - 1], bend)
    rest = between(slipped[at], slipped[at:])
    slipped[at:] = compose(moved, rest)
    trajectory = localise(dataclasses.replace(drive, odometry=slipped))
    step = between(relative_pose(trajectory, at - 1, at), between(*drive.truth[at - 1 : at + 1]))
    assert abs(step[2]) < np.radians(1)
    assert np.hypot(step[0], step[1]) < 0.05


def test_standing_still_adds_no_doubt():
    rng = np.random.default_rng(17)
    walls = np.array([[[-90.0, -1.0], [90.0, -1.0]], [[-90.0, 1.0], [90.0, 1.0]]])
    truth = np.concatenate([follow([(0, 0), (3, 0)], step_m=0.5), np.tile([3.0, 0, 0], (80, 1))])
    log = drive_log(walls, truth, truth.copy(), rng, reach_m=20.0)
    trajectory = localise(log)
    still = relative_pose(trajectory, 10, 85)
    assert np.hypot(still[0], still[1]) < 0.03
    assert np.sqrt(covariance_between(trajectory, 10, 85)[0, 0]) < 0.1


def test_people_in_front_of_the_robot_do_not_derail_it(drive):
    rng = np.random.default_rng(14)
    ranges = drive.ranges_m.copy()
    for k in range(len(drive)):
        for _ in range(3):
            beam, width = rng.integers(20, 150), rng.integers(5, 16)
            people = np.float32(rng.uniform(0.6, 1.5))
            ranges[k, beam : beam + width] = np.fmin(ranges[k, beam : beam + width], people)
    trajectory = localise(dataclasses.replace(drive, ranges_m=ranges))
    far = np.hypot(*measure_errors(trajectory, drive.truth, 10)[:, :2].T)
    assert np.median(far) < 0.05
    assert far.max() < 0.3


def test_covariance_between_equals_propagated_samples():
    rng = np.random.default_rng(15)
    steps = np.column_stack([rng.uniform(0.3, 1, 12), 0.1 * rng.standard_normal(12),
                             rng.uniform(-0.7, 0.7, 12)])  # fmt: skip
    deviations = np.array([0.004, 0.002, 0.003])
    poses = np.zeros((13, 3))
    drawn = np.zeros((13, 20000, 3))
    for k, step in enumerate(steps):
        poses[k + 1] = compose(poses[k], step)
        noise = deviations * rng.standard_normal((20000, 3))
        drawn[k + 1] = compose(drawn[k], step + noise)
    each = np.tile(np.diag(deviations**2), (13, 1, 1))
    trajectory = Trajectory(poses, each, np.ones(13, bool), np.ones(13))
    for i, j in ((2, 11), (11, 2), (0, 12), (12, 5)):
        spread = np.cov(between(drawn[i], drawn[j]).T)
        computed = covariance_between(trajectory, i, j)
        np.testing.assert_allclose(computed, spread, atol=0.06 * np.abs(spread).max())


def test_covariance_between_runs_over_key_scans():
    poses = np.column_stack([np.arange(7.0) / 2, np.zeros((7, 2))])
    unit = np.tile(np.diag([1e-4, 1e-4, 1e-6]), (7, 1, 1))
    keys = np.array([0, 0, 0, 0, 3, 3, 3])
    trajectory = Trajectory(poses, unit, np.ones(7, bool), np.ones(7), keys, unit)
    assert covariance_between(trajectory, 0, 6)[0, 0] == pytest.approx(2e-4)
    assert covariance_between(trajectory, 1, 2)[0, 0] == pytest.approx(2e-4)
    assert covariance_between(trajectory, 1, 5)[0, 0] == pytest.approx(3e-4)
    assert covariance_between(trajectory, 3, 5)[0, 0] == pytest.approx(1e-4)
    assert not covariance_between(trajectory, 4, 4).any()


def test_a_scan_that_is_not_there_is_an_input_error(trajectory):
    with pytest.raises(InputError, match="there are 0 to"):
        covariance_between(trajectory, 0, len(trajectory))


@pytest.mark.parametrize("odometry", [np.zeros((3, 3)), np.full((113, 3), np.nan)])
def test_odometry_of_the_wrong_length_or_not_finite_is_an_input_error(drive, odometry):
    with pytest.raises(InputError, match="one finite pose"):
        localise(dataclasses.replace(drive, odometry=odometry))


def test_an_empty_log_has_an_empty_trajectory(drive):
    empty = dataclasses.replace(
        drive, times_s=np.zeros(0), ranges_m=drive.ranges_m[:0], odometry=None
    )
    assert len(localise(empty)) == 0


def test_the_action_model_learns_scale_and_drift():
    rng = np.random.default_rng(16)
    fit = OdometryFit(MotionModel())
    for _ in range(200):
        step = np.array([rng.uniform(0.3, 1.0), 0.0, rng.uniform(-0.5, 0.5)])
        measured = np.array([step[0] * 1.04, 0.0, step[2] * 0.95 + 0.03 * step[0]])
        fit.learn(step, measured + 0.002 * rng.standard_normal(3), np.ones(3))
    corrected = fit.correct(np.array([1.0, 0.0, 0.4]))
    np.testing.assert_allclose(corrected, [1.04, 0.0, 0.41], atol=0.008)
    before = MotionModel().predict(np.array([1.0, 0.0, 0.4]))
    assert np.trace(fit.predict(np.array([1.0, 0.0, 0.4]))) < np.trace(before)


def test_the_action_model_learns_nothing_from_slips_or_from_what_scans_leave_open():
    fit = OdometryFit(MotionModel())
    step = np.array([1.0, 0.0, 0.0])
    fit.learn(step, np.array([3.0, 2.0, 1.0]), np.ones(3))
    fit.learn(step, np.array([1.05, 0.02, 0.02]), np.zeros(3))
    np.testing.assert_array_equal(fit.correct(step), step)


def test_without_odometry_the_last_speed_is_expected_again():
    steady = SteadyMotion(MotionModel())
    for _ in range(60):
        steady.learn(np.array([0.5, 0.0, 0.0]), np.ones(3))
    assert steady.correct()[0] == 0.5
    assert np.sqrt(steady.predict()[0, 0]) < 0.2


def test_an_empty_submap_says_so():
    with pytest.raises(NoAnswerError, match="empty"):
        Submap(5.0).make_reference()
