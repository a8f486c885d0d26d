"""The covariance told by its changes is the one written out."""

import numpy as np
import pytest

from hssh_kb.joint_covariance import JointCovariance


def _change_randomly(seed, arrivals):
    """Yield the covariance and the same as a plain matrix, after each arrival."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((9, 9))
    plain = root @ root.T
    joint = JointCovariance.of(plain.copy())
    for _ in range(arrivals):
        if rng.random() < 0.4:
            size = len(plain)
            mix = rng.standard_normal((3, size)) / size
            columns = np.vstack([plain @ mix.T, mix @ plain @ mix.T + np.eye(3)])
            plain = np.block([[plain, columns[:-3]], [columns.T]])
            joint = joint.grow(columns)
        else:
            seen = rng.standard_normal((rng.integers(2, 4), len(plain)))
            spread = seen @ plain @ seen.T + np.eye(len(seen))
            taken = plain @ seen.T @ np.linalg.inv(np.linalg.cholesky(spread)).T
            plain = plain - taken @ taken.T
            joint = joint.shrink(taken)
        yield joint, plain


@pytest.mark.parametrize("seed", range(4))
def test_changes_add_up_to_the_whole(seed):
    written = 0
    for joint, plain in _change_randomly(seed, 120):
        written += joint.changes == 0
        assert np.allclose(joint.write_out(), plain)
        assert joint.held == len(plain) // 3
        for slot in (0, joint.held // 2, joint.held - 1):
            assert np.allclose(joint.take_columns(slot), plain[:, 3 * slot : 3 * slot + 3])
    assert 0 < written < 120


def test_what_grows_from_a_covariance_leaves_it_alone():
    *_, (joint, plain) = _change_randomly(0, 30)
    for _ in range(40):
        joint.shrink(1e-3 * np.ones((3 * joint.held, 2))).grow(np.ones((3 * joint.held + 3, 3)))
    assert np.allclose(joint.write_out(), plain)


def test_an_arrival_is_small_beside_the_whole():
    """What one map does not share with the map it grew from."""
    joint = JointCovariance.of(np.eye(600))
    one = joint.shrink(1e-3 * np.ones((600, 3)))
    assert one.base is joint.base
    assert one.nbytes == 600 * 3 * 8
