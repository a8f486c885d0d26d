"""Telling returns from "nothing was hit"."""

import numpy as np
import pytest

from perception.returns import find_saturation, mask_no_returns


def make_rooms(seed: int = 0, size: int = 4000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.round(rng.gamma(2.0, 2.0, size).clip(0.3, 25.0 * rng.random(size) + 1), 2)


@pytest.mark.parametrize("maximum", [30.0, 32.767, 50.0, 81.91])
def test_the_spike_at_the_top_is_found(maximum):
    ranges = np.append(make_rooms(), np.full(60, maximum))
    assert find_saturation(ranges) == pytest.approx(maximum, abs=0.006)
    masked = mask_no_returns(ranges[None])
    assert np.isnan(masked).sum() == 60


def test_several_error_codes_are_all_masked():
    ranges = np.concatenate([make_rooms(), np.full(900, 51.15), np.full(86, 50.0), [51.25, 51.3]])
    assert find_saturation(ranges) == 50.0
    assert np.isnan(mask_no_returns(ranges[None])).sum() == 988


def test_one_wild_reading_hides_nothing():
    ranges = np.concatenate([make_rooms(), np.full(60, 30.0), [5999.0]])
    assert find_saturation(ranges) == 30.0


def test_without_saturation_all_is_kept():
    assert find_saturation(make_rooms()) is None
    assert np.isfinite(mask_no_returns(make_rooms()[None])).all()
    assert find_saturation(np.array([np.nan])) is None


def test_an_announced_maximum_is_used_but_not_believed_against_the_data():
    ranges = make_rooms()[None]
    assert np.isfinite(mask_no_returns(ranges, announced_max_m=2.0)).all()
    clipped = np.minimum(ranges, 100.0)
    clipped[0, 0] = 80.2
    assert np.isnan(mask_no_returns(clipped, announced_max_m=80.99)).sum() == 1


def test_what_is_no_distance_is_no_return():
    ranges = np.array([[0.0, -1.0, np.inf, np.nan, 1e300, 2.0]])
    assert np.isnan(mask_no_returns(ranges)).tolist() == [[True] * 5 + [False]]
