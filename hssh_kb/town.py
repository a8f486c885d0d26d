"""Everything that one map says, far from the robot too, and the window cut from it.

All of a large map is laid out only every so often: the more visits it holds, the rarer. In
between, a new window is laid out from the part of town around the robot, joined by the
shortest ways to whatever else is called for; the rest stays where it was. What is measured
outside that part is left out of account until then, which can only widen covariances
(Rayleigh's monotonicity), so it errs on the safe side. So a window costs what its part of town
costs, however large the town and however long the walk.

How far off a place outside may be is told by samples of the errors of the latest layout of all.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hssh_kb.walk_graph import Array, Index, Step, WalkGraph
from hssh_kb.walk_layout import Window, lay_out

MOST_PLACES = 256
_AROUND = 128  # places of a new window, the nearest ones
_MOST_WANTED = 128  # places that the visit may be at, held beside those
_PART = 192  # places around the robot that are laid out for a new window
_VISITS_PER_WHOLE = 16  # all is laid out when one in so many visits held came since
_SAFE = 1.5  # by how much errors told by a few samples are widened


@dataclass(frozen=True, slots=True)
class Town:
    """What the window was cut from.

    Attributes
    ----------
    graph : the visits up to then.
    errors : (n, 3, s) samples of the errors of the poses of the places, on the axes of the
        graph, against one another.
    since : visits since all of it was laid out.
    deviations : (n, 2) of position [m] and heading [rad] of the places, against the visit then;
        on the safe side.
    outside : (n,) the place is not in the window.
    most : how many places the window may hold.
    limit : a place outside nearer than this share of where the visit may be calls for another
        window; less than 1 where more places were called for than a window can hold.
    """

    graph: WalkGraph
    errors: Array
    since: int
    deviations: Array
    outside: NDArray[np.bool_]
    most: int
    limit: float

    @classmethod
    def start(cls) -> Town:
        """Return the town of the first visit."""
        return cls(
            WalkGraph.start(),
            np.zeros((1, 3, 0)),
            0,
            np.zeros((1, 2)),
            np.zeros(1, bool),
            MOST_PLACES,
            1.0,
        )

    @property
    def spots(self) -> Array:
        """Positions (n, 2) of the places, m."""
        return self.graph.poses[self.graph.first, :2]

    def locate(self, place: int) -> tuple[tuple[float, float, float], Array]:
        """Return the pose of a place, and its deviations."""
        x, y, theta = self.graph.poses[self.graph.first[place]].tolist()
        return (x, y, theta), self.deviations[place]

    def extend(self, steps: Sequence[Step], held: Index, mean: Array, length_m: float) -> WalkGraph:
        """Return the graph with the visits since; parameters as for :meth:`move`."""
        graph = self.graph.extend(steps, length_m)
        poses = graph.poses.copy()
        poses[graph.first[held]] = mean[1:]
        poses[graph.last] = mean[0]
        return replace(graph, poses=poses)

    def move(
        self,
        steps: Sequence[Step],
        held: Index,
        mean: Array,
        pose: tuple[float, float, float],
        wanted: Index,
        length_m: float,
    ) -> tuple[Town, Index, Array]:
        """Return the town with the visits since, a window of places, and their covariance.

        Parameters
        ----------
        steps : the visits since the window was made.
        held, mean : places of the window until now, and the poses (w + 1, 3) of the latest visit
            and of them.
        pose : x [m], y [m], heading [rad] where the robot is going.
        wanted : numbers of places that must be held, the most important first.
        length_m : typical length of a travel.
        """
        graph = self.extend(steps, held, mean, length_m)
        since, here = self.since + len(steps), int(graph.place[graph.last])
        is_whole = len(graph.first) <= _PART or since * _VISITS_PER_WHOLE >= len(graph.poses)
        if is_whole:
            graph = graph.forget()
        chosen = _choose_near(graph, pose, _AROUND)
        chosen[wanted[:_MOST_WANTED]] = chosen[here] = True
        places = np.flatnonzero(chosen)
        if is_whole:
            window, since = lay_out(graph, places, length_m, sampled=True), 0
            graph, errors = window.graph, window.samples
        else:
            part = chosen | _choose_near(graph, pose, _PART)
            window, graph = _lay_out_part(graph, part, places, length_m)
            errors = self._note_errors(graph, steps)
        deviations = _measure_deviations(graph, errors, window, places)
        most = max(MOST_PLACES, len(places) + MOST_PLACES - _AROUND)
        limit = 1.0 if len(wanted) <= _MOST_WANTED else 0.5
        town = Town(graph, errors, since, deviations, ~chosen, most, limit)
        return town, places, window.cov

    def _note_errors(self, graph: WalkGraph, steps: Sequence[Step]) -> Array:
        """Return the samples of the errors with those of the places found since."""
        known, size = len(self.errors), self.errors.shape[2]
        errors = np.concatenate([self.errors, np.zeros((len(graph.first) - known, 3, size))])
        spots = graph.poses[graph.first, :2]
        before, loose = int(self.graph.place[self.graph.last]), 0.0
        for step in steps:
            if step.is_new:
                x, y = spots[step.place] - spots[before]
                draws = np.random.default_rng(step.place).standard_normal((3, size))
                (a, _, _), (_, b, _), (_, _, c) = step.cov
                turn = errors[before, 2] + math.sqrt(c + loose) * draws[2]
                errors[step.place, 0] = errors[before, 0] - y * turn + math.sqrt(a + b) * draws[0]
                errors[step.place, 1] = errors[before, 1] + x * turn + math.sqrt(a + b) * draws[1]
                errors[step.place, 2] = turn
            before = step.place
            loose = 0.0 if step.is_new or math.isinf(step.noise[2]) else step.noise[2]
        return errors


def _choose_near(
    graph: WalkGraph, pose: tuple[float, float, float], count: int
) -> NDArray[np.bool_]:
    """Return which places (n,) are the nearest to a pose."""
    off = np.hypot(*(graph.poses[graph.first, :2] - pose[:2]).T)
    chosen = np.zeros(len(off), bool)
    chosen[np.argsort(off, kind="stable")[:count]] = True
    return chosen


def _lay_out_part(
    graph: WalkGraph, part: NDArray[np.bool_], places: Index, length_m: float
) -> tuple[Window, WalkGraph]:
    """Lay out some places of a graph and the ways to them; return the window and all of it."""
    joined = graph.find_paths(part)
    cut, nodes = graph.cut(joined)
    number = np.cumsum(joined) - 1
    window = lay_out(cut, number[places], length_m, sampled=False)
    poses = graph.poses.copy()
    poses[nodes] = window.graph.poses
    return window, replace(graph, poses=poses)


def _measure_deviations(graph: WalkGraph, errors: Array, window: Window, places: Index) -> Array:
    """Return the deviations (n, 2) of all places as seen from the latest visit."""
    here = int(graph.place[graph.last])
    away = graph.poses[graph.first, :2] - graph.poses[graph.last, :2]
    off = errors - errors[here]
    off[:, 0] += away[:, 1:] * errors[here, 2]
    off[:, 1] -= away[:, :1] * errors[here, 2]
    mean = _SAFE**2 * np.mean(off**2, axis=2)
    slot = 3 * int(np.searchsorted(places, here)) + 3
    turn = float(window.cov[slot + 2, slot + 2])
    far = mean[:, 0] + mean[:, 1] + turn * np.sum(away**2, axis=1)
    return np.asarray(np.sqrt(np.column_stack([far, mean[:, 2] + turn])))
