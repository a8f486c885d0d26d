"""Where the places are, as far as one map says: a joint Gaussian that grows visit by visit.

The state holds the pose of the latest visit and the poses of all places (frame of the first
visit to each) in the frame of place 0. A travel moves the visit by its displacement; a closure
says that the visit is at a place seen before. The innovation of a closure is what its
normalised density is taken of.

Source: Beeson 2008, section 9.3.2 (the Kalman form of G(chi)); the use for scoring is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hssh_kb.experience import Displacement

Array = NDArray[np.float64]
_FAR_M = 1e4


@dataclass(frozen=True, slots=True)
class PlaceFilter:
    """Mean and covariance of the visit (block 0) and the places (blocks 1..n).

    Attributes
    ----------
    mean : (n + 1, 3) metres, metres, radians, in the frame of place 0.
    cov : (3n + 3, 3n + 3).
    """

    mean: Array
    cov: Array

    @classmethod
    def start(cls) -> PlaceFilter:
        """Return the filter at the first visit: the visit and place 0, both at the origin."""
        return cls(np.zeros((2, 3)), np.zeros((6, 6)))

    def predict(self, displacement: Displacement | None, length_m: float) -> Prediction:
        """Return where the next visit should be, before it is told which place it is.

        Parameters
        ----------
        displacement : lambda; None if unknown: then the visit may be anywhere.
        length_m : typical length of a travel, the yardstick for "anywhere".
        """
        x, y, theta = self.mean[0].tolist()
        head = self.cov[:3]
        if displacement is None:
            far = (_FAR_M * length_m) ** 2
            cov = np.diag([far, far, (2 * math.pi) ** 2])
            return Prediction.of(self, (x, y, theta), cov, np.zeros_like(head), True)
        c, s = math.cos(theta), math.sin(theta)
        lever_x = c * displacement.x - s * displacement.y
        lever_y = s * displacement.x + c * displacement.y
        cross = head.copy()
        cross[0] -= lever_y * head[2]
        cross[1] += lever_x * head[2]
        cov = cross[:, :3].copy()
        cov[:, 0] -= lever_y * cov[:, 2]
        cov[:, 1] += lever_x * cov[:, 2]
        (a, b, d), (_, e, f), (_, _, g) = displacement.cov
        cov[0, 0] += c * c * a - 2 * c * s * b + s * s * e
        xy = c * s * (a - e) + (c * c - s * s) * b
        cov[0, 1] += xy
        cov[1, 0] += xy
        cov[1, 1] += s * s * a + 2 * c * s * b + c * c * e
        xt, yt = c * d - s * f, s * d + c * f
        cov[0, 2] += xt
        cov[2, 0] += xt
        cov[1, 2] += yt
        cov[2, 1] += yt
        cov[2, 2] += g
        pose = (x + lever_x, y + lever_y, theta + displacement.theta)
        return Prediction.of(self, pose, cov, cross, False)


@dataclass(frozen=True, slots=True)
class Innovation:
    """How far a visit is from a place, and how far it may be.

    Attributes
    ----------
    residual : x [m], y [m], heading [rad] of the visit minus what the place says.
    cov : (3, 3) its covariance as nested lists, noise of the closure not included.
    """

    residual: tuple[float, float, float]
    cov: list[list[float]]


@dataclass(frozen=True, slots=True)
class Prediction:
    """The next visit before it is told which place it is; see :meth:`PlaceFilter.predict`.

    Attributes
    ----------
    filter : what was known before the travel.
    pose : of the visit, in the frame of place 0.
    cov : (3, 3) of the pose.
    cross : (3, 3n + 3) covariance of the pose with everything known.
    unknown : the displacement is unknown.
    gap : (n, 3) pose of the visit minus pose of each place.
    spread : (n, 3, 3) covariance of the gaps.
    """

    filter: PlaceFilter
    pose: tuple[float, float, float]
    cov: Array
    cross: Array
    unknown: bool
    gap: Array
    spread: Array

    @classmethod
    def of(
        cls,
        known: PlaceFilter,
        pose: tuple[float, float, float],
        cov: Array,
        cross: Array,
        unknown: bool,
    ) -> Prediction:
        """Return the prediction, measured against all places at once."""
        n = len(known.mean) - 1
        blocks = known.cov.reshape(n + 1, 3, n + 1, 3)
        own = np.einsum("iaib->iab", blocks)[1:]
        across = cross.reshape(3, n + 1, 3)[:, 1:].transpose(1, 0, 2)
        gap = np.array(pose) - known.mean[1:]
        spread = cov + own - across - across.transpose(0, 2, 1)
        return cls(known, pose, cov, cross, unknown, gap, spread)

    def measure(self, place: int, turn_rad: float) -> Innovation:
        """Return the innovation if the visit is at a place.

        Parameters
        ----------
        place : number of the place.
        turn_rad : direction of the frame of the visit in the frame of the place.
        """
        x, y, turn = self.gap[place].tolist()
        turn = (turn - turn_rad + math.pi) % (2 * math.pi) - math.pi
        return Innovation((x, y, turn), self.spread[place].tolist())

    def found_place(self) -> PlaceFilter:
        """Return the filter with the visit as a new place."""
        n = len(self.filter.mean)
        mean = np.empty((n + 1, 3))
        mean[:n] = self.filter.mean
        mean[0] = mean[n] = self.pose
        size = 3 * n
        cov = np.empty((size + 3, size + 3))
        cov[:size, :size] = self.filter.cov
        cov[:3, :size], cov[:size, :3] = self.cross, self.cross.T
        cov[:3, :3] = self.cov
        cov[size:, :size], cov[:size, size:] = cov[:3, :size], cov[:size, :3]
        cov[size:, size:] = self.cov
        return PlaceFilter(mean, cov)

    def close(self, place: int, turn_rad: float, noise: tuple[float, float, float]) -> PlaceFilter:
        """Return the filter with the visit at a known place.

        Parameters
        ----------
        place, turn_rad : as in :meth:`measure`.
        noise : variances of x, y [m2] and heading [rad2] of the visit about the place;
            an infinite heading variance leaves the heading unmeasured.
        """
        rows = 2 if math.isinf(noise[2]) else 3
        residual = self.measure(place, turn_rad).residual[:rows]
        cov = self.filter.cov.copy()
        cov[:3], cov[:, :3] = self.cross, self.cross.T
        cov[:3, :3] = self.cov
        b = 3 * place + 3
        gain = cov[:, :rows] - cov[:, b : b + rows]
        spread = self.spread[place, :rows, :rows] + np.diag(noise[:rows])
        root = np.linalg.inv(np.linalg.cholesky((spread + spread.T) / 2))
        shrink = gain @ root.T
        mean = self.filter.mean.copy()
        mean[0] = self.pose
        mean -= (shrink @ (root @ np.array(residual))).reshape(-1, 3)
        # W W' keeps the covariance symmetric; gain S^-1 gain' loses it bit by bit and blows up.
        cov -= shrink @ shrink.T
        return PlaceFilter(mean, cov)
