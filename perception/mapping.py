"""The global metrical map m*: all scans of a drive drawn from a known trajectory.

Source: Beeson 2008, sections 9.3.3 (trajectory) and 9.3.4 (map).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from perception.geometry import Array, compose, wrap_angle
from perception.grid import Frame
from perception.lpm import OccupancyGrid
from perception.scanlog import ScanLog


def draw_map(
    log: ScanLog, poses: Array, *, resolution_m: float = 0.1, range_cap_m: float = 12.0
) -> OccupancyGrid:
    """Draw all scans into one grid that just holds them.

    Parameters
    ----------
    log : the scans. poses : (n, 3) poses of the laser, map frame.
    resolution_m : side of a cell. range_cap_m : see :class:`perception.lpm.OccupancyGrid`.
    """
    margin = range_cap_m + 1.0
    low, high = poses[:, :2].min(0) - margin, poses[:, :2].max(0) + margin
    columns, rows = np.ceil((high - low) / resolution_m).astype(int) + 1
    grid = OccupancyGrid(
        Frame(float(low[0]), float(high[1]), resolution_m), (int(rows), int(columns)), range_cap_m
    )
    for i in range(len(log)):
        grid.add_scan(poses[i], log.ranges_m[i], log.angles_rad)
    return cropped(grid)


def cropped(grid: OccupancyGrid, margin_cells: int = 10) -> OccupancyGrid:
    """Return the grid cut to what is known, with a margin."""
    rows, columns = np.nonzero(grid.log_odds)
    if rows.size == 0:
        return grid
    top, left = max(rows.min() - margin_cells, 0), max(columns.min() - margin_cells, 0)
    bottom, right = rows.max() + 1 + margin_cells, columns.max() + 1 + margin_cells
    frame = grid.frame
    out = OccupancyGrid(
        Frame(
            frame.left_m + float(left) * frame.resolution_m,
            frame.top_m - float(top) * frame.resolution_m,
            frame.resolution_m,
        ),
        (0, 0),
        grid.range_cap_m,
    )
    out.log_odds = grid.log_odds[top:bottom, left:right].copy()
    return out


def bend_trajectory(poses: Array, anchors: Sequence[int], anchor_poses: Array) -> Array:
    """Fit a locally measured trajectory to poses known at some of its scans.

    Between two anchors the discrepancy is spread in proportion to the motion: heading first, then
    position. Before the first and after the last anchor the trajectory is moved rigidly.

    Parameters
    ----------
    poses : (n, 3) measured, drive frame. anchors : increasing scan indices.
    anchor_poses : (k, 3) poses of those scans, map frame.

    Returns
    -------
    (n, 3) poses in the map frame.

    Source
    ------
    Beeson 2008, section 9.3.3; spreading the heading along the path before the position is ours.

    Examples
    --------
    >>> line = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> bend_trajectory(line, [0, 2], np.array([[0.0, 0, 0], [2.2, 0, 0]]))[1].tolist()
    [1.1, 0.0, 0.0]
    """
    if not len(anchors):
        return poses.copy()
    out = np.empty_like(poses)
    out[: anchors[0] + 1] = _moved(poses[: anchors[0] + 1], poses[anchors[0]], anchor_poses[0])
    out[anchors[-1] :] = _moved(poses[anchors[-1] :], poses[anchors[-1]], anchor_poses[-1])
    for (i, pose_i), (j, pose_j) in zip(
        zip(anchors[:-1], anchor_poses[:-1], strict=True),
        zip(anchors[1:], anchor_poses[1:], strict=True),
        strict=True,
    ):
        out[i : j + 1] = _bent(poses[i : j + 1], pose_i, pose_j)
    return out


def _moved(poses: Array, fixed: Array, target: Array) -> Array:
    """Move poses rigidly so that ``fixed`` comes to lie on ``target``."""
    turn = target[2] - fixed[2]
    c, s = np.cos(turn), np.sin(turn)
    d = poses[:, :2] - fixed[:2]
    xy = np.column_stack([c * d[:, 0] - s * d[:, 1], s * d[:, 0] + c * d[:, 1]]) + target[:2]
    return np.column_stack([xy, wrap_angle(poses[:, 2] + turn)])


def _bent(poses: Array, start: Array, end: Array) -> Array:
    steps = np.diff(poses, axis=0)
    length = np.hypot(steps[:, 0], steps[:, 1])
    effort = length + 0.3 * np.abs(wrap_angle(steps[:, 2])) + 1e-9
    share = np.concatenate([[0.0], np.cumsum(effort) / effort.sum()])
    moved = _moved(poses, poses[0], start)
    turn = share * wrap_angle(end[2] - moved[-1, 2])
    middle = 0.5 * (turn[1:] + turn[:-1])
    d = np.diff(moved[:, :2], axis=0)
    c, s = np.cos(middle), np.sin(middle)
    d = np.column_stack([c * d[:, 0] - s * d[:, 1], s * d[:, 0] + c * d[:, 1]])
    xy = start[:2] + np.vstack([np.zeros(2), np.cumsum(d, axis=0)])
    xy += share[:, None] * (end[:2] - xy[-1])
    return np.column_stack([xy, wrap_angle(moved[:, 2] + turn)])


def mean_distance_m(poses: Array, reference: Array) -> float:
    """Return the mean distance of two trajectories after the best rigid alignment, metres.

    Source
    ------
    Absolute trajectory error with least-squares (Umeyama) alignment, no scale.
    """
    a, b = poses[:, :2], reference[:, :2]
    ca, cb = a.mean(0), b.mean(0)
    u, _, vt = np.linalg.svd((a - ca).T @ (b - cb))
    sign = np.sign(np.linalg.det(u @ vt))
    rotation = (u @ np.diag([1.0, sign]) @ vt).T
    aligned = (a - ca) @ rotation.T + cb
    return float(np.hypot(*(aligned - b).T).mean())


def chain_poses(steps: Array) -> Array:
    """Return the poses (n + 1, 3) reached by composing n relative steps from the origin."""
    out = np.zeros((len(steps) + 1, 3))
    for i, step in enumerate(steps):
        out[i + 1] = compose(out[i], step)
    return out
