"""Poses in the plane, SE(2): composing, inverting, carrying covariances along.

A pose is a float array ``(..., 3)`` of x [m], y [m], theta [rad], counter-clockwise,
x forward, y left. ``[b]_a`` is written ``b_in_a``: the pose b in the frame a.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wrap_angle(angle_rad: Any) -> Any:  # noqa: ANN401
    """Wrap angles into [-pi, pi).

    Examples
    --------
    >>> float(wrap_angle(np.pi))
    -3.141592653589793
    """
    return (np.asarray(angle_rad) + np.pi) % (2 * np.pi) - np.pi


def compose(a: Any, b_in_a: Any) -> Array:  # noqa: ANN401
    """Return ``a (+) b``: the pose b, known in the frame a, in the frame of a.

    Parameters
    ----------
    a, b_in_a : (..., 3) arrays, broadcast against each other; m, m, rad.

    Source
    ------
    Smith, Self and Cheeseman's compounding operator, as used in Beeson 2008, 9.3.1.

    Examples
    --------
    >>> compose([1.0, 0.0, np.pi / 2], [1.0, 0.0, 0.0]).round(3).tolist()
    [1.0, 1.0, 1.571]
    """
    a, b = np.asarray(a, float), np.asarray(b_in_a, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrap_angle(a[..., 2] + b[..., 2])], axis=-1)


def invert(a: Any) -> Array:  # noqa: ANN401
    """Return ``(-) a``: the origin frame in the frame of a.

    Examples
    --------
    >>> bool(np.allclose(compose(invert([1.0, 2.0, 0.3]), [1.0, 2.0, 0.3]), 0))
    True
    """
    a = np.asarray(a, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = -c * a[..., 0] - s * a[..., 1]
    y = s * a[..., 0] - c * a[..., 1]
    return np.stack([x, y, wrap_angle(-a[..., 2])], axis=-1)


def between(a: Any, b: Any) -> Array:  # noqa: ANN401
    """Return ``[b]_a`` for two poses a, b of one frame: ``(-) a (+) b``."""
    return compose(invert(a), b)


def transform_points(pose: Any, points: Any) -> Array:  # noqa: ANN401
    """Carry points ``(..., n, 2)`` from the frame of ``pose`` into the frame pose is given in."""
    pose, points = np.asarray(pose, float), np.asarray(points, float)
    c, s = np.cos(pose[..., 2, None]), np.sin(pose[..., 2, None])
    x = pose[..., 0, None] + c * points[..., 0] - s * points[..., 1]
    y = pose[..., 1, None] + s * points[..., 0] + c * points[..., 1]
    return np.stack([x, y], axis=-1)


def compose_covariance(a: Any, cov_a: Any, b_in_a: Any, cov_b: Any) -> Array:  # noqa: ANN401
    """Return the covariance of ``a (+) b`` to first order, a and b independent.

    Parameters
    ----------
    a, b_in_a : (..., 3) arrays; m, m, rad.
    cov_a, cov_b : (..., 3, 3) arrays, their covariances.

    Source
    ------
    Smith, Self and Cheeseman 1990, as cited by Beeson 2008, 9.3.1.
    """
    a, b = np.asarray(a, float), np.asarray(b_in_a, float)
    c, s, x, y = np.broadcast_arrays(np.cos(a[..., 2]), np.sin(a[..., 2]), b[..., 0], b[..., 1])
    to_a = np.broadcast_to(np.eye(3), (*c.shape, 3, 3)).copy()
    to_a[..., 0, 2], to_a[..., 1, 2] = -s * x - c * y, c * x - s * y
    to_b = np.broadcast_to(np.eye(3), (*c.shape, 3, 3)).copy()
    to_b[..., 0, 0] = to_b[..., 1, 1] = c
    to_b[..., 0, 1], to_b[..., 1, 0] = -s, s
    first = to_a @ np.asarray(cov_a) @ to_a.swapaxes(-1, -2)
    return np.asarray(first + to_b @ np.asarray(cov_b) @ to_b.swapaxes(-1, -2))


def measure_along(points: Any) -> Array:  # noqa: ANN401
    """Return how far each of the points (n, 2) lies along the line through them: (n,), from 0.

    Examples
    --------
    >>> measure_along([[0, 0], [3, 4], [3, 5]]).tolist()
    [0.0, 5.0, 6.0]
    """
    steps = np.hypot(*np.diff(np.asarray(points, float), axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def chain_motions(motions: Any) -> Array:  # noqa: ANN401
    """Compose motions (n, 3), each in the frame the one before leads to: (n + 1, 3) poses.

    The first pose is the origin.

    Examples
    --------
    >>> chain_motions([[1.0, 0.0, np.pi / 2], [1.0, 0.0, 0.0]]).round(3)[-1].tolist()
    [1.0, 1.0, 1.571]
    """
    motions = np.asarray(motions, float).reshape(-1, 3)
    heading = np.concatenate([[0.0], np.cumsum(motions[:, 2])])
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = np.cumsum(c * motions[:, 0] - s * motions[:, 1])
    y = np.cumsum(s * motions[:, 0] + c * motions[:, 1])
    start = np.zeros(1)
    return np.column_stack(
        [np.concatenate([start, x]), np.concatenate([start, y]), wrap_angle(heading)]
    )
