"""The metrical layout chi: the poses of the places that best fit the displacements between them.

Weighted nonlinear least squares over SE(2) edges: a chordal start (one complex solve for the
headings, one real solve for the positions), then Gauss-Newton. Dense below about forty places,
sparse above.

Source: Beeson 2008, section 9.3.2 (G(chi)); start and solver: ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.csgraph as spgraph
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from hssh_kb.errors import InputError, NoAnswerError
from hssh_kb.experience import Displacement, Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.score import Score, estimate_score
from perception.geometry import compose, compose_covariance, invert, wrap_angle

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


@dataclass(frozen=True)
class Layout:
    """A layout chi with its fit.

    Attributes
    ----------
    poses : (n, 3) x [m], y [m], theta [rad] of each node in the frame of node 0.
    chi2 : weighted sum of squared residuals at the optimum.
    iterations : Gauss-Newton steps taken.
    normal : (3n - 3, 3n - 3) matrix of the normal equations at the optimum, dense or sparse.
    position : place of each of the nodes 1..n-1 in it; None if in order.
    """

    poses: Array
    chi2: float
    iterations: int
    normal: Any
    position: Index | None = None

    @cached_property
    def information(self) -> Any:  # noqa: ANN401
        """Information matrix (3n - 3, 3n - 3) of nodes 1..n-1, in their order."""
        if self.position is None or not sp.issparse(self.normal):
            return self.normal
        index = (3 * self.position[:, None] + np.arange(3)).ravel()
        return sp.csc_matrix(self.normal)[index][:, index]

    @cached_property
    def covariances(self) -> Array:
        """Marginal covariance (n, 3, 3) of each pose; zero for node 0."""
        n = len(self.poses)
        out = np.zeros((n, 3, 3))
        if n == 1:
            return out
        if sp.issparse(self.information):
            solve = spla.splu(sp.csc_matrix(self.information)).solve
            for node in range(1, n):
                rhs = np.zeros((3 * n - 3, 3))
                rhs[3 * node - 3 : 3 * node] = np.eye(3)
                out[node] = solve(rhs)[3 * node - 3 : 3 * node]
        else:
            full = la.inv(self.information)
            for node in range(1, n):
                out[node] = full[3 * node - 3 : 3 * node, 3 * node - 3 : 3 * node]
        return (out + np.swapaxes(out, 1, 2)) / 2


def lay_out(
    n: int,
    edges_i: Any,  # noqa: ANN401
    edges_j: Any,  # noqa: ANN401
    z: Any,  # noqa: ANN401
    information: Any,  # noqa: ANN401
    *,
    max_iterations: int = 50,
    tolerance: float = 1e-7,
) -> Layout:
    """Lay out n nodes so that the weighted squared residuals of the edges are smallest.

    Parameters
    ----------
    n : number of nodes; node 0 stays at the origin (gauge).
    edges_i, edges_j : (m,) node indices; edge e measures node j in the frame of node i.
    z : (m, 3) measured poses, metres and radians.
    information : (m, 3, 3) inverse covariances of the measurements, of (x, y, theta) in the frame
        of node i. (The g2o format gives them in the frame of the measured node: rotate first.)
    max_iterations : of Gauss-Newton.
    tolerance : relative decrease of chi2 at which to stop.

    Returns
    -------
    Layout

    Raises
    ------
    InputError : an index out of range, a wrong shape, a value that is not finite, or an
        information matrix that is not positive semidefinite.
    NoAnswerError : the edges do not hold all nodes to node 0.

    Source
    ------
    Beeson 2008, section 9.3.2; chordal start and solver ours.

    Examples
    --------
    >>> square = [[1, 0, np.pi / 2]] * 4
    >>> layout = lay_out(4, [0, 1, 2, 3], [1, 2, 3, 0], square, [np.eye(3)] * 4)
    >>> layout.poses[2, :2].round(6).tolist(), round(layout.chi2, 6)
    ([1.0, 1.0], 0.0)
    """
    i, j, z, w = _check_edges(n, edges_i, edges_j, z, information)
    if n == 1:
        return Layout(np.zeros((1, 3)), 0.0, 0, np.zeros((0, 0)))
    _check_connected(n, i, j)
    with np.errstate(all="ignore"):
        problem = _Problem(n, i, j, z, w)
        start = _start_chordal(problem)
        return _run_gauss_newton(problem, start, max_iterations, tolerance)


def lay_out_hypothesis(
    experience: Experience, hypothesis: Hypothesis, *, score: Score | None = None
) -> Layout:
    """Lay out the places of a hypothesis: chi.

    Each travel is an edge between the places at its two ends. The frame of a visit is turned into
    the frame of its place by the headings of the matched dlps; without headings the two frames
    are one (``frames="shared"``), or each visit after the first gets its own heading
    (``frames="free"``). A travel without displacement holds its ends together only weakly.

    Parameters
    ----------
    experience, hypothesis : the hypothesis may explain only the first visits.
    score : its ``frames`` and noise scales are used; estimated if not given.

    Returns
    -------
    Layout : poses of the places in the order of ``hypothesis.places``, metres and radians, in the
        frame of the first visit.

    Source
    ------
    Beeson 2008, sections 9.3.1 and 9.3.2.
    """
    score = score or estimate_score(experience)
    count = len(hypothesis.visits)
    turns = [_turn_of_visit(experience, hypothesis, v, score) for v in range(count)]
    # A visit whose turn is unknown is a node of its own, tied to its place by position.
    node, nodes = {}, len(hypothesis.places)
    number = {first: i for i, first in enumerate(hypothesis.places)}
    for v in range(count):
        if np.isinf(turns[v][1]):
            node[v], nodes = nodes, nodes + 1
        else:
            node[v] = number[hypothesis.visits[v]]
    i, j, z, cov = list[int](), list[int](), list[Array](), list[Array]()
    for v in range(1, count):
        displacement = experience.visits[v].displacement or _guess_displacement(score)
        measured, spread = _turn_edge(displacement, turns[v - 1], turns[v], score)
        i.append(node[v - 1])
        j.append(node[v])
        z.append(measured)
        cov.append(spread)
    information = list(np.linalg.inv(np.array(cov))) if cov else []
    tie = 1 / max(score.spread_m, 1e-3 * score.length_m) ** 2
    for v in range(count):
        if np.isinf(turns[v][1]):
            i.append(number[hypothesis.visits[v]])
            j.append(node[v])
            z.append(np.zeros(3))
            information.append(np.diag([tie, tie, 0.0]))
    laid = lay_out(nodes, i, j, z, information)
    return _keep_nodes(laid, len(hypothesis.places))


def _turn_of_visit(
    experience: Experience, hypothesis: Hypothesis, v: int, score: Score
) -> tuple[float, float]:
    """Return the turn [rad] of the frame of a visit in that of its place, and its variance."""
    first = hypothesis.visits[v]
    if first == v:
        return 0.0, 0.0
    mine, theirs = hypothesis.reading(experience, v), hypothesis.reading(experience, first)
    turn, var, _ = score.match_headings(
        theirs.headings, mine.headings, hypothesis.offsets[v], mine.star.alpha
    )
    return turn, var


def _guess_displacement(score: Score) -> Displacement:
    far = (10 * score.length_m) ** 2
    return Displacement(0.0, 0.0, 0.0, ((far, 0.0, 0.0), (0.0, far, 0.0), (0.0, 0.0, 10.0)))


def _turn_edge(
    displacement: Displacement,
    start: tuple[float, float],
    end: tuple[float, float],
    score: Score,
) -> tuple[Array, Array]:
    """Carry a displacement between visits over to the frames of their places."""
    z = np.array([displacement.x, displacement.y, displacement.theta])
    cov = np.array(displacement.cov)
    for turn, var, before in ((*start, True), (*end, False)):
        if var == 0.0 or np.isinf(var):
            continue
        rotation = np.array([0.0, 0.0, turn])
        spread = np.diag([score.spread_m**2, score.spread_m**2, var])
        if before:
            cov = compose_covariance(rotation, spread, z, cov)
            z = compose(rotation, z)
        else:
            back = invert(rotation)
            cov = compose_covariance(z, cov, back, spread)
            z = compose(z, back)
    return z, cov + 1e-12 * np.eye(3)


def _keep_nodes(layout: Layout, n: int) -> Layout:
    """Return the layout of the first n nodes, the others summed out."""
    if len(layout.poses) == n:
        return layout
    information = layout.information
    full = information.toarray() if sp.issparse(information) else np.asarray(information)
    cut = 3 * (n - 1)
    rest = full[cut:, cut:]
    kept = full[:cut, :cut] - full[:cut, cut:] @ la.solve(rest, full[cut:, :cut], assume_a="pos")
    return Layout(layout.poses[:n], layout.chi2, layout.iterations, kept)


def _check_edges(
    n: int,
    edges_i: Any,  # noqa: ANN401
    edges_j: Any,  # noqa: ANN401
    z: Any,  # noqa: ANN401
    information: Any,  # noqa: ANN401
) -> tuple[Index, Index, Array, Array]:
    i = np.asarray(edges_i, dtype=np.intp).reshape(-1)
    j = np.asarray(edges_j, dtype=np.intp).reshape(-1)
    z = np.asarray(z, dtype=float).reshape(-1, 3) if np.size(z) else np.zeros((0, 3))
    w = np.asarray(information, dtype=float)
    w = w.reshape(-1, 3, 3) if w.size else np.zeros((0, 3, 3))
    if n < 1:
        raise InputError(f"layout: needs at least one node, got {n}")
    if not len(i) == len(j) == len(z) == len(w):
        raise InputError(
            f"layout: {len(i)} and {len(j)} edge ends, {len(z)} measurements, {len(w)} "
            "information matrices; give one of each an edge"
        )
    if len(i) and (min(i.min(), j.min()) < 0 or max(i.max(), j.max()) >= n):
        raise InputError(f"layout: an edge names a node outside 0..{n - 1}")
    bad = np.flatnonzero(~(np.isfinite(z).all(1) & np.isfinite(w).all((1, 2))))
    if len(bad):
        raise InputError(f"layout: edge {bad[0]} holds a value that is not finite")
    if len(w):
        bad = np.flatnonzero(~_are_semidefinite(w))
        if len(bad):
            raise InputError(
                f"layout: the information matrix of edge {bad[0]} is not positive semidefinite"
            )
    return i, j, z, w


def _are_semidefinite(w: Array) -> NDArray[np.bool_]:
    """Tell of each 3 x 3 matrix whether all its principal minors are at least zero."""
    a, b, c = w[:, 0, 0], w[:, 1, 1], w[:, 2, 2]
    d, e, f = w[:, 0, 1], w[:, 0, 2], w[:, 1, 2]
    scale = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(c)) + 1e-300
    ones = np.minimum(np.minimum(a, b), c) / scale
    twos = np.minimum(np.minimum(a * b - d * d, a * c - e * e), b * c - f * f) / scale**2
    three = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    return (ones >= -1e-9) & (twos >= -1e-9) & (three / scale**3 >= -1e-9)


def _check_connected(n: int, i: Index, j: Index) -> None:
    graph = sp.coo_matrix((np.ones(len(i)), (i, j)), shape=(n, n))
    count, labels = spgraph.connected_components(graph, directed=False)
    if count > 1:
        node = int(np.flatnonzero(labels != labels[0])[0])
        raise NoAnswerError(f"layout: no chain of edges joins node {node} to node 0")


class _Problem:
    """The edges, and where their 3 x 3 blocks go in the normal equations."""

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


def _start_chordal(problem: _Problem) -> Array:
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
    p: _Problem,
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


def _linearise(p: _Problem, x: Array) -> tuple[Array, Array, Array]:
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


def _run_gauss_newton(p: _Problem, start: Array, max_iterations: int, tolerance: float) -> Layout:
    """Full steps first, which may pass through worse layouts; damped steps if those fail."""
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
    return Layout(x, chi2, steps, matrix, p.position)


def _iterate(
    p: _Problem, start: Array, max_iterations: int, tolerance: float, *, damped: bool
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


def _build_normal(p: _Problem, x: Array) -> tuple[Any, Array, float]:
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


def _damp(p: _Problem, matrix: Any, damping: float) -> Any:  # noqa: ANN401
    if damping == 0:
        return matrix
    if p.dense:
        return matrix + damping * np.diag(np.diag(matrix))
    return sp.csc_matrix(matrix + damping * sp.diags(matrix.diagonal()))


def _step(p: _Problem, x: Array, matrix: Any, gradient: Array) -> Array:  # noqa: ANN401
    rhs = np.empty((p.n - 1, 3))
    rhs[p.position] = gradient[1:]
    x = x.copy()
    x[1:] -= p.solve(matrix, rhs.ravel()).reshape(-1, 3)[p.position]
    x[:, 2] = wrap_angle(x[:, 2])
    return x
