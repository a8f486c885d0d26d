import numpy as np
import pytest
from segment_world import HALF_TURN, box, cast, scan_points

from perception.errors import InputError
from perception.geometry import compose, wrap_angle
from perception.matching import match_scan, search_poses
from perception.surfaces import Reference, fit_normals

ROOM = np.concatenate([box(-3, -2, 5, 4), box(1.5, 1.0, 2.4, 1.6), box(-2, 2.5, -1, 4)])
CORRIDOR = np.array([[[-60.0, -1.0], [60.0, -1.0]], [[-60.0, 1.0], [60.0, 1.0]]])


def measure_error(pose, truth):
    return np.hypot(*(pose - truth)[:2]), abs(float(wrap_angle(pose[2] - truth[2])))


def test_the_caster_itself_measures_what_the_plan_says():
    ranges = cast(box(-1, -2, 3, 2), np.array([0.0, 0.0, 0.0]), np.array([-np.pi / 2, 0, np.pi]))
    np.testing.assert_allclose(ranges, [2.0, 3.0, 1.0])


def test_normals_look_at_the_laser_and_stand_on_the_wall():
    rng = np.random.default_rng(0)
    surface = fit_normals(scan_points(box(-3, -2, 4, 2), np.zeros(3), rng, noise_m=0.003))
    side = np.abs(surface.points[:, 1]) > 1.95
    across = np.abs(surface.normals[side, 1])
    assert np.nanmedian(across) > 0.995
    known = np.isfinite(surface.normals[:, 0])
    assert (np.sum(surface.normals * surface.points, axis=1)[known] <= 0).all()


def test_scattered_points_get_no_normals():
    scattered = np.random.default_rng(1).uniform(-4, 4, (60, 2))
    assert np.isnan(fit_normals(scattered).normals[:, 0]).mean() > 0.8


@pytest.mark.parametrize("seed", range(12))
def test_match_in_a_room_is_exact_to_millimetres_from_a_bad_guess(seed):
    rng = np.random.default_rng(seed)
    reference = fit_normals(scan_points(ROOM, np.zeros(3), rng))
    truth = np.array([*rng.uniform(-0.4, 0.4, 2), rng.uniform(-0.3, 0.3)])
    points = scan_points(ROOM, truth, rng)
    guess = truth + np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.35, 0.35)])
    match = match_scan(points, reference, guess, window=(0.8, 0.47))
    far, turned = measure_error(match.pose, truth)
    assert match.ok
    assert far < 0.02
    assert turned < np.radians(0.5)
    assert np.linalg.eigvalsh(match.covariance).min() > 0


def test_the_search_beats_a_guess_from_which_refinement_alone_fails():
    rng = np.random.default_rng(5)
    reference = Reference(fit_normals(scan_points(ROOM, np.zeros(3), rng)))
    truth = np.array([0.5, -0.4, 0.5])
    points = scan_points(ROOM, truth, rng)
    found = search_poses(points, reference, np.zeros(3), np.diag([0.4, 0.4, 0.3]) ** 2,
                         window=(0.8, 0.6))  # fmt: skip
    far, turned = measure_error(found, truth)
    assert far < 0.08
    assert turned < np.radians(2.5)


@pytest.mark.parametrize("heading", [0.0, 0.4, 1.2])
def test_along_a_bare_corridor_the_guess_rules_and_says_so(heading):
    rng = np.random.default_rng(3)
    reference = fit_normals(scan_points(CORRIDOR, np.array([0, 0.1, heading]), rng, reach_m=20.0))
    reference = reference.moved(np.array([0, 0.1, heading]))
    truth = np.array([0.8, -0.1, heading + 0.1])
    points = scan_points(CORRIDOR, truth, rng, reach_m=20.0)
    guess = truth + np.array([0.25, 0.08, 0.04])
    prior = np.diag([0.2, 0.1, 0.05]) ** 2
    match = match_scan(points, reference, guess, prior)
    assert match.ok
    assert abs(match.pose[1] - truth[1]) < 0.02
    assert abs(match.pose[2] - truth[2]) < np.radians(0.6)
    assert abs(match.pose[0] - guess[0]) < 0.06
    deviations = np.sqrt(np.diag(match.covariance))
    assert deviations[0] > 0.7 * 0.2
    assert deviations[1] < 0.03


