"""The action model: what an odometry step says about the motion, and how far it is to be trusted.

The model is fitted while the robot drives: each step that the scans determine tells how odometry
errs (a scale of the way, a drift to one side, too much or too little turn), so that odometry is
already corrected for it where the scans say nothing, as in a bare corridor.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from perception.geometry import Array, wrap_angle

GAIN_DEVIATION = 0.05
"""Standard deviation of the systematic errors to be learnt: m or rad, per metre or radian."""
SPREAD_LIMITS = (0.25, 9.0)
"""Least and largest factor by which the variances of the model are scaled to the errors met."""
BLIND_LIMITS = (0.01, 2.0)
"""The same, for the guess without odometry."""
SLIP = 25.0
"""Squared normalised error from which a step is a slip, which teaches nothing."""


@dataclass(frozen=True)
class MotionModel:
    """Trust in odometry before anything is learnt: standard deviations that grow with the motion.

    Attributes
    ----------
    along, across : constant [m], per metre travelled, per radian turned [m].
    turn : constant [rad], per metre travelled [rad], per radian turned. Of the constants a tenth
        is left where the wheels stand still.
    blind : (3,) standard deviations of a step where there is no odometry at all; m, m, rad.

    Source
    ------
    The kind of model of Beeson 2008, 4.3.1 (after Eliazar and Parr 2004); the figures are ours.
    """

    along: tuple[float, float, float] = (0.01, 0.06, 0.03)
    across: tuple[float, float, float] = (0.01, 0.04, 0.05)
    turn: tuple[float, float, float] = (0.007, 0.03, 0.08)
    blind: tuple[float, float, float] = (0.6, 0.3, 0.4)

    def predict(self, step: Array) -> Array:
        """Return the covariance (3, 3) of an odometry step (3,), in the frame it starts from.

        Examples
        --------
        >>> np.sqrt(MotionModel().predict(np.array([1.0, 0.0, 0.0])).diagonal()).round(3).tolist()
        [0.07, 0.05, 0.037]
        """
        way, turned = float(np.hypot(step[0], step[1])), abs(float(step[2]))
        terms = np.array([min(1.0, 0.1 + 20.0 * (way + turned)), way, turned])
        deviations = np.array([terms @ self.along, terms @ self.across, terms @ self.turn])
        return np.diag(deviations**2)


@dataclass
class OdometryFit:
    """Running least squares of the errors of odometry on way and turn, old steps fading out.

    Attributes
    ----------
    model : where the trust starts.
    memory_steps : how many steps back the fit reaches, about.

    Source
    ------
    Beeson 2008, 4.3.1 fits such a model once, offline; doing it along the drive is ours.
    """

    model: MotionModel
    memory_steps: float = 60.0
    _moments: Array = field(default_factory=lambda: np.zeros((3, 2, 2)))
    _products: Array = field(default_factory=lambda: np.zeros((3, 2)))
    _spread: Array = field(default_factory=lambda: np.ones(3))

    def correct(self, step: Array) -> Array:
        """Return the odometry step (3,) less the errors learnt so far."""
        ridge = np.eye(2) / GAIN_DEVIATION**2
        gains = np.linalg.solve(self._moments + ridge, self._products[..., None])[..., 0]
        corrected = step + gains @ step[[0, 2]]
        corrected[2] = wrap_angle(corrected[2])
        return np.asarray(corrected)

    def predict(self, step: Array) -> Array:
        """Return the covariance (3, 3) of a corrected step, in the frame it starts from."""
        scale = np.sqrt(np.clip(self._spread, *SPREAD_LIMITS))
        return np.asarray(self.model.predict(step) * np.outer(scale, scale))

    def learn(self, step: Array, measured: Array, share: Array) -> None:
        """Take in what the scans say about a step.

        Parameters
        ----------
        step : (3,) as odometry gave it.
        measured : (3,) posterior of the step.
        share : (3,) how much of each component of the posterior came from the scans, 0 to 1;
            components of which they determine less than half teach nothing.
        """
        variance = np.diag(self.model.predict(step))
        left, raw = measured - self.correct(step), measured - step
        left[2], raw[2] = wrap_angle(left[2]), wrap_angle(raw[2])
        surprise = left**2 / variance
        features = step[[0, 2]]
        fade = 1.0 / self.memory_steps
        for k in np.flatnonzero((share > 0.5) & (surprise < SLIP)):
            self._spread[k] += fade * (surprise[k] / share[k] ** 2 - self._spread[k])
            self._moments[k] *= 1.0 - fade
            self._products[k] *= 1.0 - fade
            self._moments[k] += np.outer(features, features) / variance[k]
            self._products[k] += features * (raw[k] / variance[k])


@dataclass
class SteadyMotion:
    """What to expect without odometry: the robot goes on as fast as in the last step.

    How far this is off, as far as the scans tell, sets how far to search.

    Attributes
    ----------
    model : where the trust starts.
    memory_steps : over how many steps the errors are averaged, about.

    Source
    ------
    Ours; the constant-velocity guess is common in lidar odometry.
    """

    model: MotionModel
    memory_steps: float = 20.0
    _speed: float = 0.0
    _spread: Array = field(default_factory=lambda: np.ones(3))

    def correct(self) -> Array:
        """Return the step (3,) to expect."""
        return np.array([self._speed, 0.0, 0.0])

    def predict(self) -> Array:
        """Return its covariance (3, 3)."""
        return np.diag(np.square(self.model.blind) * np.clip(self._spread, *BLIND_LIMITS))

    def learn(self, measured: Array, share: Array) -> None:
        """Take in a step (3,) and the share of each component that the scans determined."""
        surprise = (measured - self.correct()) ** 2 / np.square(self.model.blind)
        known = share > 0.5
        change = surprise / np.maximum(share, 0.5) ** 2 - self._spread
        self._spread = self._spread + np.where(known, change / self.memory_steps, 0.0)
        if known[0]:
            self._speed = float(measured[0])
