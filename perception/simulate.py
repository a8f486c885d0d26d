"""A simulated lidar and odometry: what a robot would measure on a known drive.

Frames: poses and segments in ``_map``, ranges and beam angles in the frame of the laser, which
sits in the middle of the robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array, between, chain_motions, wrap_angle

_CHUNK_POSES = 24
_EDGE_TOLERANCE = 1e-7
"""In beam steps: beams through the common end of two segments must not slip between them."""


@dataclass(frozen=True)
class Lidar:
    """A planar laser scanner.

    Attributes
    ----------
    fov_deg : field of view, up to 360.
    beams : number of beams; those at both ends of the field of view are included.
    max_range_m : nothing farther gives a return; the default is that of the scanners in most
        public logs.
    noise_m : standard deviation of a range.
    dropout : share of returns that are lost.
    """

    fov_deg: float = 180.0
    beams: int = 361
    max_range_m: float = 50.0
    noise_m: float = 0.015
    dropout: float = 0.002

    def __post_init__(self) -> None:
        if not 0 < self.fov_deg <= 360 or self.beams < 3:
            raise InputError(
                f"a lidar with {self.beams} beams over {self.fov_deg:g} degrees: expected at "
                "least 3 beams over at most 360 degrees"
            )
        if self.max_range_m <= 0 or self.noise_m < 0 or not 0 <= self.dropout < 1:
            raise InputError("a lidar needs max_range_m > 0, noise_m >= 0 and dropout in [0, 1)")

    @property
    def angles_rad(self) -> Array:
        """Beam angles (beams,), from right to left."""
        return np.asarray(np.deg2rad(np.linspace(-0.5, 0.5, self.beams) * self.fov_deg))


@dataclass(frozen=True)
class OdometryNoise:
    """Errors of the odometry of a differential drive.

    Random errors add up as a random walk, their variance grows with the way and the turning;
    systematic errors (wheels of unequal size, a wrong scale) are drawn once for a drive.

    Attributes
    ----------
    turn_by_turn, turn_by_way : variance of the heading, rad^2 per rad turned and per metre.
    way_by_way, way_by_turn : variance of the way, m^2 per metre and per rad turned.
    veer_rad_per_m, scale : standard deviations of the systematic heading error per metre and
        of the relative error of the way.

    Source
    ------
    The alpha parameters of the odometry motion model of Thrun, Burgard and Fox 2005, 5.4, with
    variances linear in the motion (ours), so that the length of the steps plays no part.
    """

    turn_by_turn: float = 3e-4
    turn_by_way: float = 1e-5
    way_by_way: float = 2e-4
    way_by_turn: float = 1e-5
    veer_rad_per_m: float = 0.002
    scale: float = 0.01


def cast_rays(segments: Array, poses: Array, angles_rad: Array, max_range_m: float = 30.0) -> Array:
    """Measure the distance from each pose, along each beam, to the nearest segment.

    Parameters
    ----------
    segments : (m, 4) x0, y0, x1, y1, metres.
    poses : (n, 3) poses of the laser, m and rad.
    angles_rad : (b,) evenly spaced beam angles, ascending, spanning at most 2 pi.
    max_range_m : beyond it there is no return.

    Returns
    -------
    (n, b) metres, NaN where no segment is hit.

    Examples
    --------
    >>> wall = np.array([[2.0, -1.0, 2.0, 1.0]])
    >>> cast_rays(wall, np.zeros((1, 3)), np.array([0.0, 0.1, 0.2])).round(3).tolist()
    [[2.0, 2.01, 2.041]]
    """
    segments, poses = np.asarray(segments, float).reshape(-1, 4), np.asarray(poses, float)
    angles = np.asarray(angles_rad, float)
    step = (angles[-1] - angles[0]) / (len(angles) - 1) if len(angles) > 1 else 0.0
    if len(angles) < 2 or not np.allclose(np.diff(angles), step, atol=1e-6) or step <= 0:
        raise InputError("beam angles: expected at least two, ascending and evenly spaced")
    ranges = np.full((len(poses), len(angles)), np.inf)
    for start in range(0, len(poses), _CHUNK_POSES):
        chunk = slice(start, start + _CHUNK_POSES)
        _cast_chunk(segments, poses[chunk], angles, step, max_range_m, ranges[chunk])
    ranges[ranges > max_range_m] = np.nan
    return ranges


def _cast_chunk(
    segments: Array, poses: Array, angles: Array, step: float, max_range_m: float, ranges: Array
) -> None:
    """Lower ``ranges`` (n, b) to the nearest hits; each segment meets only the beams towards it."""
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    local = []
    for end in (segments[:, :2], segments[:, 2:]):
        dx, dy = end[:, 0] - poses[:, 0, None], end[:, 1] - poses[:, 1, None]
        local += [c * dx + s * dy, c * dy - s * dx]
    half = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]) / 2
    middle = np.hypot(local[0] + local[2], local[1] + local[3]) / 2
    pose, segment = np.nonzero(middle - half <= max_range_m)
    px, py, qx, qy = (part[pose, segment] for part in local)
    low, high = np.arctan2(py, px), np.arctan2(qy, qx)
    low = np.where(px * qy - py * qx < 0, high, low)
    width = np.abs(wrap_angle(np.arctan2(qy, qx) - np.arctan2(py, px)))
    for turn in (0.0, 2 * np.pi):
        first = np.ceil((low - turn - angles[0]) / step - _EDGE_TOLERANCE)
        last = np.floor((low - turn + width - angles[0]) / step + _EDGE_TOLERANCE)
        first, last = np.maximum(first, 0), np.minimum(last, len(angles) - 1)
        count = np.maximum(last - first + 1, 0).astype(np.int64)
        hit = np.repeat(np.arange(len(count)), count)
        beam = np.arange(len(hit)) - np.repeat(np.cumsum(count) - count, count)
        beam += np.repeat(first.astype(np.int64), count)
        ex, ey = (qx - px)[hit], (qy - py)[hit]
        across = np.cos(angles)[beam] * ey - np.sin(angles)[beam] * ex
        is_edge_on = np.abs(across) < 1e-9 * np.hypot(ex, ey)  # seen from its end
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (px[hit] * ey - py[hit] * ex) / across
        nearer_end = np.minimum(np.hypot(px, py), np.hypot(qx, qy))[hit]
        distance = np.where(is_edge_on, nearer_end, distance)
        good = np.isfinite(distance) & (distance >= 0)
        np.minimum.at(ranges, (pose[hit[good]], beam[good]), distance[good])


def cast_discs(centres: Array, radius_m: float, poses: Array, angles_rad: Array) -> Array:
    """Measure the distance from each pose along each beam to the nearest disc.

    Parameters
    ----------
    centres : (n, k, 2) where the k discs are at each of the n poses, metres.
    radius_m : of every disc.
    poses : (n, 3).
    angles_rad : (b,).

    Returns
    -------
    (n, b) metres, infinite where no disc is hit.
    """
    shift = centres - poses[:, None, :2]  # (n, k, 2)
    heading = poses[:, 2, None] + np.asarray(angles_rad)  # (n, b)
    c, s = np.cos(heading)[:, None, :], np.sin(heading)[:, None, :]
    along = shift[..., 0, None] * c + shift[..., 1, None] * s  # (n, k, b)
    across = shift[..., 1, None] * c - shift[..., 0, None] * s
    inside = radius_m**2 - across**2
    distance = along - np.sqrt(np.maximum(inside, 0.0))
    distance[(inside < 0) | (distance < 0)] = np.inf
    return np.asarray(distance.min(axis=1, initial=np.inf))


def measure_scans(
    segments: Array,
    poses: Array,
    lidar: Lidar,
    rng: np.random.Generator,
    pedestrians: Array | None = None,
) -> NDArray[np.float32]:
    """Simulate the scans of a drive.

    Parameters
    ----------
    segments : (m, 4) of the world.
    poses : (n, 3) true poses of the laser.
    lidar : the scanner.
    rng : source of the noise.
    pedestrians : (n, k, 2) where people stand at each scan, discs of 0.25 m radius.

    Returns
    -------
    (n, beams) float32 metres, NaN where there is no return.
    """
    angles = lidar.angles_rad
    ranges = cast_rays(segments, poses, angles, lidar.max_range_m)
    if pedestrians is not None and pedestrians.shape[1]:
        ranges = np.fmin(ranges, cast_discs(pedestrians, 0.25, poses, angles))
    ranges += rng.normal(0.0, lidar.noise_m, ranges.shape)
    ranges[(ranges > lidar.max_range_m) | (rng.random(ranges.shape) < lidar.dropout)] = np.nan
    return np.asarray(np.maximum(ranges, 0.01), np.float32)


class WheelOdometry:
    """Odometry that drifts, one motion after the other.

    Parameters
    ----------
    noise : size of the errors.
    rng : source of the errors; the systematic ones are drawn at once.
    """

    def __init__(self, noise: OdometryNoise, rng: np.random.Generator) -> None:
        self._noise = noise
        self._rng = rng
        self._veer = rng.normal(0.0, noise.veer_rad_per_m)
        self._scale = 1.0 + rng.normal(0.0, noise.scale)

    def measure(self, motion: Array) -> Array:
        """Return what the wheels report for true motions (..., 3): forward, left, turn."""
        motion = np.asarray(motion, float)
        noise = self._noise
        way = np.hypot(motion[..., 0], motion[..., 1])
        turn = np.abs(motion[..., 2])
        way_sd = np.sqrt(noise.way_by_way * way + noise.way_by_turn * turn)
        turn_sd = np.sqrt(noise.turn_by_turn * turn + noise.turn_by_way * way)
        forward = motion[..., 0] * self._scale + self._rng.normal(0.0, 1.0, way.shape) * way_sd
        turned = motion[..., 2] + self._veer * way + self._rng.normal(0.0, 1.0, way.shape) * turn_sd
        return np.stack([forward, motion[..., 1] * self._scale, turned], axis=-1)


def drift_odometry(
    truth: Array, rng: np.random.Generator, noise: OdometryNoise | None = None
) -> Array:
    """Simulate the odometry of a whole drive.

    Parameters
    ----------
    truth : (n, 3) true poses.
    rng : source of the errors.
    noise : size of the errors.

    Returns
    -------
    (n, 3) odometry poses; they start at the origin of their own frame.
    """
    wheels = WheelOdometry(noise or OdometryNoise(), rng)
    return chain_motions(wheels.measure(between(truth[:-1], truth[1:])))
