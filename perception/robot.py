"""A simulated robot: a differential drive with lidar and wheels in a world, and passers-by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array, compose, wrap_angle
from perception.scanlog import ScanLog
from perception.simulate import Lidar, OdometryNoise, WheelOdometry, measure_scans
from perception.world import World

WALK_SIDE_M = 0.6
"""Pedestrians keep so far to the right of the middle of a corridor."""


@dataclass(frozen=True)
class Body:
    """What the robot is like.

    Attributes
    ----------
    radius_m : it is round.
    speed_mps, turn_radps : its limits.
    tick_s : time between two commands.
    scan_every_m, scan_every_rad : a scan is taken after so much travel or turning.
    """

    radius_m: float = 0.22
    speed_mps: float = 0.7
    turn_radps: float = 1.2
    tick_s: float = 0.1
    scan_every_m: float = 0.15
    scan_every_rad: float = 0.175


class Crowd:
    """Pedestrians who walk the corridors at random, along the edges of the true place graph.

    Parameters
    ----------
    world : where they walk. count : how many. rng : decides where and how fast.
    """

    def __init__(self, world: World, count: int, rng: np.random.Generator) -> None:
        if count < 0:
            raise InputError(f"{count} pedestrians: expected 0 or more")
        self._world = world
        self._rng = rng
        names = list(world.truth)
        self._from = [names[k] for k in rng.integers(len(names), size=count)]
        self._to = [self._choose(name, "") for name in self._from]
        self._way_m = rng.uniform(0.0, 5.0, count)
        self._speed_mps = rng.uniform(0.8, 1.4, count)

    def _choose(self, place: str, before: str) -> str:
        """Choose where to walk on; back only in a dead end."""
        on = [name for name in self._world.truth[place] if name != before]
        return on[self._rng.integers(len(on))] if on else before

    def walk(self, seconds: float) -> Array:
        """Let everybody walk on and return where they are then: (k, 2) metres."""
        out = np.zeros((len(self._from), 2))
        for k, (a, b) in enumerate(zip(self._from, self._to, strict=True)):
            self._way_m[k] += self._speed_mps[k] * seconds
            length = self._world.truth.edges[a, b]["length_m"]
            if self._way_m[k] > length:
                self._way_m[k] -= length
                self._from[k], self._to[k] = b, self._choose(b, a)
                a, b = self._from[k], self._to[k]
            start, end = self._world.position(a), self._world.position(b)
            ahead = (end - start) / np.hypot(*(end - start))
            right = np.array([ahead[1], -ahead[0]])
            out[k] = start + self._way_m[k] * ahead + WALK_SIDE_M * right
        return out


class Robot:
    """A robot in a world; it records what it measures.

    Parameters
    ----------
    world : where it drives. start : (3,) true pose, metres and radians.
    lidar, body, noise : what it is made of.
    pedestrians : how many walk about.
    seed : decides everything that is random.

    Attributes
    ----------
    pose : (3,) the true pose, unknown to the robot. odometry : (3,) where its wheels say it is.
    ranges_m : the last scan. scans : how many scans were taken.
    """

    def __init__(
        self,
        world: World,
        start: Array,
        *,
        lidar: Lidar,
        body: Body,
        noise: OdometryNoise,
        pedestrians: int = 0,
        seed: int = 0,
    ) -> None:
        streams = np.random.default_rng(seed).spawn(3)
        self.world, self.lidar, self.body = world, lidar, body
        self.angles_rad = lidar.angles_rad
        self.pose = np.asarray(start, float)
        self.odometry = np.zeros(3)
        self._range_rng = streams[0]
        self._wheels = WheelOdometry(noise, streams[1])
        self._crowd = Crowd(world, pedestrians, streams[2])
        self._people = self._crowd.walk(0.0)
        self._time_s = 0.0
        self._poses: list[Array] = []
        self._odometry: list[Array] = []
        self._times_s: list[float] = []
        self._ranges: list[NDArray[np.float32]] = []
        self._scan()

    @property
    def scans(self) -> int:
        """How many scans were taken."""
        return len(self._ranges)

    @property
    def ranges_m(self) -> NDArray[np.float32]:
        """The last scan (b,), metres."""
        return self._ranges[-1]

    def move(self, speed_mps: float, turn_radps: float) -> bool:
        """Drive for one tick; a wall stops the robot. Return whether a scan was taken."""
        dt = self.body.tick_s
        speed = float(np.clip(speed_mps, 0.0, self.body.speed_mps))
        turn = float(np.clip(turn_radps, -self.body.turn_radps, self.body.turn_radps)) * dt
        half = turn / 2  # an arc, by its chord
        chord = speed * dt * float(np.sinc(half / np.pi))
        motion = np.array([chord * np.cos(half), chord * np.sin(half), turn])
        self._time_s += dt
        self._people = self._crowd.walk(dt)
        if speed > 0 and self._is_blocked(compose(self.pose, motion)):
            motion[:2] = 0.0
        self.pose = compose(self.pose, motion)
        self.odometry = compose(self.odometry, self._wheels.measure(motion))
        shift = self.pose - self._poses[-1]
        due = (
            np.hypot(shift[0], shift[1]) >= self.body.scan_every_m
            or abs(wrap_angle(shift[2])) >= self.body.scan_every_rad
        )
        if due:
            self._scan()
        return bool(due)

    def _is_blocked(self, pose: Array) -> bool:
        """Tell whether the robot would touch something there that it comes nearer to."""
        there = _distance_m(self.world.segments, pose[:2])
        if self._people.size:
            there = min(there, float(np.hypot(*(self._people - pose[:2]).T).min()) - 0.25)
        return there < self.body.radius_m and there < _distance_m(
            self.world.segments, self.pose[:2]
        )

    def _scan(self) -> None:
        scan = measure_scans(
            self.world.segments,
            self.pose[None],
            self.lidar,
            self._range_rng,
            self._people[None],
        )
        self._ranges.append(scan[0])
        self._poses.append(self.pose.copy())
        self._odometry.append(self.odometry.copy())
        self._times_s.append(self._time_s)

    def record(self, notices: tuple[str, ...] = ()) -> ScanLog:
        """Return all that was measured, with the true poses."""
        return ScanLog(
            source=f"simulated drive in {self.world.name}",
            times_s=np.array(self._times_s),
            ranges_m=np.array(self._ranges),
            angles_rad=self.angles_rad,
            odometry=np.array(self._odometry),
            truth=np.array(self._poses),
            notices=notices,
        )


def _distance_m(segments: Array, point: Array) -> float:
    """Return the distance from a point (2,) to the nearest segment."""
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    to = point - start
    length2 = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip((to * along).sum(axis=1) / length2, 0.0, 1.0)
    return float(np.sqrt((((to - share[:, None] * along) ** 2).sum(axis=1)).min()))
