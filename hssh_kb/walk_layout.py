"""The layout of a walk graph by sparse Cholesky factorisation, and what it leaves open.

Source: Beeson 2008, section 9.3.2 (G(chi)); the marginal told by the last block of the factor and
the samples drawn through it are ours.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotri

from hssh_kb.errors import InternalError
from hssh_kb.walk_graph import Array, Index, WalkGraph
from perception.geometry import wrap_angle

_SAMPLES = 8
_STEPS = 4
_SPLU: dict[str, Any] = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
_NOWHERE = 1e-18
_VAGUE = 1e-9  # information (1/m2, 1/rad2) below which a pivot is but rounding


class Window(NamedTuple):
    """A layout, seen from its latest visit.

    Attributes
    ----------
    graph : the graph, poses at the optimum.
    cov : (3w + 3, 3w + 3) joint covariance of the latest visit (zero) and the places.
    samples : (n, 3, s) errors of the poses of all places as they may be, seen from the latest
        visit, on the axes of the graph; none (n, 3, 0) if not asked for.
    """

    graph: WalkGraph
    cov: Array
    samples: Array


def lay_out(graph: WalkGraph, places: Index, length_m: float, *, sampled: bool) -> Window:
    """Lay a graph out, its latest visit held fast, and return what is known of some places.

    Parameters
    ----------
    graph : connected.
    places : (w,) numbers of the places wanted.
    length_m : typical length of a travel.
    sampled : tell also how far off each place may be.
    """
    inner = np.zeros(len(graph.poses), bool)
    inner[graph.first[places]] = True
    inner[graph.last] = False
    system = _System(graph, inner)
    poses = graph.poses
    for _ in range(_STEPS):
        factor, gradient, jacobians = system.factorise(poses)
        change = system.spread(factor.solve(gradient))
        poses = poses - change
        size = np.abs(change)
        if size[:, 2].max() < 0.05 and size[:, :2].max() < 0.25 * length_m:
            break
    cov = system.take_covariance(factor, np.r_[graph.last, graph.first[places]])
    samples = np.zeros((len(graph.first), 3, 0))
    if sampled:
        samples = system.sample_errors(factor, jacobians)[graph.first]
    return Window(graph.place_nodes(poses), cov, samples)


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
        pivots = np.maximum(factor.U.diagonal()[-size:], _VAGUE)
        root = factor.L[:, -size:][-size:].toarray() * np.sqrt(pivots)
        lower, failed = dpotri(root, lower=1)
        if failed:
            raise InternalError("the layout of the walk has no covariance")
        inverse = np.tril(lower) + np.tril(lower, -1).T
        at = self.slot[nodes] - (len(self.order) - self.inner)
        at = np.where(self.slot[nodes] < 0, self.inner, at)
        padded = np.zeros((size + 3, size + 3))
        padded[:size, :size] = inverse
        flat = (3 * at[:, None] + np.arange(3)).ravel()
        return np.asarray(padded[np.ix_(flat, flat)])

    def sample_errors(self, factor: Any, jacobians: Array) -> Array:  # noqa: ANN401
        """Return samples (m, 3, s) of the errors of the layout."""
        g = self.graph
        draws = np.random.default_rng(0).standard_normal((len(g.ends), 3, _SAMPLES))
        roots = np.linalg.cholesky(g.weights + _NOWHERE * np.eye(3))
        samples = factor.solve(self.gather(jacobians @ (roots @ draws)))
        out = np.zeros((len(g.poses), 3, _SAMPLES))
        out[self.order] = samples.reshape(-1, 3, _SAMPLES)
        return out


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
