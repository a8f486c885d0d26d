import numpy as np

from perception.geometry import between
from perception.mapping import bend_trajectory, chain_poses, draw_map, mean_distance_m
from perception.scanlog import ScanLog


def arc(n=60, step=0.5, turn=0.05):
    return chain_poses(np.tile([step, 0.0, turn], (n, 1)))


def test_chain_is_inverted_by_between():
    poses = arc()
    assert np.allclose(between(poses[:-1], poses[1:]), [0.5, 0, 0.05])


def test_bent_trajectory_passes_through_its_anchors_and_keeps_its_shape_when_they_agree():
    poses = arc()
    assert np.allclose(bend_trajectory(poses, [3, 40], poses[[3, 40]]), poses)


def test_heading_drift_is_taken_out_between_anchors():
    rng = np.random.default_rng(3)
    truth = arc()
    steps = between(truth[:-1], truth[1:])
    steps[:, 2] += 0.01 + rng.normal(0, 0.002, len(steps))
    drifted = chain_poses(steps)
    bent = bend_trajectory(drifted, [0, 30, 60], truth[[0, 30, 60]])
    assert np.allclose(bent[[0, 30, 60]], truth[[0, 30, 60]])
    before = np.hypot(*(drifted - truth)[:, :2].T).max()
    after = np.hypot(*(bent - truth)[:, :2].T).max()
    assert after < 0.05 * before


def test_ends_move_rigidly():
    poses = arc()
    target = np.array([[5.0, -2.0, 1.0], [6.0, 3.0, 2.0]])
    bent = bend_trajectory(poses, [10, 20], target)
    assert np.allclose(between(bent[:10], bent[1:11]), between(poses[:10], poses[1:11]))
    assert np.allclose(between(bent[20:-1], bent[21:]), between(poses[20:-1], poses[21:]))


def test_mean_distance_ignores_the_frame():
    poses = arc()
    turned = np.column_stack([-poses[:, 1] + 4, poses[:, 0] - 7, poses[:, 2] + np.pi / 2])
    assert mean_distance_m(turned, poses) < 1e-9
    assert mean_distance_m(turned * [1.1, 1, 1], poses) > 0.05


def test_map_of_a_ring_wall():
    angles = np.deg2rad(np.arange(-180.0, 180.0))
    ranges = np.full((3, 360), 4.0, np.float32)
    log = ScanLog("test", np.arange(3.0), ranges, angles)
    grid = draw_map(log, np.zeros((3, 3)))
    rows, columns = np.nonzero(grid.image() == 0)
    radius = np.hypot(*grid.frame.to_metres(np.column_stack([columns, rows])).T)
    assert np.all(np.abs(radius - 4.0) < 0.1)
    assert len(rows) > 200
