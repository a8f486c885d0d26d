"""A simulated robot that drives a tour, by following gateways or along a given route."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from perception.errors import InputError
from perception.gateway_driver import GatewayDriver
from perception.geometry import Array, wrap_angle
from perception.robot import Body, Robot
from perception.scanlog import ScanLog
from perception.simulate import Lidar, OdometryNoise
from perception.world import World

Controller = Literal["gateways", "route"]
_LOOKAHEAD_M = 0.8
_STUCK_TICKS = 600


def drive(
    world: World,
    *,
    tour: Sequence[str] | None = None,
    seed: int = 0,
    fov_deg: float = 180.0,
    pedestrians: int = 0,
    controller: Controller = "gateways",
    lidar: Lidar | None = None,
    noise: OdometryNoise | None = None,
    body: Body | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ScanLog:
    """Drive a tour through a world and return what the robot measured.

    The robot starts at the first place, looks around once, and ends at the last place.

    Parameters
    ----------
    world : where to drive.
    tour : names of places, each next to the one before; the world's own tour by default.
    seed : decides everything that is random; the same seed gives the same log.
    fov_deg : field of view of the lidar, 180 or 360 as a rule.
    pedestrians : how many people walk about.
    controller : ``"gateways"``: the robot knows only, for each place of the tour, how far it is
        and which way to turn there; it finds its way with the gateways of its own local map, in
        the frame of its own drifting odometry. ``"route"``: it follows the lines between the
        places, knowing its true pose.
    lidar, noise, body : what the robot is made of; ``fov_deg`` counts only without ``lidar``.
    progress : called with (places reached, places in all).

    Returns
    -------
    A log with odometry and truth. If the robot lost its way following gateways, the rest of the
    tour was driven along the route, and a notice says so.

    Raises
    ------
    InputError : a tour that the place graph does not hold, or of less than two places.

    Source
    ------
    Gateways as motion targets: Beeson 2008, 5.2; the controllers are ours.
    """
    names = _check_tour(world, world.tour if tour is None else tour)
    if controller not in ("gateways", "route"):
        raise InputError(f"controller={controller!r}: expected 'gateways' or 'route'")
    points = np.array([world.position(name) for name in names])
    heading = math.atan2(*(points[1] - points[0])[::-1])
    robot = Robot(
        world,
        np.array([*points[0], heading]),
        lidar=lidar or Lidar(fov_deg=fov_deg, beams=721 if fov_deg > 270 else 361),
        body=body or Body(),
        noise=noise or OdometryNoise(),
        pedestrians=pedestrians,
        seed=seed,
    )
    notices: tuple[str, ...] = ()
    reached = 0
    if controller == "gateways":
        reached = GatewayDriver(robot, points, progress).drive()
        if reached < len(points) - 1:
            notices = (
                f"simulated drive: lost the way after place {reached} of the tour "
                f"({names[reached]!r}), drove on along the route",
            )
    else:
        look_around(robot)
    if reached < len(points) - 1:
        follow_route(robot, points, reached, progress)
    return robot.record(notices)


def _check_tour(world: World, tour: Sequence[str]) -> tuple[str, ...]:
    if isinstance(tour, str) or len(tour) < 2:
        raise InputError("a tour needs at least two places")
    for name in tour:
        world.position(name)  # raises with the names that there are
    for a, b in itertools.pairwise(tour):
        if not world.truth.has_edge(a, b):
            raise InputError(
                f"tour: no corridor leads from {a!r} straight to {b!r}; from there it goes to "
                + ", ".join(repr(name) for name in world.truth[a])
            )
    return tuple(tour)


def look_around(robot: Robot) -> None:
    """Turn once on the spot."""
    for _ in range(math.ceil(2 * math.pi / (robot.body.turn_radps * robot.body.tick_s))):
        robot.move(0.0, robot.body.turn_radps)


def follow_route(
    robot: Robot,
    points: Array,
    reached: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Drive along the lines between points (n, 2), from the one given by its index on.

    The robot steers towards a point a little ahead on the line (pure pursuit), by its true pose.
    """
    stuck = 0
    for index in range(reached, len(points) - 1):
        start, end = points[index], points[index + 1]
        length = float(np.hypot(*(end - start)))
        ahead = (end - start) / length
        is_last = index == len(points) - 2
        while stuck < _STUCK_TICKS:
            way = float((robot.pose[:2] - start) @ ahead)
            if length - way < (0.15 if is_last else 0.5):
                break
            target = start + min(way + _LOOKAHEAD_M, length + 0.3) * ahead
            before = robot.pose[:2]
            steer(robot, float(np.arctan2(*(target - before)[::-1]) - robot.pose[2]))
            stuck = 0 if np.hypot(*(robot.pose[:2] - before)) > 1e-3 else stuck + 1
        if progress is not None:
            progress(index + 1, len(points) - 1)


def steer(robot: Robot, error_rad: float, speed: float = 1.0) -> bool:
    """Drive one tick towards a direction relative to the robot; turn first if it is far off."""
    error = float(wrap_angle(error_rad))
    forward = robot.body.speed_mps * speed * max(math.cos(min(1.6 * abs(error), math.pi / 2)), 0.0)
    return robot.move(forward, 2.5 * error)


def truth_visits(world: World, log: ScanLog, radius_m: float = 1.2) -> list[str]:
    """Return the places of the true graph that a drive passed, in order.

    Parameters
    ----------
    world : the world driven in. log : a log with true poses.
    radius_m : a place is entered within this distance of its centre, and left half a metre
        beyond; passing one place again without leaving it counts once.

    Raises
    ------
    InputError : the log has no true poses.
    """
    if log.truth is None:
        raise InputError(f"{log.source}: has no true poses, only a simulated drive has them")
    names = list(world.truth)
    centres = np.array([world.position(name) for name in names])
    visits: list[str] = []
    inside = -1
    for pose in log.truth:
        distance = np.hypot(*(centres - pose[:2]).T)
        if inside >= 0 and distance[inside] > radius_m + 0.5:
            inside = -1
        nearest = int(np.argmin(distance))
        if inside < 0 and distance[nearest] <= radius_m:
            inside = nearest
            visits.append(names[nearest])
    return visits
