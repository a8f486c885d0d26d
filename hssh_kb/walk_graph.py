"""The walk behind one map as a pose graph: what is known of places far from the robot.

Nodes are visits, edges are travels and closures. The graph is laid out afresh, by sparse
Cholesky factorisation, whenever the dense estimate of :mod:`hssh_kb.place_filter` moves on to
another part of town; it then tells that part's joint covariance. Graphs are never changed,
so all maps that grow from one share it.

To keep the cost of an arrival flat however long the robot walks, a travel between two places
that others have measured often enough is forgotten once it is far behind. Leaving out a
measurement can only widen the covariances (Rayleigh's monotonicity), so it errs on the safe side.

Source: Beeson 2008, section 9.3.2 (G(chi)); conditional windows and forgetting are ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from perception.geometry import wrap_angle

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_MOST_TRAVELS = 2  # measurements of one corridor that are enough
_LEAD = 4  # travels kept before one that is needed: they say where it heads
_RECENT = 64  # travels never forgotten
_TIE_M = 1e-5  # visits to one place lie at least this far apart, in lengths of a travel
_SAMPLES = 8
_STEPS = 4
_SPLU: dict[str, Any] = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
_NOWHERE = 1e-18


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

    def lay_out(self, places: Index, length_m: float) -> Window:
        """Lay the graph out, its latest visit held fast, and return what is known of some places.

        Parameters
        ----------
        places : (w,) numbers of the places wanted.
        length_m : typical length of a travel.
        """
        inner = np.zeros(len(self.poses), bool)
        inner[self.first[places]] = True
        inner[self.last] = False
        system = _System(self, inner)
        poses = self.poses
        for _ in range(_STEPS):
            factor, gradient, jacobians = system.factorise(poses)
            change = system.spread(factor.solve(gradient))
            poses = poses - change
            size = np.abs(change)
            if size[:, 2].max() < 0.05 and size[:, :2].max() < 0.25 * length_m:
                break
        graph = WalkGraph(
            np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])]),
            self.place,
            self.first,
            self.ends,
            self.measured,
            self.weights,
            self.travelled,
            self.last,
        )
        return Window(
            graph,
            system.take_covariance(factor, np.r_[self.last, self.first[places]]),
            system.sample_deviations(factor, jacobians)[self.first],
        )


class Window(NamedTuple):
    """A layout, seen from its latest visit.

    Attributes
    ----------
    graph : the graph, poses at the optimum.
    cov : (3w + 3, 3w + 3) joint covariance of the latest visit (zero) and the places.
    deviations : (n, 2) standard deviation of the position [m] and heading [rad] of each place
        against the latest visit, roughly, on the safe side.
    """

    graph: WalkGraph
    cov: Array
    deviations: Array


class _System:
    """The normal equations of a graph, the nodes of the window last."""

    def __init__(self, graph: WalkGraph, inner: NDArray[np.bool_]) -> None:
        self.graph = graph
        m = len(graph.poses)
        order = _order_nodes(m, graph.ends, graph.last)
        order = np.r_[order[~inner[order]], order[inner[order]]]
        self.order, self.inner = order, int(inner.sum())
        self.slot = np.full(m, -1, np.intp)
        self.slot[order] = np.arange(m - 1)
        a, b = self.slot[graph.ends[:, 0]], self.slot[graph.ends[:, 1]]
        rows, cols = np.r_[a, b, a, b], np.r_[a, b, b, a]
        self.keep = (rows >= 0) & (cols >= 0)
        three = np.arange(3)
        shape = (int(self.keep.sum()), 3, 3)
        self.rows = np.broadcast_to(3 * rows[self.keep, None, None] + three[:, None], shape)
        self.cols = np.broadcast_to(3 * cols[self.keep, None, None] + three, shape)

    def factorise(self, poses: Array) -> tuple[Any, Array, Array]:
        """Return the factor of the normal equations, the gradient, and the Jacobians (2, k, 3, 3).

        The Jacobians are transposed.
        """
        g, size = self.graph, 3 * len(self.order)
        residual, by_i, by_j = _linearise(g, poses)
        wi, wj = g.weights @ by_i, g.weights @ by_j
        ti, tj = by_i.transpose(0, 2, 1), by_j.transpose(0, 2, 1)
        cross = ti @ wj
        blocks = np.concatenate([ti @ wi, tj @ wj, cross, cross.transpose(0, 2, 1)])[self.keep]
        matrix = sp.coo_matrix(
            (blocks.ravel(), (self.rows.ravel(), self.cols.ravel())), shape=(size, size)
        ).tocsc()
        factor = spla.splu(matrix, permc_spec="NATURAL", relax=1, panel_size=1, **_SPLU)
        jacobians = np.stack([ti, tj])
        return factor, self.gather(jacobians @ (g.weights @ residual[:, :, None]))[:, 0], jacobians

    def gather(self, values: Array) -> Array:
        """Sum values (2, k, 3, r) of the ends of all edges by unknown: (unknowns, r)."""
        m = len(self.graph.poses)
        total = np.zeros((m, 3, values.shape[-1]))
        for end in (0, 1):
            np.add.at(total, self.graph.ends[:, end], values[end])
        return np.asarray(total[self.order].reshape(3 * len(self.order), -1))

    def spread(self, solution: Array) -> Array:
        """Return a solution by node (m, 3), zero for the one held fast."""
        out = np.zeros((len(self.graph.poses), 3))
        out[self.order] = solution.reshape(-1, 3)
        return out

    def take_covariance(self, factor: Any, nodes: Index) -> Array:  # noqa: ANN401
        """Return the joint covariance of nodes of the window: the end of the factor inverted."""
        size = 3 * self.inner
        low = factor.L[:, -size:][-size:].toarray()
        up = factor.U[:, -size:][-size:].toarray()
        inverse = np.linalg.inv(low @ up)
        inverse = (inverse + inverse.T) / 2
        at = self.slot[nodes] - (len(self.order) - self.inner)
        at = np.where(self.slot[nodes] < 0, self.inner, at)
        padded = np.zeros((size + 3, size + 3))
        padded[:size, :size] = inverse
        flat = (3 * at[:, None] + np.arange(3)).ravel()
        return np.asarray(padded[np.ix_(flat, flat)])

    def sample_deviations(self, factor: Any, jacobians: Array) -> Array:  # noqa: ANN401
        """Return deviations (m, 2) from samples of the layout, widened for their small number."""
        g = self.graph
        draws = np.random.default_rng(0).standard_normal((len(g.ends), 3, _SAMPLES))
        roots = np.linalg.cholesky(g.weights + _NOWHERE * np.eye(3))
        samples = factor.solve(self.gather(jacobians @ (roots @ draws)))
        out = np.zeros((len(g.poses), 3))
        out[self.order] = np.mean(samples**2, axis=1).reshape(-1, 3)
        return 1.5 * np.sqrt(np.column_stack([out[:, 0] + out[:, 1], out[:, 2]]))


def _linearise(g: WalkGraph, x: Array) -> tuple[Array, Array, Array]:
    """Return residuals (k, 3) and Jacobians (k, 3, 3) with respect to both ends."""
    at, to = x[g.ends[:, 0]], x[g.ends[:, 1]]
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    dx, dy = to[:, 0] - at[:, 0], to[:, 1] - at[:, 1]
    u, v = c * dx + s * dy, -s * dx + c * dy
    turn = wrap_angle(to[:, 2] - at[:, 2] - g.measured[:, 2])
    residual = np.column_stack([u - g.measured[:, 0], v - g.measured[:, 1], turn])
    by_j = np.zeros((len(g.ends), 3, 3))
    by_j[:, 0, 0] = by_j[:, 1, 1] = c
    by_j[:, 0, 1], by_j[:, 1, 0], by_j[:, 2, 2] = s, -s, 1
    by_i = -by_j
    by_i[:, 0, 2], by_i[:, 1, 2] = v, -u
    return residual, by_i, by_j


def _invert_noise(x: float, y: float, turn: float, around_rad: float) -> Array:
    """Return the information matrix of a tie, in the frame of its place."""
    c, s = np.cos(around_rad), np.sin(around_rad)
    rotate = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return np.asarray(rotate @ np.diag([1 / x, 1 / y, 1 / turn]) @ rotate.T)


def _order_nodes(m: int, ends: Index, fixed: int) -> Index:
    """Return the nodes but the fixed one in the order to eliminate them: minimum degree."""
    others = np.flatnonzero(np.arange(m) != fixed)
    rows, cols = np.r_[ends[:, 0], ends[:, 1]], np.r_[ends[:, 1], ends[:, 0]]
    graph = sp.coo_matrix((np.full(len(rows), -1.0), (rows, cols)), shape=(m, m)).tocsc()
    graph = graph[others][:, others] + sp.identity(m - 1) * (4.0 * m)
    factor = spla.splu(sp.csc_matrix(graph), permc_spec="MMD_AT_PLUS_A", **_SPLU)
    out = np.empty(m - 1, np.intp)
    out[factor.perm_c] = others
    return out
