"""Rooms of wall segments and a lidar in them, small enough to be trusted: for the tests only."""

import numpy as np

from perception.geometry import between, compose
from perception.scanlog import ScanLog

HALF_TURN = np.radians(np.arange(-90.0, 90.5, 1.0))


def box(x0, y0, x1, y1):
    """The four walls (4, 2, 2) of a rectangle."""
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def cast(walls, pose, angles, reach_m=30.0):
    """Ranges (b,) from a pose along beams; inf where no wall is within reach."""
    heading = pose[2] + angles
    ray = np.column_stack([np.cos(heading), np.sin(heading)])[:, None]
    start, along = walls[:, 0] - pose[:2], walls[:, 1] - walls[:, 0]
    cross = ray[..., 0] * along[:, 1] - ray[..., 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        where = (start[:, 0] * ray[..., 1] - start[:, 1] * ray[..., 0]) / cross
    hit = (far > 0) & (far < reach_m) & (where >= 0) & (where <= 1)
    return np.where(hit, far, np.inf).min(1)


def scan_points(walls, pose, rng, angles=HALF_TURN, noise_m=0.01, reach_m=30.0):
    """End points (k, 2) of a noisy scan, laser frame."""
    ranges = cast(walls, pose, angles, reach_m)
    ranges = ranges + noise_m * rng.standard_normal(len(ranges))
    keep = np.isfinite(ranges)
    ranges, angles = ranges[keep], angles[keep]
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])


def follow(corners, step_m=0.5, step_rad=0.3):
    """Poses (n, 3) along a polyline, turning in place at its corners."""
    corners = np.asarray(corners, float)
    legs = np.diff(corners, axis=0)
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    poses = []
    for k, leg in enumerate(legs):
        if k:
            bend = (headings[k] - headings[k - 1] + np.pi) % (2 * np.pi) - np.pi
            turns = np.arange(step_rad, abs(bend), step_rad) * np.sign(bend)
            poses += [[*corners[k], headings[k - 1] + t] for t in turns]
        length = np.hypot(*leg)
        for s in np.linspace(0, 1, max(2, round(length / step_m) + 1))[:-1]:
            poses.append([*(corners[k] + s * leg), headings[k]])
    return np.array(poses)


def make_odometry(truth, rng, scale=1.0, spread=(0.03, 0.02, 0.03), drift_rad_per_m=0.0):
    """Odometry (n, 3) of a drive: a wrong scale, a drift, and noise in proportion to the motion."""
    steps = between(truth[:-1], truth[1:])
    way = np.hypot(steps[:, 0], steps[:, 1])
    noise = rng.standard_normal(steps.shape)
    steps[:, 0] = steps[:, 0] * scale + spread[0] * way * noise[:, 0]
    steps[:, 1] += spread[1] * way * noise[:, 1]
    steps[:, 2] += drift_rad_per_m * way
    steps[:, 2] += spread[2] * (np.abs(steps[:, 2]) + 0.3 * way) * noise[:, 2]
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def drive_log(walls, truth, odometry, rng, angles=HALF_TURN, noise_m=0.01, reach_m=30.0):
    """A scan log of a drive."""
    ranges = np.stack([cast(walls, pose, angles, reach_m) for pose in truth])
    ranges = ranges + noise_m * rng.standard_normal(ranges.shape)
    ranges[~np.isfinite(ranges)] = np.nan
    times = np.arange(len(truth), dtype=float)
    return ScanLog("a drive", times, ranges.astype(np.float32), angles, odometry, truth=truth)
