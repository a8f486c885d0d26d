"""Localisation along the drive: the pose of each scan relative to the ones just before it.

Each scan is matched to a submap of the scans of the last metres of travel. Nothing older is looked
at, so the trajectory drifts slowly and loops stay open: closing them is the business of the
topological map. The covariances say how much it drifts.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array, between, compose
from perception.matching import Match, match_scan
from perception.scanlog import ScanLog
from perception.surfaces import Reference, Surface, fit_normals


@dataclass(frozen=True)
class MotionModel:
    """How far odometry is to be trusted, as standard deviations that grow with the motion.

    Attributes
    ----------
    along, across : (constant [m], per metre travelled, per radian turned [m]).
    turn : (constant [rad], per metre travelled [rad], per radian turned).
    blind : (3,) standard deviations of a step where there is no odometry at all; m, m, rad.
    """

    along: tuple[float, float, float] = (0.01, 0.06, 0.03)
    across: tuple[float, float, float] = (0.01, 0.04, 0.05)
    turn: tuple[float, float, float] = (0.007, 0.025, 0.08)
    blind: tuple[float, float, float] = (0.6, 0.3, 0.4)

    def predict(self, step: Array) -> Array:
        """Return the covariance (3, 3) of an odometry step (3,), in the frame it starts from."""
        terms = np.array([1.0, float(np.hypot(step[0], step[1])), abs(float(step[2]))])
        deviations = np.array([terms @ self.along, terms @ self.across, terms @ self.turn])
        return np.diag(deviations**2)


@dataclass(frozen=True)
class Trajectory:
    """Poses along a drive, each known relative to the one before.

    Attributes
    ----------
    poses : (n, 3) of the laser, in the frame of the first scan; m, m, rad.
    step_covariances : (n, 3, 3) of the pose of scan k in the frame of scan k - 1; 0 for k = 0.
    matched : (n,) whether the scan could be matched; if not, the step is odometry alone.
    scores : (n,) share of the scan that lies on the submap, 0 to 1.
    """

    poses: Array
    step_covariances: Array
    matched: NDArray[np.bool_]
    scores: Array

    def __len__(self) -> int:
        return len(self.poses)


def localise(
    log: ScanLog,
    *,
    progress: Callable[[int, int], None] | None = None,
    motion: MotionModel | None = None,
    travel_m: float = 12.0,
    cap_m: float = 20.0,
) -> Trajectory:
    """Estimate the pose of each scan of a drive from the scans and the odometry, if there is one.

    Parameters
    ----------
    log : scans in order; without odometry each scan is searched for around the one before.
    progress : called with (scans done, scans in all) after each scan.
    motion : trust in the odometry.
    travel_m : how much of the drive just past the submap holds, metres.
    cap_m : returns further away than this are left out, metres.

    Returns
    -------
    Trajectory, deterministic for a given log.

    Raises
    ------
    InputError
        The odometry is not one finite pose a scan.

    Source
    ------
    Takes the place of the particle filter of Beeson 2008, 4.3, in the local perceptual map; ours.
    """
    odometry = _check_odometry(log)
    model = motion or MotionModel()
    n = len(log)
    poses, covariances = np.zeros((n, 3)), np.zeros((n, 3, 3))
    matched, scores = np.zeros(n, bool), np.zeros(n)
    submap = _Submap(travel_m)
    for k in range(n):
        scan = fit_normals(log.beam_points(k, cap_m))
        if k == 0:
            matched[0], scores[0] = True, 1.0
        else:
            step = np.zeros(3) if odometry is None else between(odometry[k - 1], odometry[k])
            found = _match_step(scan, submap, poses[k - 1], step, model, blind=odometry is None)
            poses[k], matched[k], scores[k] = found.pose, found.ok, found.score
            covariances[k] = _turn_covariance(found.covariance, -poses[k - 1, 2])
        submap.add(scan, poses[k])
        if progress is not None:
            progress(k + 1, n)
    return Trajectory(poses, covariances, matched, scores)


def relative_pose(trajectory: Trajectory, i: int, j: int) -> Array:
    """Return the pose (3,) of scan j in the frame of scan i; m, m, rad."""
    return between(trajectory.poses[i], trajectory.poses[j])


def covariance_between(trajectory: Trajectory, i: int, j: int) -> Array:
    """Return the covariance (3, 3) of the pose of scan j in the frame of scan i, to first order.

    Parameters
    ----------
    trajectory : n scans.
    i, j : scans, ``0 <= i, j < n``, in any order. Errors of different steps count as independent.

    Raises
    ------
    InputError
        A scan that the trajectory does not have.

    Source
    ------
    The compounding of Smith, Self and Cheeseman, as in Beeson 2008, 9.3.1, summed in closed form.

    Examples
    --------
    >>> straight = np.column_stack([np.arange(3.0), np.zeros((3, 2))])
    >>> each = np.stack([np.diag([0.01, 0.01, 0.0001])] * 3)
    >>> drive = Trajectory(straight, each, np.ones(3, bool), np.ones(3))
    >>> covariance_between(drive, 0, 2).diagonal().round(4).tolist()
    [0.02, 0.0201, 0.0002]
    """
    n = len(trajectory)
    if not (0 <= i < n and 0 <= j < n):
        raise InputError(f"covariance_between: scans {i} and {j} asked for, there are 0 to {n - 1}")
    first, last = min(i, j), max(i, j)
    if first == last:
        return np.zeros((3, 3))
    steps = slice(first + 1, last + 1)
    poses = between(trajectory.poses[first], trajectory.poses[first : last + 1])
    before, arm = poses[:-1], poses[-1, :2] - poses[1:, :2]
    jac = np.zeros((last - first, 3, 3))
    jac[:, 0, 0] = jac[:, 1, 1] = np.cos(before[:, 2])
    jac[:, 1, 0] = np.sin(before[:, 2])
    jac[:, 0, 1] = -jac[:, 1, 0]
    jac[:, 0, 2], jac[:, 1, 2] = -arm[:, 1], arm[:, 0]  # a turn swings all that follows
    jac[:, 2, 2] = 1.0
    forward = np.einsum("kij,kjl,kml->im", jac, trajectory.step_covariances[steps], jac)
    if i < j:
        return np.asarray(forward)
    x, y, turn = poses[-1]
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[-c, -s, s * x - c * y], [s, -c, c * x + s * y], [0.0, 0.0, -1.0]])
    return np.asarray(back @ forward @ back.T)


@dataclass
class _Submap:
    """The scans of the last metres of travel, one every half metre or 20 degrees."""

    travel_m: float
    stride_m: float = 0.5
    stride_rad: float = 0.35
    _surfaces: deque[Surface] = field(default_factory=deque)
    _stations: deque[Array] = field(default_factory=deque)
    _reference: Reference | None = None

    def add(self, scan: Surface, pose: Array) -> None:
        """Take in a scan if the robot has moved enough since the last one that was."""
        if len(scan) == 0:
            return
        if self._stations:
            step = between(self._stations[-1], pose)
            if np.hypot(step[0], step[1]) < self.stride_m and abs(step[2]) < self.stride_rad:
                return
        self._surfaces.append(scan.moved(pose))
        self._stations.append(pose)
        way = np.hypot(*np.diff(np.array(self._stations)[:, :2], axis=0).T).sum()
        while way > self.travel_m and len(self._stations) > 2:
            way -= float(np.hypot(*(self._stations[1] - self._stations[0])[:2]))
            self._surfaces.popleft()
            self._stations.popleft()
        self._reference = None

    def make_reference(self) -> Reference | None:
        """Return what there is to match to."""
        if self._reference is None and self._surfaces:
            parts = list(self._surfaces)
            self._reference = Reference(
                Surface(
                    np.concatenate([s.points for s in parts]),
                    np.concatenate([s.normals for s in parts]),
                    np.concatenate([s.spacing_m for s in parts]),
                )
            )
        return self._reference


def _match_step(
    scan: Surface,
    submap: _Submap,
    last: Array,
    step: Array,
    model: MotionModel,
    *,
    blind: bool,
) -> Match:
    """Match a scan from where odometry puts it; look further afield where that finds nothing."""
    guess = compose(last, step)
    local = np.diag(model.blind) ** 2 if blind else model.predict(step)
    prior = _turn_covariance(local, last[2])
    reference = submap.make_reference()
    if reference is None:
        return Match(guess, prior, 0.0, False)
    if blind:
        return match_scan(scan, reference, guess, prior, window=(1.4, 0.8))
    deviations = np.sqrt(np.diag(local))
    window = (max(0.1, 3 * deviations[:2].max()), max(0.06, 3 * deviations[2]))
    found = match_scan(scan, reference, guess, prior, window=window)
    if found.ok:
        return found
    wide = match_scan(scan, reference, guess, prior * 16.0, window=(0.8, 0.6))
    return wide if wide.ok else found


def _turn_covariance(covariance: Array, angle_rad: float) -> Array:
    """Turn the covariance of a pose into a frame turned by minus the angle."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T)


def _check_odometry(log: ScanLog) -> Array | None:
    if log.odometry is None:
        return None
    odometry = np.asarray(log.odometry, float)
    if odometry.shape != (len(log), 3) or not np.isfinite(odometry).all():
        raise InputError(
            f"{log.source}: odometry must be one finite pose (x, y, theta) a scan, "
            f"found shape {odometry.shape} for {len(log)} scans"
        )
    return odometry
