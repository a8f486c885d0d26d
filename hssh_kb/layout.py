"""The metrical layout chi: the poses of the places that best fit the displacements between them.

Source: Beeson 2008, section 9.3.2 (G(chi)); start and solver are ours
(:mod:`hssh_kb.least_squares`).
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
from hssh_kb.least_squares import Array, EdgeProblem, Index, run_gauss_newton, start_chordal
from hssh_kb.score import Score, estimate_score
from perception.geometry import compose, compose_covariance, invert


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
    information : (m, 3, 3) inverse covariances of (x, y, theta) in the frame of node i (the g2o
        format gives them in that of node j: rotate first).
    max_iterations, tolerance : Gauss-Newton steps; relative decrease of chi2 at which to stop.

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
    problem = EdgeProblem(n, i, j, z, w)
    with np.errstate(all="ignore"):
        fit = run_gauss_newton(problem, start_chordal(problem), max_iterations, tolerance)
        return Layout(*fit, problem.position)


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
    edges = _list_edges(experience, score, turns, node)
    tie = 1 / max(score.spread_m, 1e-3 * score.length_m) ** 2
    for v in range(count):
        if np.isinf(turns[v][1]):
            place = number[hypothesis.visits[v]]
            edges.append((place, node[v], np.zeros(3), np.diag([tie, tie, 0.0])))
    i, j, z, information = zip(*edges, strict=True) if edges else ((), (), (), ())
    laid = lay_out(nodes, i, j, z, information)
    return _keep_nodes(laid, len(hypothesis.places))


def _list_edges(
    experience: Experience, score: Score, turns: list[tuple[float, float]], node: dict[int, int]
) -> list[tuple[int, int, Array, Array]]:
    """Return one edge a travel: its two nodes, the measured pose, its information matrix."""
    edges: list[tuple[int, int, Array, Array]] = []
    for v in range(1, len(turns)):
        displacement = experience.visits[v].displacement or _guess_displacement(score)
        measured, spread = _turn_edge(displacement, turns[v - 1], turns[v], score)
        information = np.asarray(np.linalg.inv(spread), dtype=float)
        edges.append((node[v - 1], node[v], measured, information))
    return edges


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
