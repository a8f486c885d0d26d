"""The layout solver: exact cases, an independent solver, degenerate and bad input."""

import numpy as np
import pytest
import scipy.optimize
from symbolic_walks import Eyes, explore, make_grid, observe, walk_randomly

from hssh_kb.errors import InputError, NoAnswerError
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.layout import lay_out, lay_out_hypothesis
from perception.geometry import between, compose, wrap_angle


def _random_graph(n, extra, sigma, seed):
    rng = np.random.default_rng(seed)
    poses = np.column_stack([rng.uniform(-5, 5, (n, 2)), rng.uniform(-np.pi, np.pi, n)])
    poses = between(poses[0], poses)
    i = np.r_[rng.integers(0, np.arange(1, n)), rng.integers(0, n, extra)]
    j = np.r_[np.arange(1, n), rng.integers(0, n, extra)]
    i, j = i[i != j], j[i != j]
    root = rng.normal(size=(len(i), 3, 3)) * 0.3 + np.eye(3)
    cov = sigma**2 * root @ np.swapaxes(root, 1, 2)
    noise = np.einsum("mab,mb->ma", np.linalg.cholesky(cov), rng.normal(size=(len(i), 3)))
    z = between(poses[i], poses[j]) + noise
    return poses, i, j, z, np.linalg.inv(cov)


def _residuals(x, n, i, j, z, information):
    poses = np.vstack([np.zeros(3), x.reshape(-1, 3)])
    e = between(poses[i], poses[j]) - z
    e[:, 2] = wrap_angle(e[:, 2])
    return np.einsum("mab,mb->ma", np.swapaxes(np.linalg.cholesky(information), 1, 2), e).ravel()


@pytest.mark.parametrize("n", [2, 12, 60])
def test_without_noise_the_truth_comes_back(n):
    poses, i, j, z, _ = _random_graph(n, n, 0.1, n)
    z = between(poses[i], poses[j])
    laid = lay_out(n, i, j, z, np.repeat(np.eye(3)[None], len(i), axis=0))
    assert laid.chi2 < 1e-12
    assert np.allclose(laid.poses[:, :2], poses[:, :2], atol=1e-6)
    assert np.allclose(wrap_angle(laid.poses[:, 2] - poses[:, 2]), 0, atol=1e-6)


@pytest.mark.parametrize(("n", "seed"), [(8, 1), (25, 2), (55, 3)])
def test_optimum_is_that_of_an_independent_solver_with_full_covariances(n, seed):
    poses, i, j, z, information = _random_graph(n, n, 0.03, seed)
    laid = lay_out(n, i, j, z, information)
    other = scipy.optimize.least_squares(
        _residuals, poses[1:].ravel(), args=(n, i, j, z, information), xtol=1e-12, ftol=1e-12
    )
    assert laid.chi2 == pytest.approx(2 * other.cost, rel=1e-5)
    marginal = np.linalg.inv(other.jac.T @ other.jac)
    assert np.allclose(laid.covariances[1], marginal[:3, :3], rtol=2e-3, atol=1e-9)


def test_residuals_are_divided_by_sigma_so_that_chi2_has_its_degrees_of_freedom():
    chi2, free = 0.0, 0
    for seed in range(20):
        _, i, j, z, information = _random_graph(20, 20, 0.02, seed)
        chi2 += lay_out(20, i, j, z, information).chi2
        free += 3 * len(i) - 3 * 19
    assert chi2 / free == pytest.approx(1, abs=0.12)


def test_angles_are_wrapped_around_a_ring_that_turns_twice():
    n = 16
    step = np.tile([1.0, 0.0, 4 * np.pi / n], (n, 1))
    laid = lay_out(n, range(n), np.r_[1:n, 0], step, np.repeat(np.eye(3)[None], n, axis=0))
    assert laid.chi2 < 1e-9


