"""A drive as a chain of poses, and how well two of them are known relative to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array, between


@dataclass(frozen=True)
class Trajectory:
    """Poses along a drive, with covariances relative to earlier ones.

    Attributes
    ----------
    poses : (n, 3) of the laser, in the frame of the first scan; m, m, rad.
    step_covariances : (n, 3, 3) of the pose of scan k in the frame of scan k - 1; 0 for k = 0.
    matched : (n,) whether the scan could be matched; if not, the step is odometry alone.
    scores : (n,) share of the scan that lies on the submap, 0 to 1.
    keys : (n,) the key scan before scan k, 0 for k = 0: scans are matched to key scans, so that
        this is what their errors are independent of. None: each scan is the key of the next.
    key_covariances : (n, 3, 3) of the pose of scan k in the frame of its key scan; None with keys.
    """

    poses: Array
    step_covariances: Array
    matched: NDArray[np.bool_]
    scores: Array
    keys: NDArray[np.intp] | None = None
    key_covariances: Array | None = None

    def __len__(self) -> int:
        return len(self.poses)


def relative_pose(trajectory: Trajectory, i: int, j: int) -> Array:
    """Return the pose (3,) of scan j in the frame of scan i; m, m, rad."""
    return between(trajectory.poses[i], trajectory.poses[j])


def covariance_between(trajectory: Trajectory, i: int, j: int) -> Array:
    """Return the covariance (3, 3) of the pose of scan j in the frame of scan i, to first order.

    Parameters
    ----------
    trajectory : n scans.
    i, j : scans, ``0 <= i, j < n``, in any order. Errors of different links count as independent;
        the links run from key scan to key scan, and from the last ones to i and j.

    Raises
    ------
    InputError
        A scan that the trajectory does not have.

    Source
    ------
    The compounding of Smith, Self and Cheeseman, as in Beeson 2008, 9.3.1, summed in closed form.

    Examples
    --------
    >>> straight = np.column_stack([np.arange(3.0), np.zeros((3, 2))])
    >>> each = np.stack([np.diag([0.01, 0.01, 0.0001])] * 3)
    >>> drive = Trajectory(straight, each, np.ones(3, bool), np.ones(3))
    >>> covariance_between(drive, 0, 2).diagonal().round(4).tolist()
    [0.02, 0.0201, 0.0002]
    """
    n = len(trajectory)
    if not (0 <= i < n and 0 <= j < n):
        raise InputError(f"covariance_between: scans {i} and {j} asked for, there are 0 to {n - 1}")
    first, last = min(i, j), max(i, j)
    if first == last:
        return np.zeros((3, 3))
    children, parents, links = _collect_links(trajectory, first, last)
    base = trajectory.poses[first]
    end = between(base, trajectory.poses[last])
    arm = end[:2] - between(base, trajectory.poses[children])[:, :2]
    heading = trajectory.poses[parents, 2] - base[2]
    jac = np.zeros((len(children), 3, 3))
    jac[:, 0, 0] = jac[:, 1, 1] = np.cos(heading)
    jac[:, 1, 0] = np.sin(heading)
    jac[:, 0, 1] = -jac[:, 1, 0]
    jac[:, 0, 2], jac[:, 1, 2] = -arm[:, 1], arm[:, 0]  # a turn swings all that follows
    jac[:, 2, 2] = 1.0
    forward = np.einsum("kij,kjl,kml->im", jac, links, jac)
    if i < j:
        return np.asarray(forward)
    x, y, turn = end
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[-c, -s, s * x - c * y], [s, -c, c * x + s * y], [0.0, 0.0, -1.0]])
    return np.asarray(back @ forward @ back.T)


def _collect_links(
    trajectory: Trajectory, first: int, last: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return the links between two scans: later scans, earlier scans, covariances (k, 3, 3)."""
    keys, covariances = trajectory.keys, trajectory.key_covariances
    if keys is None or covariances is None:
        children = np.arange(first + 1, last + 1)
        return children, children - 1, trajectory.step_covariances[children]
    chain, k = [], last
    while k > first:
        chain.append(k)
        k = int(keys[k])
    if k != first:  # the first scan is no key scan: through the one before it
        chain.append(first)
    children = np.array(chain)
    return children, keys[children], covariances[children]
