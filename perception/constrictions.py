"""Constrictions of a whole floor: where its skeleton is narrow and opens again on both sides."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from perception.floor_space import FloorSpace
from perception.geometry import Array
from perception.region import Index
from perception.skeleton import OPEN, Branch, Skeleton

LEAST_OPENING = 1.03
"""Clearance on both sides of a constriction over that in it, at least."""

_WINDOW_M = 1.5
_APART_M = 0.8


@dataclass(frozen=True)
class Constriction:
    """A narrow point of a branch of the skeleton; pixels of the crop, x right, y down.

    Attributes
    ----------
    branch, point : index of the branch, and of the point on it.
    centre_px, ends_px : its middle and its two ends, the left one first looking along the branch.
    width_m : its length.
    opening : how many times wider it gets on the less open side, within 1.5 m.
    """

    branch: int
    point: int
    centre_px: tuple[float, float]
    ends_px: tuple[tuple[float, float], tuple[float, float]]
    width_m: float
    opening: float


def find_constrictions(space: FloorSpace, skeleton: Skeleton) -> tuple[Constriction, ...]:
    """Find the constrictions on the branches of a skeleton, by branch and along it.

    Source
    ------
    Ours: minima of clearance that open again on both sides; of those nearer than 0.8 m on a
    branch the narrowest.
    """
    ahead = _look_ahead(skeleton, space)
    found = []
    for k, branch in enumerate(skeleton.branches):
        for i, opening in _find_minima(k, branch, ahead, space):
            ends = space.region.walls[[branch.left[i], branch.right[i]]].astype(float)
            x, y = ends.mean(axis=0).tolist()
            (ax, ay), (bx, by) = ends.tolist()
            width = 2.0 * float(branch.radius_px[i]) * space.resolution_m
            found.append(Constriction(k, i, (x, y), ((ax, ay), (bx, by)), width, opening))
    return tuple(found)


_Profile = tuple[Array, Array]


def _look_ahead(skeleton: Skeleton, space: FloorSpace) -> dict[int, list[tuple[int, _Profile]]]:
    """Return for each node the greatest clearance within a way along each of its branches."""
    limit = _WINDOW_M / space.resolution_m
    ahead: dict[int, list[tuple[int, _Profile]]] = defaultdict(list)
    for k, branch in enumerate(skeleton.branches):
        for node, outward in ((branch.tail, branch), (branch.head, branch.reversed())):
            steps = outward.steps_px
            last = int(np.searchsorted(steps, limit, side="right"))
            greatest = np.maximum.accumulate(outward.radius_px[:last])
            ahead[node].append((k, (steps[:last], greatest)))
    return ahead


def _find_minima(
    k: int,
    branch: Branch,
    ahead: dict[int, list[tuple[int, _Profile]]],
    space: FloorSpace,
) -> list[tuple[int, float]]:
    """Return (point, opening) of the minima of clearance of a branch."""
    steps, radius = branch.steps_px, branch.radius_px
    if len(radius) < 3:
        return []
    at = np.arange(0.0, steps[-1] + 1e-9)
    level = np.interp(at, steps, radius)
    size = 2 * round(0.5 * _APART_M / space.resolution_m) + 1
    lowest = minimum_filter1d(level, size, mode="nearest")
    minima = np.flatnonzero(level <= lowest + 1e-9)
    minima = np.array([run[len(run) // 2] for run in _split_runs(minima)], np.int64)
    window = _WINDOW_M / space.resolution_m
    found = []
    for m in minima.tolist():
        i = int(np.abs(steps - at[m]).argmin())
        if OPEN in (branch.left[i], branch.right[i]):
            continue
        before = level[max(0, m - int(window)) : m + 1].max()
        after = level[m : m + int(window) + 1].max()
        before = max(before, _look(ahead[branch.tail], k, window - at[m]))
        after = max(after, _look(ahead[branch.head], k, window - (at[-1] - at[m])))
        opening = float(min(before, after) / level[m])
        if opening >= LEAST_OPENING:
            found.append((i, opening))
    return found


def _split_runs(index: Index) -> list[Index]:
    """Split sorted indices where they are not consecutive."""
    if not len(index):
        return []
    return np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)


def _look(ahead: list[tuple[int, _Profile]], own: int, left_px: float) -> float:
    """Return the greatest clearance within the way left, on any other branch of a node."""
    best = 0.0
    if left_px <= 0:
        return best
    for k, (steps, greatest) in ahead:
        if k == own:
            continue
        i = int(np.searchsorted(steps, left_px, side="right")) - 1
        if i >= 0:
            best = max(best, float(greatest[i]))
    return best
