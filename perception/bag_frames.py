"""Frames of a recording: a tree of transforms, and the pose of one frame in another at given times.

Source: the ROS tf conventions (REP 105: map -> odom -> base -> sensors).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from perception.geometry import Array


@dataclass
class FrameTree:
    """Transforms by child frame: times, and pose of the child in its parent.

    Each sample is (t, x, y, z, qx, qy, qz, qw); metres, seconds. Static transforms have one sample
    whose time means nothing.
    """

    parent: dict[str, str] = field(default_factory=dict)
    samples: dict[str, list[tuple[float, ...]]] = field(default_factory=lambda: defaultdict(list))
    static: set[str] = field(default_factory=set)

    def add(
        self, parent: str, child: str, sample: tuple[float, ...], *, static: bool = False
    ) -> None:
        """Add one transform; of two parents the last one told counts."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if static:
            self.static.add(child)
            self.samples[child] = [sample]
        else:
            self.samples[child].append(sample)
        self.parent[child] = parent

    def list_ancestors(self, frame: str) -> list[str]:
        """Return a frame and what it is fixed to, up to the root."""
        chain = [frame.lstrip("/")]
        while chain[-1] in self.parent and self.parent[chain[-1]] not in chain:
            chain.append(self.parent[chain[-1]])
        return chain

    def moves(self, frame: str, ancestor: str) -> bool:
        """Tell whether a frame moves in one of its ancestors."""
        chain = self.list_ancestors(frame)
        return any(child not in self.static for child in chain[: chain.index(ancestor)])

    def find_span(self, frame: str, ancestor: str) -> tuple[float, float]:
        """Return the first and last time at which the pose of a frame in an ancestor is known."""
        chain = self.list_ancestors(frame)
        first, last = -np.inf, np.inf
        for child in chain[: chain.index(ancestor)]:
            if child not in self.static:
                times = [sample[0] for sample in self.samples[child]]
                first, last = max(first, min(times)), min(last, max(times))
        return first, last

    def find_poses(self, frame: str, ancestor: str, times_s: Array) -> Array:
        """Return (n, 4, 4) transforms that carry points of a frame into an ancestor.

        Between samples they are interpolated, beyond them held.
        """
        chain = self.list_ancestors(frame)
        out = np.repeat(np.eye(4)[None], len(times_s), axis=0)
        for child in chain[: chain.index(ancestor)]:
            out = self._sample(child, times_s) @ out
        return out

    def _sample(self, child: str, times_s: Array) -> Array:
        rows = np.array(sorted(self.samples[child]), float)
        if len(rows) == 1:
            return np.repeat(make_transforms(rows[:, 1:4], rows[:, 4:]), len(times_s), axis=0)
        return interpolate_transforms(rows, times_s)


def interpolate_transforms(rows: Array, times_s: Array) -> Array:
    """Return (n, 4, 4) transforms at given times from samples (m, 8), sorted by time."""
    at = np.clip(np.searchsorted(rows[:, 0], times_s) - 1, 0, len(rows) - 2)
    one, two = rows[at], rows[at + 1]
    span = np.where(two[:, 0] > one[:, 0], two[:, 0] - one[:, 0], 1.0)
    share = np.clip((times_s - one[:, 0]) / span, 0.0, 1.0)[:, None]
    sign = np.sign(np.sum(one[:, 4:] * two[:, 4:], axis=1, keepdims=True))
    turn = one[:, 4:] * (1 - share) + two[:, 4:] * share * np.where(sign == 0, 1.0, sign)
    return make_transforms(one[:, 1:4] * (1 - share) + two[:, 1:4] * share, turn)


def make_transforms(positions: Array, quaternions: Array) -> Array:
    """Return (n, 4, 4) from positions (n, 3) and quaternions (n, 4) x, y, z, w.

    A quaternion of length 0, as some drivers send, is no rotation.
    """
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(length > 1e-9, quaternions / np.maximum(length, 1e-9), [0.0, 0.0, 0.0, 1.0])
    x, y, z, w = unit.T
    out = np.repeat(np.eye(4)[None], len(positions), axis=0)
    out[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], 1)
    out[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], 1)
    out[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], 1)
    out[:, :3, 3] = positions
    return out


def flatten_transforms(transforms: Array) -> Array:
    """Return the poses (n, 3) x, y, theta of transforms (n, 4, 4) seen from above."""
    heading = np.arctan2(transforms[:, 1, 0], transforms[:, 0, 0])
    return np.column_stack([transforms[:, 0, 3], transforms[:, 1, 3], heading])
