"""Weighted nonlinear least squares over SE(2) edges: start, normal equations, Gauss-Newton.

A chordal start (one complex solve for the headings, one real solve for the positions), then
Gauss-Newton. Dense below about forty nodes, sparse above.

Source: ours.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from hssh_kb.errors import NoAnswerError
from perception.geometry import wrap_angle

Array = NDArray[np.float64]
Index = NDArray[np.intp]

DENSE_LIMIT = 40
_SPLU: dict[str, Any] = {
    "permc_spec": "NATURAL",
    "diag_pivot_thresh": 0.0,
    "relax": 1,
    "panel_size": 1,
    "options": {"SymmetricMode": True},
}


class EdgeProblem:
    """The edges, and where their 3 x 3 blocks go in the normal equations.

    Parameters
    ----------
    n : number of nodes; node 0 stays at the origin.
    i, j : (m,) node indices; edge e measures node j in the frame of node i.
    z : (m, 3) measured poses, metres and radians.
    w : (m, 3, 3) inverse covariances of the measurements.

    Attributes
    ----------
    position : elimination position of each of the nodes 1..n-1.

    Source
    ------
    Ours.
    """

    def __init__(self, n: int, i: Index, j: Index, z: Array, w: Array) -> None:
        self.n, self.i, self.j, self.z = n, i, j, z
        self.weights = w
        self.dense = n <= DENSE_LIMIT
        # Unknowns are numbered by elimination position; node 0 comes last and is dropped.
        self.position = np.arange(n - 1) if self.dense else _order_nodes(n, i, j)
        self.slot = np.r_[n - 1, self.position]
        rows, cols = self.slot[i], self.slot[j]
        r, c = np.r_[rows, cols, rows, cols], np.r_[rows, cols, cols, rows]
        self.keep = (r < n - 1) & (c < n - 1)
        r, c = r[self.keep], c[self.keep]
        three = np.arange(3)
        big_r = (3 * r[:, None, None] + three[None, :, None] + 0 * three).ravel()
        big_c = (3 * c[:, None, None] + 0 * three[:, None] + three[None, None]).ravel()
        size = 3 * (n - 1)
        flat = big_c.astype(np.int64) * size + big_r
        if self.dense:
            self.scatter, self.entries = flat, size * size
        else:
            unique, self.scatter = np.unique(flat, return_inverse=True)
            self.entries = len(unique)
            heads = np.r_[0, np.cumsum(np.bincount(unique // size, minlength=size))]
            self.pattern = (unique % size).astype(np.int32), heads.astype(np.int32)

    def build(self, values: Array) -> Any:  # noqa: ANN401
        """Return the matrix of the normal equations from the blocks ii, jj, ij, ji of all edges."""
        data = np.bincount(self.scatter, values[self.keep].ravel(), self.entries)
        size = 3 * (self.n - 1)
        if self.dense:
            return data.reshape(size, size).T
        return sp.csc_matrix((data, *self.pattern), shape=(size, size))

    def solve(self, matrix: Any, rhs: Array) -> Array:  # noqa: ANN401
        """Solve the normal equations."""
        try:
            if self.dense:
                return np.asarray(
                    la.cho_solve(la.cho_factor(matrix, check_finite=False), rhs, check_finite=False)
                )
            return np.asarray(spla.splu(matrix, **_SPLU).solve(rhs))
        except (la.LinAlgError, RuntimeError):
            raise NoAnswerError(
                "layout: the edges leave some node free to move (singular normal equations)"
            ) from None


def _order_nodes(n: int, i: Index, j: Index) -> Index:
    """Return the elimination position of nodes 1..n-1 (minimum degree on the node graph)."""
    ends = np.r_[i, j], np.r_[j, i]
    graph = sp.coo_matrix((np.ones(2 * len(i)), ends), shape=(n, n)).tocsc()[1:, 1:]
    graph.data[:] = -1.0
    graph = sp.csc_matrix(graph + sp.identity(n - 1) * (n + 1.0))
    factor = spla.splu(
        graph,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.asarray(factor.perm_c, dtype=np.intp)


def start_chordal(problem: EdgeProblem) -> Array:
    """Return the start: headings from one complex solve, then positions from one real solve.

    Source
    ------
    Ours (chordal relaxation; no unwrapping of angles is needed).
    """
    p, n = problem, problem.n
    a, b = p.slot[p.i], p.slot[p.j]
    theta_weight = np.maximum(p.weights[:, 2, 2], 1e-12)
    turn = np.exp(1j * p.z[:, 2])
    heading = _solve_laplacian(p, a, b, theta_weight, theta_weight * turn, None)
    theta = np.angle(heading)[p.slot]
    weight = np.maximum((p.weights[:, 0, 0] + p.weights[:, 1, 1]) / 2, 1e-12)
    step = weight * np.exp(1j * theta[p.i]) * (p.z[:, 0] + 1j * p.z[:, 1])
    rhs = np.zeros(n, complex)
    rhs.real = np.bincount(b, step.real, n) - np.bincount(a, step.real, n)
    rhs.imag = np.bincount(b, step.imag, n) - np.bincount(a, step.imag, n)
    spot = _solve_laplacian(p, a, b, weight, weight + 0j, rhs)[p.slot]
    return np.column_stack([spot.real, spot.imag, theta])


def _solve_laplacian(
    p: EdgeProblem,
    a: Index,
    b: Index,
    weight: Array,
    off: NDArray[np.complex128],
    rhs: NDArray[np.complex128] | None,
) -> NDArray[np.complex128]:
    """Solve a (connection) Laplacian with the last unknown held at 1 (no rhs) or at 0."""
    n = p.n
    rows, cols = np.r_[a, b, a, b], np.r_[a, b, b, a]
    values = np.r_[weight, weight, -np.conj(off), -off]
    out = np.ones(n, complex) if rhs is None else np.zeros(n, complex)
    if p.dense:
        matrix = np.zeros((n, n), complex)
        np.add.at(matrix, (rows, cols), values)
        known = -matrix[:-1, -1] if rhs is None else rhs[:-1]
        out[:-1] = np.linalg.solve(matrix[:-1, :-1], known)
    else:
        sparse = sp.csc_matrix((values, (rows, cols)), shape=(n, n))
        known = -sparse[:-1, -1].toarray().ravel() if rhs is None else rhs[:-1]
        out[:-1] = spla.splu(sparse[:-1, :-1].tocsc(), **_SPLU).solve(known)
    return out


def _linearise(p: EdgeProblem, x: Array) -> tuple[Array, Array, Array]:
    """Return residuals (m, 3) and Jacobians (m, 3, 3) with respect to nodes i and j."""
    at, to = x[p.i], x[p.j]
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    dx, dy = to[:, 0] - at[:, 0], to[:, 1] - at[:, 1]
    u, v = c * dx + s * dy, -s * dx + c * dy
    residual = np.stack(
        [u - p.z[:, 0], v - p.z[:, 1], wrap_angle(to[:, 2] - at[:, 2] - p.z[:, 2])], axis=1
    )
    by_j = np.zeros((len(p.i), 3, 3))
    by_j[:, 0, 0] = by_j[:, 1, 1] = c
    by_j[:, 0, 1], by_j[:, 1, 0], by_j[:, 2, 2] = s, -s, 1
    by_i = -by_j
    by_i[:, 0, 2], by_i[:, 1, 2] = v, -u
    return residual, by_i, by_j


def run_gauss_newton(
    p: EdgeProblem, start: Array, max_iterations: int, tolerance: float
) -> tuple[Array, float, int, Any]:
    """Iterate to the optimum: full steps, which may pass through worse layouts; else damped ones.

    Parameters
    ----------
    p : the edges.
    start : (n, 3) poses to start from.
    max_iterations : steps at most.
    tolerance : relative decrease of chi2 at which to stop.

    Returns
    -------
    poses (n, 3), chi2, steps taken, matrix of the normal equations there.

    Raises
    ------
    NoAnswerError : the edges leave some node free to move.

    Source
    ------
    Ours.
    """
    try:
        full = _iterate(p, start, max_iterations, tolerance, damped=False)
    except NoAnswerError:
        full = None
    if full is not None and full[3]:
        x, chi2, steps, _, matrix = full
    else:
        x, chi2, steps, _, matrix = _iterate(p, start, max_iterations, tolerance, damped=True)
        if full is not None and full[1] < chi2:
            x, chi2, steps, _, matrix = full
    return x, chi2, steps, matrix


def _iterate(
    p: EdgeProblem, start: Array, max_iterations: int, tolerance: float, *, damped: bool
) -> tuple[Array, float, int, bool, Any]:
    """Return poses, chi2, steps, whether converged, and the normal matrix there."""
    x, last, damping, steps = start.copy(), np.inf, 1e-4 if damped else 0.0, 0
    kept: tuple[Array, float, Any, Array] | None = None
    while True:
        matrix, gradient, chi2 = _build_normal(p, x)
        worse = kept is not None and not chi2 <= last
        if damped and worse and kept is not None:
            damping = min(damping * 10, 1e8)
            x, chi2, matrix, gradient = kept
        else:
            damping = max(damping / 10, 1e-9) if damped else 0.0
            settled = abs(last - chi2) <= tolerance * chi2 + 1e-12
            kept, last = (x, chi2, matrix, gradient), chi2
            if settled or not np.isfinite(chi2):
                break
        if steps == max_iterations:
            return x, chi2 if np.isfinite(chi2) else np.inf, steps, False, matrix
        steps += 1
        x = _step(p, x, _damp(p, matrix, damping), gradient)
    return x, chi2 if np.isfinite(chi2) else np.inf, steps, bool(np.isfinite(chi2)), matrix


def _build_normal(p: EdgeProblem, x: Array) -> tuple[Any, Array, float]:
    """Return the normal matrix, the gradient (n, 3) and chi2 at x."""
    residual, by_i, by_j = _linearise(p, x)
    wi, wj = p.weights @ by_i, p.weights @ by_j
    wr = (p.weights @ residual[:, :, None])[:, :, 0]
    ti, tj = np.swapaxes(by_i, 1, 2), np.swapaxes(by_j, 1, 2)
    cross = ti @ wj
    matrix = p.build(np.concatenate([ti @ wi, tj @ wj, cross, np.swapaxes(cross, 1, 2)]))
    gi, gj = (ti @ wr[:, :, None])[:, :, 0], (tj @ wr[:, :, None])[:, :, 0]
    gradient = np.stack(
        [np.bincount(p.i, gi[:, k], p.n) + np.bincount(p.j, gj[:, k], p.n) for k in range(3)],
        axis=1,
    )
    return matrix, gradient, float((wr * residual).sum())


def _damp(p: EdgeProblem, matrix: Any, damping: float) -> Any:  # noqa: ANN401
    if damping == 0:
        return matrix
    if p.dense:
        return matrix + damping * np.diag(np.diag(matrix))
    return sp.csc_matrix(matrix + damping * sp.diags(matrix.diagonal()))


def _step(p: EdgeProblem, x: Array, matrix: Any, gradient: Array) -> Array:  # noqa: ANN401
    rhs = np.empty((p.n - 1, 3))
    rhs[p.position] = gradient[1:]
    x = x.copy()
    x[1:] -= p.solve(matrix, rhs.ravel()).reshape(-1, 3)[p.position]
    x[:, 2] = wrap_angle(x[:, 2])
    return x
