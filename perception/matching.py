"""Scan-to-submap matching: where a scan was taken, among scans whose poses are known.

Two stages. A *correlative* search looks through a whole window of poses on a likelihood field,
coarse to fine, so that a bad guess does no harm; a *point-to-line* least-squares step then gives
the last millimetres and the information matrix. What the scan does not say (how far one has come
along a bare corridor) is taken from the guess and its covariance, as a product of Gaussians.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array, wrap_angle
from perception.surfaces import CELL_M, COARSE, Reference, Surface, fit_normals

RANGE_NOISE_M = 0.015
"""Least standard deviation of a point from its line, metres."""
NORMAL_NOISE_RAD = 0.1
"""Standard deviation of a surface normal; information weaker than it would feign is dropped."""
INDEPENDENCE = 0.15
"""Share of the beams that count as independent (walls are not straight, submaps not exact)."""
BEAM_NATS = 40.0
"""Log-likelihood by which a scan that fits wholly exceeds one that does not fit at all."""
MIN_INLIERS = 0.2
"""Share of the points that must lie on the reference for a match to count."""
FLOOR = (0.003, 0.003, 0.001)
"""Least standard deviation of a matched pose: m, m, rad."""
EAGER_SCORE = 0.7
"""Share of the points that must lie on the reference for a refined guess to need no search."""
MIN_POINTS = 12
"""Fewer points than this are not matched."""


@dataclass(frozen=True)
class Match:
    """The pose of a scan and what is known about its error.

    Attributes
    ----------
    pose : (3,) of the laser in the frame of the reference; m, m, rad.
    covariance : (3, 3) of that pose, same frame; never smaller than the floor of the matcher.
    score : share of the scan's points that lie on the reference, 0 to 1.
    ok : whether the scan was matched; if not, pose and covariance are the guess's.
    """

    pose: Array
    covariance: Array
    score: float
    ok: bool


def match_scan(
    points: Any,  # noqa: ANN401
    reference: Any,  # noqa: ANN401
    guess: Any,  # noqa: ANN401
    covariance: Any = None,  # noqa: ANN401
    *,
    window: tuple[float, float] = (0.3, 0.15),
    eager: bool = False,
) -> Match:
    """Find the pose of a scan within a reference, near a guess.

    Parameters
    ----------
    points : (n, 2) end points in beam order, laser frame, metres; or a fitted :class:`Surface`.
    reference : :class:`Reference`, :class:`Surface`, or (m, 2) points of one scan in beam order,
        in the frame in which ``guess`` is given and seen from its origin.
    guess : (3,) pose to start from; m, m, rad.
    covariance : (3, 3) of the guess, same frame; by default the window is two deviations wide.
    window : half width of the search in translation [m] and rotation [rad].
    eager : refine the guess first, and do without the search where that already fits well.

    Returns
    -------
    Match
        The posterior of guess and scan. Where the scan fits nowhere: the guess, with ``ok`` false.

    Raises
    ------
    InputError
        Points, guess or covariance of the wrong shape or not finite.

    Source
    ------
    Search: after Olson 2009 (real-time correlative scan matching). Refinement: after Censi 2008
    (point-to-line metric). Degeneracy handling and covariance: ours.
    """
    scan = points if isinstance(points, Surface) else fit_normals(points)
    known = reference if isinstance(reference, Reference) else _make_reference(reference)
    if covariance is None:
        covariance = np.diag([window[0] / 2, window[0] / 2, window[1] / 2]) ** 2
    start, prior = _check_guess(guess, covariance)
    miss = Match(start, prior, 0.0, False)
    if len(scan) < MIN_POINTS or len(known.lines) < MIN_POINTS:
        return miss
    first = refine_pose(scan, known, start, start, prior) if eager else miss
    if first.ok and first.score > EAGER_SCORE and _measure_offset(first.pose, start, prior) < 9.0:
        return first
    near = search_poses(scan.points, known, start, prior, window=window)
    if first.ok and _is_close(near, first.pose):
        return first
    found = refine_pose(scan, known, near, start, prior)
    return first if first.ok and first.score >= found.score else found


def search_poses(
    points: Array,
    reference: Reference,
    guess: Array,
    covariance: Array,
    *,
    window: tuple[float, float],
) -> Array:
    """Search a window of poses for the one under which the points fall on the reference.

    Parameters
    ----------
    points : (n, 2) laser frame, metres.
    reference, guess, covariance, window : as in :func:`match_scan`.

    Returns
    -------
    Pose (3,), to about half a cell.

    Source
    ------
    Ours, after Olson 2009: a coarse field that bounds the fine one from above, then the fine field
    in the most promising cells only.
    """
    beams = _thin_points(points, 120)
    reach = float(np.hypot(beams[:, 0], beams[:, 1]).max())
    weight = np.asarray(np.linalg.inv(covariance), float)
    step = COARSE * CELL_M
    turn = max(step / max(reach, 2.0), 0.015)
    poses = _make_lattice(guess[None], _make_axis(window[0], step), _make_axis(window[1], turn))
    rough = _rate_poses(reference.coarse, reference.origin, beams, poses)
    rough += _weigh_prior(poses - guess, weight)
    top = np.argsort(-rough, kind="stable")[:8]
    local = _make_lattice(
        poses[top], np.arange(-2, 3) * CELL_M, _make_axis(turn / 2, max(turn / 4, 0.007))
    )
    score = _rate_poses(reference.fine, reference.origin, beams, local)
    score += _weigh_prior(local - guess, weight)
    return np.asarray(local[int(np.argmax(score))])


def refine_pose(
    scan: Surface,
    reference: Reference,
    start: Array,
    guess: Array,
    covariance: Array,
    *,
    gates_m: tuple[float, ...] = (0.35, 0.2, 0.12, 0.1, 0.1, 0.1),
) -> Match:
    """Refine a pose by point-to-line least squares, together with the Gaussian of the guess.

    Parameters
    ----------
    scan, reference : what is matched, and to what.
    start : (3,) where the iteration starts, within the first gate of the solution.
    guess, covariance : the Gaussian prior of the pose.
    gates_m : for each iteration, how far a point may lie from its line.

    Returns
    -------
    Match with the pose and covariance of the posterior.

    Source
    ------
    Censi 2008 for the metric. The information that noise in the normals would feign along a
    corridor is subtracted, and the step is damped in the same proportion: ours.
    """
    weight = np.linalg.inv(covariance)
    pose = start.copy()
    information, score, trust = np.zeros((3, 3)), 0.0, 1.0
    for gate in gates_m:
        lines = _pair_lines(scan, reference, pose, gate)
        if lines is None:
            return Match(guess, covariance, 0.0, False)
        information, pull, score = _sum_normal_equations(lines, pose, gate, len(scan))
        offset = pose - guess
        offset[2] = wrap_angle(offset[2])
        trust = 7.0 / (4.0 + max(3.0, float(offset @ weight @ offset)))
        step = np.linalg.solve(information + trust * weight, pull - trust * (weight @ offset))
        pose = pose + step
        if gate == gates_m[-1] and np.abs(step).max() < 5e-4:
            break
    pose[2] = wrap_angle(pose[2])
    posterior = np.linalg.inv(information + trust * weight) + np.diag(FLOOR) ** 2
    if score < MIN_INLIERS:
        return Match(guess, covariance, score, False)
    return Match(pose, posterior, score, True)


@dataclass(frozen=True)
class _Lines:
    """Scan points and the lines they belong to, in the frame of the reference; rows x and y."""

    points: Array
    normals: Array
    residual_m: Array


def _pair_lines(scan: Surface, reference: Reference, pose: Array, gate: float) -> _Lines | None:
    """Pair each scan point with the nearest line that looks the same way."""
    moved = scan.moved(pose)
    lines = reference.lines
    far, index = reference.tree.query(moved.points, distance_upper_bound=max(gate, 0.6))
    hit = np.flatnonzero(np.isfinite(far))
    points, facing, index, far = moved.points[hit].T, moved.normals[hit].T, index[hit], far[hit]
    normals = lines.normals[index].T
    gap = lines.points[index].T - points
    residual = gap[0] * normals[0] + gap[1] * normals[1]
    agree = facing[0] * normals[0] + facing[1] * normals[1]
    keep = (np.abs(residual) < gate) & (far < np.maximum(gate, 1.2 * lines.spacing_m[index]))
    chosen = np.flatnonzero(keep & ~(agree < 0.7))
    if len(chosen) < MIN_POINTS:
        return None
    return _Lines(points[:, chosen], normals[:, chosen], residual[chosen])


def _sum_normal_equations(
    lines: _Lines, pose: Array, gate: float, n_points: int
) -> tuple[Array, Array, float]:
    """Return information (3, 3), the pull towards the lines (3,), and the share of inliers."""
    normals, residual = lines.normals, lines.residual_m
    size = np.abs(residual)
    middle = len(size) // 2
    sigma = max(RANGE_NOISE_M, min(1.4826 * float(np.partition(size, middle)[middle]), gate))
    weight = (INDEPENDENCE / sigma**2) / (1.0 + (residual / (2 * sigma)) ** 2)
    arm = lines.points - pose[:2, None]
    jac, side = np.empty((3, len(size))), np.empty((3, len(size)))
    jac[:2], jac[2] = normals, arm[0] * normals[1] - arm[1] * normals[0]
    side[0], side[1] = -normals[1], normals[0]
    side[2] = arm[0] * normals[0] + arm[1] * normals[1]
    raw = (jac * weight) @ jac.T
    feigned = NORMAL_NOISE_RAD**2 * ((side * weight) @ side.T)
    pull = jac @ (weight * residual)
    root = np.linalg.cholesky(raw + 1e-3 * np.eye(3))
    inverse = np.linalg.inv(root)
    share, basis = np.linalg.eigh(inverse @ (raw - feigned) @ inverse.T)
    kept = root @ ((basis * np.clip(share, 0.0, 1.0)) @ basis.T)
    inliers = float(np.count_nonzero(size < max(3 * RANGE_NOISE_M, gate / 2))) / n_points
    return kept @ root.T, kept @ inverse @ pull, inliers


def _is_close(a: Array, b: Array) -> bool:
    """Tell whether refinement from either pose would end at the same one."""
    apart = a - b
    return bool(np.abs(apart[:2]).max() < 0.1 and abs(wrap_angle(apart[2])) < 0.03)


def _measure_offset(pose: Array, guess: Array, covariance: Array) -> float:
    """Return the squared normalised distance of a pose from the guess."""
    offset = pose - guess
    offset[2] = wrap_angle(offset[2])
    return float(offset @ np.linalg.solve(covariance, offset))


def _check_guess(guess: Any, covariance: Any) -> tuple[Array, Array]:  # noqa: ANN401
    pose, spread = np.asarray(guess, float), np.asarray(covariance, float)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise InputError(f"match_scan: guess must be a finite pose (3,), found {pose.tolist()}")
    sound = spread.shape == (3, 3) and np.isfinite(spread).all()
    if not sound or np.linalg.eigvalsh(spread).min() <= 0:
        raise InputError(
            "match_scan: covariance must be (3, 3), finite and positive definite, "
            f"found {spread.tolist()}; widen it if the guess is exact"
        )
    return pose, spread


def _make_reference(reference: Any) -> Reference:  # noqa: ANN401
    return Reference(reference if isinstance(reference, Surface) else fit_normals(reference))


def _make_axis(half_width: float, step: float) -> Array:
    """Return values from -half_width to half_width, no further apart than ``step``."""
    count = int(np.ceil(half_width / step - 1e-9))
    return np.asarray(np.linspace(-half_width, half_width, 2 * count + 1))


def _make_lattice(centres: Array, shifts: Any, turns: Any) -> Array:  # noqa: ANN401
    """Return all poses (k, 3) at given shifts in x and y and given turns from each centre."""
    x, y, a = np.meshgrid(shifts, shifts, turns, indexing="ij")
    offsets = np.column_stack([x.ravel(), y.ravel(), a.ravel()])
    return np.asarray((centres[:, None] + offsets).reshape(-1, 3), float)


def _thin_points(points: Array, count: int) -> Array:
    """Take at most ``count`` points, evenly along the scan."""
    if len(points) <= count:
        return points
    return points[np.linspace(0, len(points) - 1, count).round().astype(np.intp)]


def _weigh_prior(offsets: Array, weight: Array) -> Array:
    """Log-density of pose offsets: Gaussian near the guess, heavy tails for slipping wheels."""
    squares = np.einsum("ki,ij,kj->k", offsets, weight, offsets)
    return np.asarray(-2.0 * np.log1p(squares / 4.0))


def _rate_poses(
    field: NDArray[np.float32], origin: Array, beams: Array, poses: Array, batch: int = 512
) -> Array:
    """Return the log-likelihood (k,) of the beams from each pose (k, 3), up to a constant."""
    height, width = field.shape
    flat = field.ravel()
    homogeneous = np.vstack([beams.T, np.ones(len(beams))]).astype(np.float32)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    shift = (poses[:, :2] - origin) / CELL_M
    to_column = np.column_stack([c / CELL_M, -s / CELL_M, shift[:, 0]]).astype(np.float32)
    to_row = np.column_stack([s / CELL_M, c / CELL_M, shift[:, 1]]).astype(np.float32)
    total = np.empty(len(poses))
    for k in range(0, len(poses), batch):
        column = np.clip((to_column[k : k + batch] @ homogeneous).astype(np.int32), 0, width - 1)
        row = np.clip((to_row[k : k + batch] @ homogeneous).astype(np.int32), 0, height - 1)
        total[k : k + batch] = flat.take(row * width + column).sum(1)
    return total * (BEAM_NATS / len(beams))
