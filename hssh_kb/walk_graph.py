"""The walk behind one map as a pose graph: what is known of places far from the robot.

Nodes are visits, edges are travels and closures. The part of the graph where the robot is gets
laid out afresh (:mod:`hssh_kb.walk_layout`) whenever the estimate of :mod:`hssh_kb.place_filter`
moves on to another part of town. Graphs are never changed, so all maps that grow from one share
it.

To keep the cost of an arrival flat however long the robot walks, a travel between two places
that others have measured often enough is forgotten once it is far behind. Leaving out a
measurement can only widen the covariances (Rayleigh's monotonicity), so it errs on the safe side.

Source: Beeson 2008, section 9.3.2 (G(chi)); conditional windows and forgetting are ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse import csgraph

from perception.geometry import wrap_angle

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_MOST_TRAVELS = 2  # measurements of one corridor that are enough
_LEAD = 4  # travels kept before one that is needed: they say where it heads
_RECENT = 64  # travels never forgotten
_ANY_RAD2 = (2 * np.pi) ** 2  # variance of a heading that was not measured
_TIE_M = 1e-5  # visits to one place lie at least this far apart, in lengths of a travel


class Step(NamedTuple):
    """One visit as the map takes it.

    Attributes
    ----------
    place : number of the place.
    is_new : it is the first visit to the place.
    pose : (3,) first estimate of the pose of the visit, frame of the graph.
    move : (3,) displacement that led to it; x, y [m], theta [rad].
    cov : (3, 3) of the displacement, nested.
    turn_rad : direction of the frame of the visit in the frame of the place.
    noise : variances of x, y [m2] and heading [rad2] of the visit about its place.
    """

    place: int
    is_new: bool
    pose: tuple[float, float, float]
    move: tuple[float, float, float]
    cov: Sequence[Sequence[float]]
    turn_rad: float
    noise: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class WalkGraph:
    """Visits that are remembered, and what ties them together.

    Attributes
    ----------
    poses : (m, 3) of the visits, in one frame for all.
    place : (m,) number of the place of each visit.
    first : (n,) node of the first visit to each place.
    ends : (k, 2) nodes of each edge: the second is measured in the frame of the first.
    measured : (k, 3) x, y [m], theta [rad].
    weights : (k, 3, 3) information matrices.
    travelled : (k,) the edge is a travel, not a tie of a visit to its place.
    last : node of the latest visit.
    """

    poses: Array
    place: Index
    first: Index
    ends: Index
    measured: Array
    weights: Array
    travelled: NDArray[np.bool_]
    last: int

    @classmethod
    def start(cls) -> WalkGraph:
        """Return the graph of the first visit."""
        none = np.zeros((0, 3))
        return cls(
            np.zeros((1, 3)),
            np.zeros(1, np.intp),
            np.zeros(1, np.intp),
            np.zeros((0, 2), np.intp),
            none,
            np.zeros((0, 3, 3)),
            np.zeros(0, bool),
            0,
        )

    def extend(self, steps: Iterable[Step], length_m: float) -> WalkGraph:
        """Return the graph with more visits; parameters in order of time.

        Parameters
        ----------
        steps : the visits since.
        length_m : typical length of a travel.
        """
        poses, place, first = [self.poses], [*self.place.tolist()], [*self.first.tolist()]
        ends, measured, weights, travelled = [], [], [], []
        last, tie = self.last, (_TIE_M * length_m) ** 2
        for step in steps:
            node = len(place)
            place.append(step.place)
            poses.append(np.array(step.pose)[None])
            ends.append((last, node))
            measured.append(step.move)
            weights.append(np.linalg.inv(step.cov))
            travelled.append(True)
            if step.is_new:
                first.append(node)
            else:
                x, y, turn = step.noise
                ends.append((first[step.place], node))
                measured.append((0.0, 0.0, step.turn_rad))
                around = float(np.concatenate(poses)[first[step.place], 2]) if x != y else 0.0
                weights.append(_invert_noise(max(x, tie), max(y, tie), turn, around))
                travelled.append(False)
            last = node
        if not ends:
            return self
        return WalkGraph(
            np.concatenate(poses),
            np.array(place, np.intp),
            np.array(first, np.intp),
            np.concatenate([self.ends, np.array(ends, np.intp)]),
            np.concatenate([self.measured, np.array(measured)]),
            np.concatenate([self.weights, np.array(weights)]),
            np.concatenate([self.travelled, np.array(travelled)]),
            last,
        )

    def forget(self) -> WalkGraph:
        """Return the graph without travels that others have measured often enough."""
        kept = self._choose_kept()
        if kept.all():
            return self
        nodes = np.zeros(len(self.poses), bool)
        nodes[self.first] = nodes[self.last] = True
        nodes[self.ends[kept & self.travelled].ravel()] = True
        kept &= nodes[self.ends].all(axis=1)
        number = np.cumsum(nodes) - 1
        return WalkGraph(
            self.poses[nodes],
            self.place[nodes],
            number[self.first],
            number[self.ends[kept]],
            self.measured[kept],
            self.weights[kept],
            self.travelled[kept],
            int(number[self.last]),
        )

    def _choose_kept(self) -> NDArray[np.bool_]:
        """Return which edges to keep (k,)."""
        kept = np.ones(len(self.ends), bool)
        travels = np.flatnonzero(self.travelled)
        if len(travels) <= _RECENT:
            return kept
        pairs = np.sort(self.place[self.ends[travels]], axis=1)
        names = pairs[:, 0] * len(self.first) + pairs[:, 1]
        order = np.argsort(names, kind="stable")
        starts = np.r_[True, np.diff(names[order]) != 0]
        since = np.arange(len(order)) - np.maximum.accumulate(
            np.where(starts, np.arange(len(order)), 0)
        )
        rank = np.empty(len(order), np.intp)
        rank[order] = since
        needed = rank < _MOST_TRAVELS
        needed[-_RECENT:] = True
        early = self.ends[travels, 0]
        follows = np.r_[False, self.ends[travels[:-1], 1] == early[1:]]
        lead = needed.copy()
        for _ in range(_LEAD):
            lead[:-1] |= lead[1:] & follows[1:]
        kept[travels] = lead
        return kept

    def find_paths(self, places: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return some places (n,) and all on the shortest ways to them from the latest visit."""
        length = np.hypot(self.measured[:, 0], self.measured[:, 1]) * self.travelled + _TIE_M
        m = len(self.poses)
        ways = sp.csr_matrix((length, (self.ends[:, 0], self.ends[:, 1])), shape=(m, m))
        before = csgraph.dijkstra(
            ways, directed=False, indices=self.last, return_predecessors=True
        )[1]
        found = places.copy()
        ahead = self.first[np.flatnonzero(places)]
        reached = np.zeros(m, bool)
        while len(ahead):
            reached[ahead] = True
            ahead = before[ahead]
            ahead = np.unique(ahead[ahead >= 0])
            ahead = ahead[~reached[ahead]]
        found[self.place[reached]] = True
        found[self.place[self.last]] = True
        return found

    def cut(self, places: NDArray[np.bool_]) -> tuple[WalkGraph, Index]:
        """Return the graph of some places (n,) alone, and the nodes that it has of this one.

        The latest visit must be at one of them. What is measured elsewhere is left out, which
        can only widen what is known.
        """
        kept = places[self.place[self.ends]].all(axis=1)
        inside = np.zeros(len(self.poses), bool)
        inside[self.first[places]] = inside[self.last] = True
        inside[self.ends[kept & self.travelled].ravel()] = True
        kept &= inside[self.ends].all(axis=1)
        number, name = np.cumsum(inside) - 1, np.cumsum(places) - 1
        part = WalkGraph(
            self.poses[inside],
            name[self.place[inside]],
            number[self.first[places]],
            number[self.ends[kept]],
            self.measured[kept],
            self.weights[kept],
            self.travelled[kept],
            int(number[self.last]),
        )
        return part, np.flatnonzero(inside)

    def place_nodes(self, poses: Array) -> WalkGraph:
        """Return the graph with its nodes at other poses (m, 3)."""
        return replace(self, poses=np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])]))


def _invert_noise(x: float, y: float, turn: float, around_rad: float) -> Array:
    """Return the information matrix of a tie, in the frame of its place."""
    c, s = np.cos(around_rad), np.sin(around_rad)
    rotate = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return np.asarray(rotate @ np.diag([1 / x, 1 / y, 1 / min(turn, _ANY_RAD2)]) @ rotate.T)
