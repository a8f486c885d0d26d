"""Driving by gateways: the robot's own local map, its gateways as motion targets.

The robot knows the tour only as distances and turns. It keeps an LPM in the frame of its odometry,
reads the local topology as it goes, drives from place to place through the gateway nearest to the
direction it wants, and takes a place for the next of the tour where one is due.

Source: Beeson 2008, 5.2 (gateways as control targets); thresholds and steering are ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from perception.errors import InputError
from perception.geometry import Array, between, transform_points, wrap_angle
from perception.lpm import LocalMap
from perception.robot import Robot
from perception.topology import local_topology

_EARLY_M, _LATE_M, _ASIDE_M = 1.2, 3.0, 3.0
"""How much earlier or later than told, or to the side, a place may come."""
_GATEWAY_SECTOR_RAD = math.radians(50)
_BEYOND_M = 1.0
"""Motion targets lie so far beyond the gateway."""
_READ_EVERY_M, _READ_EVERY_RAD = 0.8, 0.7
_DUE_WITHIN_M = 2.5
"""So near to where a place is due, the local topology is read twice as often."""
_STUCK_TICKS = 150
_DETOURS_RAD = np.array([0.0, *np.repeat(np.arange(1, 13) * 0.1, 2)]) * np.tile([1, -1], 13)[:25]


@dataclass(frozen=True)
class _View:
    """What the local map shows: place and gateways, in the frame of the odometry, metres."""

    at_place: bool
    centre: Array
    gateways: Array
    outward_rad: Array


class GatewayDriver:
    """Drives a robot along a tour by its gateways.

    Parameters
    ----------
    robot : at the first place, heading for the second.
    points : (n, 2) positions of the places of the tour, used for distances and turns only.
    progress : called with (places reached, places in all).
    """

    def __init__(
        self, robot: Robot, points: Array, progress: Callable[[int, int], None] | None = None
    ) -> None:
        steps = np.diff(points, axis=0)
        self._robot = robot
        self._lengths = np.hypot(steps[:, 0], steps[:, 1])
        self._headings = np.arctan2(steps[:, 1], steps[:, 0])
        self._progress = progress
        self._map = LocalMap()
        self._read_at: Array | None = None
        self._view: _View | None = None
        self._aligned_to: _View | None = None
        self._update_map()

    def drive(self) -> int:
        """Drive the tour; return the index of the last place that was reached."""
        self._look_around()
        direction = float(self._robot.odometry[2])
        last_centre = self._robot.odometry[:2].copy()
        for index, length in enumerate(self._lengths):
            after = self._headings[index + 1] if index + 1 < len(self._headings) else None
            turn = None if after is None else float(wrap_angle(after - self._headings[index]))
            centre = self._travel(last_centre, float(length), direction, turn)
            if centre is None:
                return index
            direction = float(wrap_angle(math.atan2(*(centre - last_centre)[::-1]) + (turn or 0.0)))
            last_centre = centre
            if self._progress is not None:
                self._progress(index + 1, len(self._lengths))
        return len(self._lengths)

    def _look_around(self) -> None:
        """Turn once on the spot."""
        body = self._robot.body
        for _ in range(math.ceil(2 * math.pi / (body.turn_radps * body.tick_s))):
            self._tick(0.0, body.turn_radps)

    def _travel(
        self, start: Array, length: float, direction: float, turn: float | None
    ) -> Array | None:
        """Drive from the centre of a place to that of the next; None if none is found.

        ``turn`` is the turn to take there, None at the end of the tour.
        """
        stuck = looks = 0
        while stuck < _STUCK_TICKS or looks < 1:
            if stuck >= _STUCK_TICKS:
                looks, stuck = looks + 1, 0
                self._look_around()
            here = self._robot.odometry[:2]
            is_near = self._advance(start, direction) > length - _DUE_WITHIN_M
            view = self._read(_READ_EVERY_M / 2 if is_near else _READ_EVERY_M)
            direction = self._align(view, direction)
            way = float(np.hypot(*(here - start)))
            if view is not None and self._is_next(view, start, length, direction, turn):
                return self._approach(view.centre, direction, start, length)
            if way > length + _LATE_M:
                return None
            if self._is_overdue(start, length, direction, stuck):
                return view.centre if view is not None and view.at_place else here.copy()
            target = self._choose_target(view, direction)
            stuck = 0 if self._steer_to(target) else stuck + 1
        return None

    def _is_next(
        self, view: _View, start: Array, length: float, direction: float, turn: float | None
    ) -> bool:
        """Tell whether the place in view can be the next: it is due, and one can turn as told."""
        if not view.at_place or not self._is_due(view, start, length, direction):
            return False
        if turn is None:  # the last place: drive right into it
            return self._advance(start, direction) > length - 0.3
        off = np.abs(wrap_angle(view.outward_rad - direction - turn))
        return bool(off.size and off.min() < _GATEWAY_SECTOR_RAD)

    def _is_due(self, view: _View, start: Array, length: float, direction: float) -> bool:
        """Tell whether the place in view is where the next place of the tour should be."""
        shift = view.centre - start
        along = float(shift @ [math.cos(direction), math.sin(direction)])
        across = float(shift @ [-math.sin(direction), math.cos(direction)])
        return length - _EARLY_M <= along <= length + _LATE_M and abs(across) < _ASIDE_M

    def _approach(self, centre: Array, direction: float, start: Array, length: float) -> Array:
        """Drive to the centre of a place, which is seen better on the way."""
        stuck = 0
        while stuck < _STUCK_TICKS:
            view = self._read(_READ_EVERY_M / 2)
            if (
                view is not None
                and view.at_place
                and float(np.hypot(*(view.centre - centre))) < 1.0
                and self._is_due(view, start, length, direction)
            ):
                centre = view.centre
            shift = centre - self._robot.odometry[:2]
            ahead = float(shift @ [math.cos(direction), math.sin(direction)])
            if np.hypot(*shift) < 0.3 or ahead < 0.1:
                break
            stuck = 0 if self._steer_to(centre) else stuck + 1
        return centre

    def _is_overdue(self, start: Array, length: float, direction: float, stuck: int) -> bool:
        """Tell whether the robot has come as far as told, or to a wall, and saw no place."""
        way = self._advance(start, direction)
        return way > length + 0.3 or (stuck > 20 and way > length - 1.5)

    def _advance(self, start: Array, direction: float) -> float:
        """Return how far the robot has come in a direction, metres."""
        shift = self._robot.odometry[:2] - start
        return float(shift @ [math.cos(direction), math.sin(direction)])

    def _find_forward(self, view: _View | None, direction: float) -> int | None:
        """Return the gateway nearest to a direction among those ahead, by index, if any."""
        if view is None or not len(view.gateways):
            return None
        off = np.abs(wrap_angle(view.outward_rad - direction))
        shift = view.gateways - self._robot.odometry[:2]
        bearing = np.abs(wrap_angle(np.arctan2(shift[:, 1], shift[:, 0]) - direction))
        is_near = np.hypot(shift[:, 0], shift[:, 1]) < 0.5
        off[~is_near & (bearing > 1.3 * _GATEWAY_SECTOR_RAD)] = np.inf
        best = int(np.argmin(off))
        return best if off[best] < _GATEWAY_SECTOR_RAD else None

    def _align(self, view: _View | None, direction: float) -> float:
        """Let each new view of a gateway ahead turn the direction of travel a little."""
        if view is self._aligned_to or view is None:
            return direction
        self._aligned_to = view
        best = self._find_forward(view, direction)
        if best is None:
            return direction
        off = float(wrap_angle(view.outward_rad[best] - direction))
        return float(wrap_angle(direction + 0.15 * off))

    def _choose_target(self, view: _View | None, direction: float) -> Array:
        """Return a point beyond the gateway ahead, or ahead in the middle between the walls."""
        ahead = np.array([math.cos(direction), math.sin(direction)])
        best = self._find_forward(view, direction)
        if best is not None and view is not None:
            return np.asarray(view.gateways[best] + _BEYOND_M * ahead)
        points = transform_points(self._scan_odometry, self._near_points(2.0))
        shift = points - self._robot.odometry[:2]
        along = shift @ ahead
        left = shift @ np.array([-ahead[1], ahead[0]])
        beside = left[np.abs(along - 0.4) < 0.6]
        sides = [np.min(np.abs(beside[beside * sign > 0]), initial=2.0) for sign in (1, -1)]
        middle = float(np.clip((sides[0] - sides[1]) / 2, -0.4, 0.4)) if max(sides) < 1.8 else 0.0
        return np.asarray(
            self._robot.odometry[:2] + _BEYOND_M * ahead + middle * np.array([-ahead[1], ahead[0]])
        )

    def _near_points(self, reach_m: float) -> Array:
        """Return the returns (k, 2) of the last scan within reach, laser frame."""
        ranges = self._robot.ranges_m.astype(float)
        near = np.isfinite(ranges) & (ranges < reach_m)
        angles = self._robot.angles_rad[near]
        points = ranges[near, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.asarray(points, float)

    def _steer_to(self, target: Array) -> bool:
        """Drive one tick towards a point, around what stands in the way; False if it stood."""
        robot = self._robot
        before = robot.odometry.copy()
        shift = target - before[:2]
        error = float(wrap_angle(math.atan2(shift[1], shift[0]) - before[2]))
        room = 1.0
        if abs(error) < math.pi / 2:
            error, room = self._avoid(error)
        forward = math.cos(min(1.6 * abs(error), math.pi / 2))
        speed = robot.body.speed_mps * forward * float(np.clip((room - 0.15) / 0.5, 0.0, 1.0))
        self._tick(speed, 2.5 * error)
        moved = between(before, robot.odometry)
        return bool(abs(moved[0]) > 0.005 or abs(moved[2]) > 0.02)

    def _avoid(self, error: float) -> tuple[float, float]:
        """Return the free direction nearest to the wanted one, and how far it is free, metres."""
        robot = self._robot
        points = self._near_points(1.5)
        points = transform_points(between(robot.odometry, self._scan_odometry), points)
        headings = error + _DETOURS_RAD
        c, s = np.cos(headings)[:, None], np.sin(headings)[:, None]
        along = c * points[:, 0] + s * points[:, 1]
        across = np.abs(c * points[:, 1] - s * points[:, 0])
        blocked = (along > 0) & (across < robot.body.radius_m + 0.1)
        free = np.where(blocked, along - robot.body.radius_m, 1.3).min(axis=1, initial=1.3)
        cost = np.abs(_DETOURS_RAD) + 2.0 * np.maximum(0.9 - free, 0.0)
        best = int(np.argmin(cost))
        return float(wrap_angle(headings[best])), float(free[best])

    def _tick(self, speed: float, turn: float) -> None:
        if self._robot.move(speed, turn):
            self._update_map()

    def _update_map(self) -> None:
        self._scan_odometry = self._robot.odometry.copy()
        self._map.update(self._scan_odometry, self._robot.ranges_m, self._robot.angles_rad)

    def _read(self, every_m: float) -> _View | None:
        """Return the local topology, read anew after some travel or turning."""
        here = self._robot.odometry
        if self._read_at is not None:
            moved = between(self._read_at, here)
            is_near = float(np.hypot(moved[0], moved[1])) < every_m
            if is_near and abs(moved[2]) < _READ_EVERY_RAD:
                return self._view
        self._read_at = here.copy()
        frame = self._map.frame
        column, row = frame.to_pixels(here[:2])
        try:
            topology = local_topology(
                self._map.image(),
                robot_px=(float(column), float(row)),
                resolution_m=frame.resolution_m,
                robot_radius_m=0.4,
            )
        except InputError:  # the map shows the robot in a wall: somebody stands close by
            self._view = None
            return None
        centres = np.array([gate.centre_px for gate in topology.gateways]).reshape(-1, 2)
        self._view = _View(
            at_place=topology.at_place,
            centre=frame.to_metres(topology.base_px).mean(axis=0),
            gateways=frame.to_metres(centres),
            outward_rad=np.array([-gate.outward_rad for gate in topology.gateways]),
        )
        return self._view