def test_a_door_frame_in_the_corridor_pins_it():
    rng = np.random.default_rng(4)
    walls = np.concatenate([CORRIDOR, box(2.0, 0.7, 2.4, 1.0), box(3.5, -1.0, 4.2, -0.75)])
    reference = fit_normals(scan_points(walls, np.zeros(3), rng, reach_m=20.0))
    truth = np.array([0.8, -0.1, 0.05])
    points = scan_points(walls, truth, rng, reach_m=20.0)
    guess = truth + np.array([0.25, 0.05, 0.03])
    match = match_scan(points, reference, guess, np.diag([0.2, 0.1, 0.05]) ** 2)
    assert abs(match.pose[0] - truth[0]) < 0.03
    assert np.sqrt(match.covariance[0, 0]) < 0.06


def test_the_far_side_of_a_thin_wall_is_not_taken_for_the_near_one():
    rng = np.random.default_rng(6)
    wall = np.array([[[-4.0, 2.0], [4.0, 2.0]]])
    behind = fit_normals(scan_points(wall, np.array([0, 4.0, -np.pi / 2]), rng))
    behind = behind.moved(np.array([0, 4.0, -np.pi / 2]))
    points = scan_points(wall, np.array([0, 0, np.pi / 2]), rng)
    assert not match_scan(points, behind, [0.0, 0.0, np.pi / 2]).ok


def test_where_nothing_fits_the_guess_comes_back_with_its_covariance():
    rng = np.random.default_rng(7)
    reference = fit_normals(scan_points(ROOM, np.zeros(3), rng))
    guess, prior = np.array([30.0, 30.0, 0.0]), np.diag([0.1, 0.2, 0.3])
    match = match_scan(scan_points(ROOM, np.zeros(3), rng), reference, guess, prior)
    assert not match.ok
    np.testing.assert_array_equal(match.pose, guess)
    np.testing.assert_array_equal(match.covariance, prior)
    assert not match_scan(np.zeros((0, 2)), reference, guess, prior).ok


def test_people_walking_by_do_not_move_the_match():
    rng = np.random.default_rng(8)
    reference = fit_normals(scan_points(ROOM, np.zeros(3), rng))
    truth = np.array([0.3, 0.2, 0.15])
    crowd = [box(x, y, x + 0.3, y + 0.3) for x, y in ((1.3, -0.6), (2.0, 0.2), (0.6, 1.5))]
    points = scan_points(np.concatenate([ROOM, *crowd]), truth, rng)
    match = match_scan(points, reference, [0.15, 0.1, 0.05], window=(0.4, 0.2))
    far, turned = measure_error(match.pose, truth)
    assert far < 0.02
    assert turned < np.radians(0.5)


def test_the_answer_does_not_depend_on_the_frame():
    rng = np.random.default_rng(9)
    reference = fit_normals(scan_points(ROOM, np.zeros(3), rng))
    points = scan_points(ROOM, np.array([0.3, -0.2, 0.1]), rng)
    guess, shift = np.array([0.25, -0.1, 0.05]), np.array([12.3, -4.5, 2.9])
    prior = np.diag([0.1, 0.1, 0.05]) ** 2
    here = match_scan(points, reference, guess, prior)
    there = match_scan(points, reference.moved(shift), compose(shift, guess), prior)
    expected = compose(shift, here.pose)
    np.testing.assert_allclose(there.pose[:2], expected[:2], atol=2e-3)
    assert abs(wrap_angle(there.pose[2] - expected[2])) < 1e-3


@pytest.mark.parametrize(
    ("points", "guess", "covariance"),
    [
        (np.zeros((5, 3)), np.zeros(3), None),
        (np.full((20, 2), np.nan), np.zeros(3), None),
        (np.zeros((20, 2)), np.zeros(2), None),
        (np.zeros((20, 2)), np.array([0, np.inf, 0]), None),
        (np.zeros((20, 2)), np.zeros(3), np.eye(2)),
        (np.zeros((20, 2)), np.zeros(3), np.full((3, 3), np.nan)),
        (np.zeros((20, 2)), np.zeros(3), np.zeros((3, 3))),
    ],
)
def test_bad_input_is_told_in_one_sentence(points, guess, covariance):
    reference = scan_points(ROOM, np.zeros(3), np.random.default_rng(0))
    with pytest.raises(InputError, match=r"expected|must"):
        match_scan(points, reference, guess, covariance)


def test_matching_is_deterministic():
    rng = np.random.default_rng(10)
    reference = scan_points(ROOM, np.zeros(3), rng)
    points = scan_points(ROOM, np.array([0.2, 0.1, 0.1]), rng, HALF_TURN)
    first, second = (match_scan(points, reference, np.zeros(3)) for _ in range(2))
    np.testing.assert_array_equal(first.pose, second.pose)
    np.testing.assert_array_equal(first.covariance, second.covariance)
