"""Where the places are, as far as one map says: a joint Gaussian that grows visit by visit.

The state holds the pose of the latest visit and the poses of the places around (frame of the
first visit to each) in the frame of place 0. A travel moves the visit by its displacement; a
closure says that the visit is at a place seen before. The innovation of a closure is what its
normalised density is taken of.

Up to ``MOST_PLACES`` places all are held, and the estimate is the extended Kalman filter. In
larger maps a window of places is held: what it does not hold is in a :class:`hssh_kb.town.Town`,
shared by all maps that grow from one. While the robot stays within the window nothing is lost by
that; when it comes near a place outside, the visits since are added to the town and the window
moves on. So the cost of an arrival does not grow with the map.

Source: Beeson 2008, section 9.3.2 (the Kalman form of G(chi)); the use for scoring and the
windows are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hssh_kb.experience import Displacement
from hssh_kb.joint_covariance import JointCovariance
from hssh_kb.town import Town
from hssh_kb.walk_graph import Index, Step, WalkGraph

Array = NDArray[np.float64]
_REACH_SIGMAS = 5.0  # places further off than that, on the safe side, can be no closure
_FURTHER = 1.3
_FAR_M = 1e4


class Log(NamedTuple):
    """The visits since the graph was laid out, the latest first."""

    before: Log | None
    step: Step


@dataclass(frozen=True, slots=True)
class PlaceFilter:
    """Mean and covariance of the visit and of w places.

    Covariances are against the visit at which the window was made.

    Attributes
    ----------
    mean : (w + 1, 3) of the visit and the places; metres, metres, radians, in the frame of place 0.
    joint : covariance of the places.
    own : (w, 3, 3) its diagonal blocks.
    cross : (3, 3w) covariance of the visit with the places.
    visit_cov : (3, 3) covariance of the visit.
    places : (w,) numbers of the places held.
    slots : index in ``places`` of each place held.
    count : number of places in all.
    town : what the window was cut from.
    log : the visits since then.
    """

    mean: Array
    joint: JointCovariance
    own: Array
    cross: Array
    visit_cov: Array
    places: Index
    count: int
    slots: dict[int, int]
    town: Town
    log: Log | None

    @classmethod
    def start(cls) -> PlaceFilter:
        """Return the filter at the first visit: the visit and place 0, both at the origin."""
        first = np.zeros(1, np.intp)
        return cls.of(np.zeros((2, 3)), np.zeros((6, 6)), first, 1, Town.start())

    @classmethod
    def of(cls, mean: Array, cov: Array, places: Index, count: int, town: Town) -> PlaceFilter:
        """Return the filter of a window just made; ``cov`` is that of the visit and the places."""
        slots = {place: k for k, place in enumerate(places.tolist())}
        cov = np.ascontiguousarray(cov)
        inner = np.ascontiguousarray(cov[3:, 3:])
        n = len(places)
        own = np.einsum("iaib->iab", inner.reshape(n, 3, n, 3)).copy()
        joint, cross = JointCovariance.of(inner), cov[:3, 3:].copy()
        return cls(mean, joint, own, cross, cov[:3, :3].copy(), places, count, slots, town, None)

    @property
    def cov(self) -> Array:
        """Joint covariance (3w + 3, 3w + 3) of the visit and the places."""
        cross = self.cross
        return np.block([[self.visit_cov, cross], [cross.T, self.joint.write_out()]])

    @property
    def nbytes(self) -> int:
        """Bytes that it and what it predicts do not share with the filter it grew from, about."""
        return self.joint.nbytes + 2 * (self.mean.nbytes + self.own.nbytes + self.cross.nbytes)

    def predict(self, displacement: Displacement | None, length_m: float) -> Prediction:
        """Return where the next visit should be, before it is told which place it is.

        Parameters
        ----------
        displacement : lambda; None if unknown: then the visit may be anywhere.
        length_m : typical length of a travel, the yardstick for "anywhere".
        """
        ahead = self.step_ahead(displacement, length_m)
        near = self._find_outside(ahead, length_m)
        if len(self.places) <= self.town.most and not len(near):
            return ahead
        return self.move_window(ahead.pose, near, length_m).step_ahead(displacement, length_m)

    def _find_outside(self, ahead: Prediction, length_m: float) -> Index:
        """Return the places outside the window that the next visit may be at."""
        town = self.town
        if ahead.unknown or not town.outside.any():
            return np.zeros(0, np.intp)
        off = np.hypot(*(town.spots - ahead.pose[:2]).T)
        own = math.sqrt(ahead.cov[0, 0] + ahead.cov[1, 1])
        reach = 0.25 * length_m + _REACH_SIGMAS * (own + town.deviations[:, 0])
        ratio = np.where(town.outside, off / reach, math.inf)
        if not (ratio < town.limit).any():
            return np.zeros(0, np.intp)
        # Those a little further off too, or the next visit would call for them.
        near = np.flatnonzero(ratio < _FURTHER)
        return near[np.argsort(ratio[near], kind="stable")]

    def move_window(
        self, pose: tuple[float, float, float], wanted: Index, length_m: float
    ) -> PlaceFilter:
        """Return the filter with a new window: places wanted, and those around a pose.

        Parameters
        ----------
        pose : x [m], y [m], heading [rad] where the robot is going.
        wanted : numbers of places that must be held, the most important first.
        length_m : typical length of a travel.
        """
        town, places, cov = self.town.move(
            self._list_steps(), self.places, self.mean, pose, wanted, length_m
        )
        graph = town.graph
        mean = graph.poses[np.r_[graph.last, graph.first[places]]]
        return PlaceFilter.of(mean, cov, places, self.count, town)

    def remember_walk(self, length_m: float) -> WalkGraph:
        """Return the graph of all visits.

        Parameters
        ----------
        length_m : typical length of a travel.
        """
        return self.town.extend(self._list_steps(), self.places, self.mean, length_m)

    def _list_steps(self) -> list[Step]:
        steps = []
        log = self.log
        while log is not None:
            steps.append(log.step)
            log = log.before
        return steps[::-1]

    def step_ahead(self, displacement: Displacement | None, length_m: float) -> Prediction:
        """Return where the next visit should be, the window being what it is; see `predict`."""
        x, y, theta = self.mean[0].tolist()
        if displacement is None:
            far = (_FAR_M * length_m) ** 2
            cov = np.diag([far, far, (2 * math.pi) ** 2])
            move = Displacement(0.0, 0.0, 0.0, tuple(map(tuple, cov.tolist())))
            none = np.zeros_like(self.cross)
            return Prediction.of(self, move, length_m, (x, y, theta), cov, none, True)
        c, s = math.cos(theta), math.sin(theta)
        lever_x = c * displacement.x - s * displacement.y
        lever_y = s * displacement.x + c * displacement.y
        shift = np.array([[1.0, 0.0, -lever_y], [0.0, 1.0, lever_x], [0.0, 0.0, 1.0]])
        cross = self.cross.copy()
        cross[0] -= lever_y * cross[2]
        cross[1] += lever_x * cross[2]
        cov = shift @ self.visit_cov @ shift.T
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
        return Prediction.of(self, displacement, length_m, pose, cov, cross, False)


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
    move : the displacement of the travel.
    length_m : typical length of a travel.
    pose : of the visit, in the frame of place 0.
    cov : (3, 3) of the pose.
    cross : (3, 3w) covariance of the pose with the places held.
    unknown : the displacement is unknown.
    gap : (w, 3) pose of the visit minus pose of each place held.
    spread : (w, 3, 3) covariance of the gaps.
    """

    filter: PlaceFilter
    move: Displacement
    length_m: float
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
        move: Displacement,
        length_m: float,
        pose: tuple[float, float, float],
        cov: Array,
        cross: Array,
        unknown: bool,
    ) -> Prediction:
        """Return the prediction, measured against all places at once."""
        across = cross.reshape(3, len(known.places), 3).transpose(1, 0, 2)
        gap = np.array(pose) - known.mean[1:]
        spread = cov + known.own - across - across.transpose(0, 2, 1)
        return cls(known, move, length_m, pose, cov, cross, unknown, gap, spread)

    def measure(self, place: int, turn_rad: float) -> Innovation:
        """Return the innovation if the visit is at a place.

        Parameters
        ----------
        place : number of the place.
        turn_rad : direction of the frame of the visit in the frame of the place.
        """
        slot = self.filter.slots.get(place)
        if slot is None:
            return self._measure_outside(place, turn_rad)
        x, y, turn = self.gap[slot].tolist()
        turn = (turn - turn_rad + math.pi) % (2 * math.pi) - math.pi
        return Innovation((x, y, turn), self.spread[slot].tolist())

    def _measure_outside(self, place: int, turn_rad: float) -> Innovation:
        """Return the innovation at a place that the filter does not hold, rather too wide."""
        (x, y, theta), (far, heading) = self.filter.town.locate(place)
        turn = (self.pose[2] - theta - turn_rad + math.pi) % (2 * math.pi) - math.pi
        spread = 2 * (self.cov + np.diag([far**2, far**2, heading**2]))
        return Innovation((self.pose[0] - x, self.pose[1] - y, turn), spread.tolist())

    def found_place(self) -> PlaceFilter:
        """Return the filter with the visit as a new place."""
        known, n = self.filter, len(self.filter.places)
        mean = np.empty((n + 2, 3))
        mean[:-1] = known.mean
        mean[0] = mean[-1] = self.pose
        cross = np.hstack([self.cross, self.cov])
        return replace(
            known,
            mean=mean,
            joint=known.joint.grow(np.ascontiguousarray(cross.T)),
            own=np.concatenate([known.own, self.cov[None]]),
            cross=cross,
            visit_cov=self.cov,
            places=np.append(known.places, known.count),
            count=known.count + 1,
            slots={**known.slots, known.count: n},
            log=self._note(known.count, self.pose, 0.0, (0.0, 0.0, 0.0)),
        )

    def _note(
        self,
        place: int,
        pose: tuple[float, float, float],
        turn_rad: float,
        noise: tuple[float, float, float],
    ) -> Log:
        move = (self.move.x, self.move.y, self.move.theta)
        is_new = place == self.filter.count
        step = Step(place, is_new, pose, move, self.move.cov, turn_rad, noise)
        return Log(self.filter.log, step)

    def close(self, place: int, turn_rad: float, noise: tuple[float, float, float]) -> PlaceFilter:
        """Return the filter with the visit at a known place.

        Parameters
        ----------
        place, turn_rad : as in :meth:`measure`.
        noise : variances of x, y [m2] and heading [rad2] of the visit about the place;
            an infinite heading variance leaves the heading unmeasured.
        """
        slot = self.filter.slots.get(place)
        if slot is None:
            wider = self.filter.move_window(self.pose, np.array([place]), self.length_m)
            ahead = wider.step_ahead(None if self.unknown else self.move, self.length_m)
            return ahead.close(place, turn_rad, noise)
        rows = 2 if math.isinf(noise[2]) else 3
        known, b = self.filter, 3 * slot
        residual = self.measure(place, turn_rad).residual[:rows]
        gain = self.cross.T[:, :rows] - known.joint.take_columns(slot)[:, :rows]
        visit_gain = self.cov[:, :rows] - self.cross[:, b : b + rows]
        spread = self.spread[slot, :rows, :rows] + np.diag(noise[:rows])
        root = np.linalg.inv(np.linalg.cholesky((spread + spread.T) / 2))
        # W W' keeps the covariance symmetric; gain S^-1 gain' loses it bit by bit and blows up.
        shrink, visit_shrink = gain @ root.T, visit_gain @ root.T
        change = root @ np.array(residual)
        mean = known.mean.copy()
        mean[0] = np.array(self.pose) - visit_shrink @ change
        mean[1:] -= (shrink @ change).reshape(-1, 3)
        blocks = shrink.reshape(-1, 3, rows)
        x, y, theta = mean[slot + 1].tolist()
        return replace(
            known,
            mean=mean,
            joint=known.joint.shrink(shrink),
            own=known.own - blocks @ blocks.transpose(0, 2, 1),
            cross=self.cross - visit_shrink @ shrink.T,
            visit_cov=self.cov - visit_shrink @ visit_shrink.T,
            log=self._note(place, (x, y, theta + turn_rad), turn_rad, noise),
        )
