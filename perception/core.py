"""Base points and core of a place neighbourhood, and the arms of skeleton that leave it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from perception.errors import InputError
from perception.geometry import Array
from perception.grid import Mask
from perception.pruning import find_closest
from perception.region import Region
from perception.skeleton import OPEN, Branch, Skeleton

Base = Literal["settled", "closest"]

LEAST_BEND_RAD = math.radians(35.0)
"""A skeleton that turns more than this within a place makes it a place of its own."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A stretch of skeleton that leads out of the core.

    Attributes
    ----------
    branch : from its base point (a junction, or the point closest to the robot) outward.
    edge : index of the first point beyond the core.
    frontier_px : width of the widest exit that can be reached along it; 0 if there is none.
    depth_px : length of skeleton from the base point to the farthest such exit.
    """

    branch: Branch
    edge: int
    frontier_px: float
    depth_px: float


@dataclass(frozen=True, eq=False)
class Core:
    """The heart of the place neighbourhood.

    Attributes
    ----------
    closest_px : the point of the skeleton closest to the robot.
    base_px, base_radius_px : (k, 2), (k,) the base points and their distance to obstacles.
    at_junction : whether the base points are junctions.
    is_reached : False while the robot is still on the path to a dead end ahead.
    arms : what leads away, in no order.
    """

    closest_px: tuple[float, float]
    base_px: Array
    base_radius_px: Array
    at_junction: bool
    arms: tuple[Arm, ...]
    is_reached: bool = True

    def holds(self, points_px: Array) -> Mask:
        """Return which points (n, 2) lie within the radius of a base point."""
        (x, y), (base_x, base_y) = points_px.T, self.base_px.T[:, :, None]
        near = np.hypot(x - base_x, y - base_y) <= self.base_radius_px[:, None]
        return np.asarray(near.any(axis=0))


def find_core(skeleton: Skeleton, region: Region, *, base: Base = "settled") -> Core:
    """Find base points and core of a pruned skeleton that has at least one branch.

    The base points are the junctions near the robot and what neighbours them. Without a junction,
    ``"closest"``, as published: the point closest to the robot. ``"settled"``: a sharp bend of the
    skeleton near the robot, or the end of a dead end, else the point closest to the robot, so that
    such places do not wander with the robot; and junctions near that bend, or joined to the others
    by a branch inside their discs, count too.

    Raises
    ------
    InputError : there is no such way to choose.

    Source
    ------
    Beeson 2008, Algorithm 6.1; ``"settled"`` is ours.
    """
    if base not in get_args(Base):
        raise InputError(f"there are no base points {base!r}; choose 'settled' or 'closest'")
    settled = base == "settled"
    index, k = find_closest(skeleton, region, region.start)
    branch = skeleton.branches[index]
    closest = _as_pair(branch.points_px[k])
    near = _near_junctions(skeleton, branch.points_px[k], linked=settled)
    if not near and settled:
        k = _find_anchor_point(skeleton, branch, k)
        here, reach = branch.points_px[k], float(branch.radius_px[k])
        near = _near_junctions(skeleton, here, linked=True, reach_px=reach)
    if near:
        nodes = [skeleton.nodes[j] for j in near]
        places = np.array([node.point_px for node in nodes])
        core = Core(closest, places, np.array([node.radius_px for node in nodes]), True, ())
        return _with_arms(core, skeleton, region, _leave_junctions(skeleton, near))
    reached = np.hypot(*(branch.points_px[k] - closest)) <= 1.5 * branch.radius_px[k] + 1.0
    core = Core(
        closest,
        branch.points_px[k : k + 1],
        branch.radius_px[k : k + 1],
        False,
        (),
        bool(reached),
    )
    return _with_arms(core, skeleton, region, _leave_point(skeleton, branch, k))


def _near_junctions(
    skeleton: Skeleton, point: Array, *, linked: bool, reach_px: float | None = None
) -> list[int]:
    """Return the junctions whose disc holds a point, or those in reach of it, and neighbours.

    Neighbours are junctions of which one holds the other; if asked for, also those that a branch
    joins inside the discs of the others.
    """
    junctions = skeleton.junctions()
    if not junctions:
        return []
    places = np.array([skeleton.nodes[j].point_px for j in junctions])
    radii = np.array([skeleton.nodes[j].radius_px for j in junctions])
    gap = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    neighbour = gap <= np.maximum(radii[:, None], radii[None])
    reach = radii if reach_px is None else np.full(len(radii), reach_px)
    chosen = np.hypot(*(places - point).T) <= reach
    while True:
        grown = chosen | neighbour[chosen].any(axis=0)
        if linked:
            grown |= _is_linked(skeleton, junctions, places, radii, grown)
        if (grown == chosen).all():
            return [junctions[i] for i in np.flatnonzero(chosen)]
        chosen = grown


def _is_linked(
    skeleton: Skeleton, junctions: list[int], places: Array, radii: Array, chosen: Mask
) -> Mask:
    """Tell which junctions a branch joins to chosen ones without leaving the discs of those."""
    number = {node: k for k, node in enumerate(junctions)}
    linked = np.zeros(len(junctions), bool)
    if not chosen.any():
        return linked
    for branch in skeleton.branches:
        tail, head = number.get(branch.tail, -1), number.get(branch.head, -1)
        if min(tail, head) < 0 or chosen[tail] == chosen[head]:
            continue
        gap = branch.points_px[:, None] - places[chosen][None]
        if (np.hypot(gap[..., 0], gap[..., 1]) <= radii[chosen]).any(axis=1).all():
            linked[[tail, head]] = True
    return linked


def _find_anchor_point(skeleton: Skeleton, branch: Branch, k: int) -> int:
    """Return the bend of a branch near its point k; else the dead end it leads to; else k."""
    degree = skeleton.degree()
    other = k
    for node, outward in ((branch.head, 1), (branch.tail, -1)):
        if degree[node] == 1 and skeleton.nodes[node].exit is None:
            other = _find_dead_end(branch, outward)
            if _hold_each_other(branch, other, k):
                return other
    steps, points = branch.steps_px, branch.points_px
    gap = np.hypot(*(points - points[k]).T)
    near = np.flatnonzero(gap <= np.maximum(branch.radius_px, branch.radius_px[k]))
    near = near[np.abs(steps[near] - steps[k]) <= 2.0 * branch.radius_px[k]]
    reach = 1.3 * branch.radius_px[near]
    bend = branch.measure_bends(near, reach)
    bend[(steps[near] < 0.5 * reach) | (steps[near] > steps[-1] - 0.5 * reach)] = 0.0
    if not len(near) or bend.max() < LEAST_BEND_RAD:
        return other
    return int(near[bend.argmax()])


def _find_dead_end(branch: Branch, outward: int) -> int:
    """Return the last point of a branch before its clearance shrinks into the dead end.

    Only the last stretch of it tells how wide the dead end is: a bulge further off does not.
    """
    radius, steps = branch.radius_px[::outward], branch.steps_px
    left_over = steps[-1] - steps if outward == 1 else steps[::-1]
    final = left_over <= 2.0 * float(np.median(radius))
    last = int(np.flatnonzero(radius >= 0.9 * radius[final].max())[-1])
    return last if outward == 1 else len(radius) - 1 - last


def _hold_each_other(branch: Branch, i: int, k: int) -> bool:
    gap = float(np.hypot(*(branch.points_px[i] - branch.points_px[k])))
    return gap <= max(float(branch.radius_px[i]), float(branch.radius_px[k]))


def _as_pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])


_Leaving = list[tuple[Branch, Branch]]
"""Branches outward from a base point, each with the branch of the skeleton that it is part of."""


def _leave_junctions(skeleton: Skeleton, base: list[int]) -> _Leaving:
    """Return the branches that start at base junctions, outward, a loop or a link both ways."""
    leaving = []
    for branch in skeleton.branches:
        if branch.tail in base:
            leaving.append((branch, branch))
        if branch.head in base:
            leaving.append((branch.reversed(), branch))
    return leaving


def _leave_point(skeleton: Skeleton, branch: Branch, k: int) -> _Leaving:
    """Return the two halves of a branch, outward from its point k.

    A half that only leads into a dead end is left out if the point stands in that dead end.
    """
    degree = skeleton.degree()
    size = len(branch.points_px)
    if branch.tail == branch.head and degree[branch.tail] == 2:
        turned = np.roll(np.arange(size), -k)
        whole = Branch(
            -1,
            -1,
            branch.points_px[turned],
            branch.radius_px[turned],
            branch.left[turned],
            branch.right[turned],
        )
        half = max(size // 2, 1)
        back = whole.reversed()
        return [(whole.part(0, half, -1, -2), branch), (back.part(0, half, -1, -2), branch)]
    halves = []
    after, before = branch.part(k, size, -1, branch.head), branch.part(0, k + 1, branch.tail, -1)
    for outward in (after, before.reversed()):
        if degree[outward.head] == 1 and skeleton.nodes[outward.head].exit is None:
            end = _find_dead_end(outward, 1) if len(outward.points_px) > 1 else 0
            if _hold_each_other(outward, end, 0):
                continue
            outward = outward.part(0, end + 1, outward.tail, outward.head)
        halves.append((outward, branch))
    return halves


def _with_arms(core: Core, skeleton: Skeleton, region: Region, leaving: _Leaving) -> Core:
    """Return the core with those of the leaving branches that get out of it."""
    arms = []
    for branch, own in leaving:
        inside = core.holds(branch.points_px)
        if inside.all():
            if _exit_width(skeleton, region, branch.head) is None:
                continue  # a link between two base points
            edge = len(inside) - 1
        else:
            edge = int(np.argmin(inside))
        if _returns_early(core, branch, inside):
            continue
        frontier, beyond = _look_beyond(skeleton, region, branch, own)
        arms.append(Arm(branch, edge, frontier, beyond))
    return replace(core, arms=tuple(arms))


def _returns_early(core: Core, branch: Branch, inside: Mask) -> bool:
    """Tell whether a branch leaves the core only to come back after a small detour."""
    outside = np.flatnonzero(~inside)
    if not len(outside) or not inside[-1] or not inside[0]:
        return False
    length = branch.steps_px[outside[-1]] - branch.steps_px[outside[0]]
    sides_open = np.mean((branch.left == OPEN) | (branch.right == OPEN))
    return bool(length < float(core.base_radius_px.max()) * (1.0 + sides_open))


def _exit_width(skeleton: Skeleton, region: Region, node: int) -> float | None:
    """Return the width of the exit at a node, None if it is none."""
    if node not in skeleton.nodes:
        return None
    number = skeleton.nodes[node].exit
    return None if number is None else region.exits[number].width_px


def _look_beyond(
    skeleton: Skeleton, region: Region, branch: Branch, own: Branch
) -> tuple[float, float]:
    """Return the width of the widest exit along a branch, and the way to the farthest one."""
    frontier, depth = 0.0, 0.0
    seen = {branch.tail}
    open_ = [(branch.head, float(branch.steps_px[-1]), own)]
    while open_:
        node, way, by = open_.pop()
        if node in seen or node not in skeleton.nodes:
            continue
        seen.add(node)
        links = [b for b in skeleton.branches if node in (b.tail, b.head) and b is not by]
        width = _exit_width(skeleton, region, node)
        if width is not None and not links:
            frontier, depth = max(frontier, width), max(depth, way)
        for link in links:
            other = link.head if link.tail == node else link.tail
            open_.append((other, way + float(link.steps_px[-1]), link))
    return frontier, depth or float(branch.steps_px[-1])
