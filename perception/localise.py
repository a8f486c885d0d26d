"""Localisation along the drive: the pose of each scan relative to the ones just before it.

Each scan is matched to a submap of the scans of the last metres of travel. Nothing older is looked
at, so the trajectory drifts slowly and loops stay open: closing them is the business of the
topological map. The covariances say how much it drifts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from perception.errors import InputError
from perception.geometry import Array, between, compose, compose_covariance
from perception.matching import Match, match_scan
from perception.motion import MotionModel, OdometryFit, SteadyMotion
from perception.scanlog import ScanLog
from perception.submap import Submap
from perception.surfaces import Surface, fit_normals
from perception.trajectory import Trajectory, covariance_between, relative_pose

__all__ = ["Trajectory", "covariance_between", "localise", "relative_pose"]

WEAK_SCORE = 0.6
"""Where a smaller share of the scan than this lies on the submap, the search goes further."""
WIDE_WINDOWS = ((0.8, 0.6), (0.8, 2.0))
"""Half widths of those searches, metres and radians: slipping wheels, lost odometry."""
WIDEST = (1.5, 1.2)
"""Largest half widths of the first search, metres and radians."""


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
    motion : trust in the odometry before the drive has shown how good it is.
    travel_m : how much of the drive just past the submap holds, metres.
    cap_m : returns further away than this are left out, metres.

    Returns
    -------
    Trajectory, deterministic for a given log.

    Notes
    -----
    Without odometry the scans should be no more than some decimetres apart: how far a robot has
    come along a corridor between scans metres apart cannot be seen, and doors that look alike are
    then taken for each other, more than the covariances say.

    Raises
    ------
    InputError
        The odometry is not one finite pose a scan.

    Source
    ------
    Takes the place of the particle filter of Beeson 2008, 4.3, in the local perceptual map; the
    narrow search that grows where it finds nothing plays the part of his shrink-and-grow. Ours.
    """
    odometry = _check_odometry(log)
    n = len(log)
    tracker = _Tracker(n, motion or MotionModel(), travel_m, odometry)
    for k in range(n):
        tracker.advance(k, fit_normals(log.beam_points(k, cap_m)))
        if progress is not None:
            progress(k + 1, n)
    return tracker.drive


class _Tracker:
    """The state of the localisation: the submap, the last key scan, what odometry is worth."""

    def __init__(self, n: int, model: MotionModel, travel_m: float, odometry: Array | None) -> None:
        self._keys = np.zeros(n, np.intp)
        self._spreads = np.zeros((n, 3, 3))
        self.drive = Trajectory(
            np.zeros((n, 3)),
            np.zeros((n, 3, 3)),
            np.zeros(n, bool),
            np.zeros(n),
            self._keys,
            self._spreads,
        )
        self._odometry = odometry
        self._fit, self._steady = OdometryFit(model), SteadyMotion(model)
        self._submap = Submap(travel_m)
        self._key = 0

    def advance(self, k: int, scan: Surface) -> None:
        """Find the pose of scan k and take it into the submap."""
        drive, key = self.drive, self._key
        if k == 0:
            drive.matched[0], drive.scores[0] = True, 1.0
            self._submap.add(scan, drive.poses[0])
            return
        last = drive.poses[k - 1]
        step, trust = self._predict(k)
        held = between(drive.poses[key], last)
        known = self._spreads[k - 1] if k - 1 != key else np.zeros((3, 3))
        prior = compose_covariance(held, known, step, trust)
        found = self._match(scan, compose(last, step), _turn(prior, drive.poses[key, 2]))
        posterior = _turn(found.covariance, -drive.poses[key, 2])
        drive.poses[k], drive.matched[k], drive.scores[k] = found.pose, found.ok, found.score
        self._keys[k], self._spreads[k] = key, posterior
        drive.step_covariances[k] = _fuse(trust, _turn(posterior + known, -held[2]))
        if k - 1 == key or not found.ok:
            drive.step_covariances[k] = trust if not found.ok else _turn(posterior, -held[2])
        if found.ok and self._odometry is None:
            share = 1.0 - np.diag(drive.step_covariances[k]) / np.diag(trust)
            self._steady.learn(between(last, found.pose), share)
        if self._submap.add(scan, found.pose):
            self._learn(k)
            self._key = k

    def _predict(self, k: int) -> tuple[Array, Array]:
        """Return the step (3,) from scan k - 1 that odometry tells, and its covariance."""
        if self._odometry is None:
            return self._steady.correct(), self._steady.predict()
        step = between(self._odometry[k - 1], self._odometry[k])
        return self._fit.correct(step), self._fit.predict(step)

    def _match(self, scan: Surface, guess: Array, prior: Array) -> Match:
        """Match a scan near the guess; look further afield where that finds little."""
        reference = self._submap.make_reference()
        deviations = np.sqrt(np.diag(prior))
        window = (
            float(np.clip(3 * deviations[:2].max(), 0.1, WIDEST[0])),
            float(np.clip(3 * deviations[2], 0.06, WIDEST[1])),
        )
        eager = self._odometry is not None
        found = match_scan(scan, reference, guess, prior, window=window, eager=eager)
        for wide in WIDE_WINDOWS:
            if found.ok and found.score > WEAK_SCORE:
                break
            slip = np.diag([wide[0] / 3, wide[0] / 3, wide[1] / 3]) ** 2
            again = match_scan(scan, reference, guess, prior + slip, window=wide)
            if again.ok and again.score > found.score + 0.2:
                found = again
        return found

    def _learn(self, k: int) -> None:
        """Tell the action model how the odometry since the last key scan has erred."""
        if self._odometry is None or not self.drive.matched[k]:
            return
        step = between(self._odometry[self._key], self._odometry[k])
        prior = np.diag(self._fit.predict(step))
        measured = relative_pose(self.drive, self._key, k)
        share = 1.0 - np.diag(self._spreads[k]) / prior
        self._fit.learn(step, measured, share)


def _fuse(a: Array, b: Array) -> Array:
    """Return the covariance of the product of two Gaussians."""
    return np.asarray(a @ np.linalg.solve(a + b, b))


def _turn(covariance: Array, angle_rad: float) -> Array:
    """Turn the covariance (3, 3) of a pose by an angle, counter-clockwise."""
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