def test_two_nodes_joined_twice_meet_in_the_weighted_mean():
    information = [np.diag([4.0, 1, 1]), np.diag([12.0, 1, 1])]
    laid = lay_out(2, [0, 0], [1, 1], [[1.0, 0, 0], [2.0, 0, 0]], information)
    assert laid.poses[1] == pytest.approx([1.75, 0, 0], abs=1e-9)
    assert laid.chi2 == pytest.approx(4 * 0.75**2 + 12 * 0.25**2)


def test_one_node_needs_no_edge():
    laid = lay_out(1, [], [], [], [])
    assert laid.poses.tolist() == [[0, 0, 0]]
    assert laid.covariances.tolist() == [np.zeros((3, 3)).tolist()]


@pytest.mark.parametrize(
    ("edges", "error", "words"),
    [
        (([0], [5], [[1, 0, 0]], [np.eye(3)]), InputError, "outside 0..2"),
        (([0, 1], [1, 2], [[1, 0, 0]], [np.eye(3)]), InputError, "one of each an edge"),
        (([0, 1], [1, 2], [[1, 0, 0], [np.nan, 0, 0]], [np.eye(3)] * 2), InputError, "finite"),
        (
            ([0, 1], [1, 2], [[1, 0, 0]] * 2, [np.eye(3), -np.eye(3)]),
            InputError,
            "edge 1 is not positive semidefinite",
        ),
        (([0], [1], [[1, 0, 0]], [np.eye(3)]), NoAnswerError, "joins node 2"),
    ],
)
def test_bad_input_is_told_in_a_sentence(edges, error, words):
    with pytest.raises(error, match=words):
        lay_out(3, *edges)


@pytest.mark.parametrize(
    "eyes",
    [
        Eyes(sigma=0.02),
        Eyes(sigma=0.02, headings=False),
        Eyes(sigma=0.02, robot_frames=True, headings_rad=0.05),
        Eyes(sigma=0.02, robot_frames=True, headings=False),
    ],
    ids=["headings", "shared frames", "robot frames, headings", "robot frames, no headings"],
)
def test_places_of_the_true_map_lie_where_they_are(eyes):
    rng = np.random.default_rng(5)
    world = make_grid(4, 3)
    truth = observe(world, explore(world, 40, rng), eyes, rng)
    laid = lay_out_hypothesis(truth.experience, truth.hypothesis())
    true = np.array([world.positions[truth.places[v]] for v in truth.hypothesis().places])
    true -= true[0]
    u, _, v = np.linalg.svd(laid.poses[:, :2].T @ true)
    assert np.abs(laid.poses[:, :2] @ (u @ v) - true).max() < 0.2
    assert len(laid.poses) == len(laid.covariances) == len(true)
    assert (np.linalg.eigvalsh(laid.covariances[1:]) > 0).all()


def test_travels_without_displacement_do_not_stop_the_layout():
    rng = np.random.default_rng(6)
    world = make_grid(3, 3)
    truth = observe(world, walk_randomly(world, 20, rng), Eyes(), rng)
    visits = list(truth.experience.visits)
    for v in (3, 9):
        visits[v] = type(visits[v])(visits[v].readings)
    experience = type(truth.experience)(tuple(visits))
    laid = lay_out_hypothesis(experience, truth.hypothesis())
    assert np.isfinite(laid.poses).all()


def test_a_map_of_the_first_visits_only_is_laid_out_too():
    rng = np.random.default_rng(7)
    world = make_grid(3, 3)
    truth = observe(world, walk_randomly(world, 12, rng), Eyes(), rng)
    whole = truth.hypothesis()
    part = Hypothesis(whole.visits[:5], whole.offsets[:5])
    assert len(lay_out_hypothesis(truth.experience, part).poses) == len(part.places)


def test_chain_is_composed():
    z = np.array([[1.0, 0.5, 0.3], [2.0, 0.0, -1.0]])
    laid = lay_out(3, [0, 1], [1, 2], z, [np.eye(3)] * 2)
    assert np.allclose(laid.poses[2], compose(z[0], z[1]), atol=1e-9)
