"""How exact headings are, learned from visits that soon come back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from symbolic_walks import Eyes, Truth, make_grid, observe, walk_randomly

from hssh_kb.heading_noise import estimate_heading_noise
from hssh_kb.score import Score, estimate_score


def _walk(eyes: Eyes, seed: int = 3, travels: int = 1200) -> Truth:
    rng = np.random.default_rng(seed)
    world = make_grid(8, 8, stubs=False, rng=rng)
    return observe(world, walk_randomly(world, travels, rng), eyes, rng)


@pytest.mark.parametrize("noise_rad", [0.02, 0.05, 0.15])
def test_the_noise_is_found_and_rather_too_large(noise_rad: float) -> None:
    found = estimate_heading_noise(_walk(Eyes(headings_rad=noise_rad)).experience, 1.0)
    assert found is not None
    assert noise_rad < found < 1.8 * noise_rad


def test_exact_headings_are_never_taken_for_all_too_exact() -> None:
    assert estimate_heading_noise(_walk(Eyes()).experience, 1.0) == math.radians(0.5)


def test_misread_stars_do_not_blur_it() -> None:
    found = estimate_heading_noise(_walk(Eyes(headings_rad=0.03, wrong=0.3)).experience, 1.0)
    assert found is not None
    assert 0.03 < found < 0.05


def test_too_few_returns_tell_nothing() -> None:
    assert estimate_heading_noise(_walk(Eyes(), travels=30).experience, 1.0) is None
    assert estimate_heading_noise(_walk(Eyes(headings=False)).experience, 1.0) is None


def test_travels_without_displacement_are_passed_over() -> None:
    experience = _walk(Eyes(headings_rad=0.05)).experience
    visits = [
        visit if v % 50 else replace(visit, displacement=None)
        for v, visit in enumerate(experience.visits)
    ]
    found = estimate_heading_noise(replace(experience, visits=tuple(visits)), 1.0)
    assert found is not None
    assert 0.05 < found < 0.08


def test_the_score_uses_it() -> None:
    experience = _walk(Eyes(headings_rad=0.02)).experience
    score = estimate_score(experience)
    assert score.dlp_heading_rad == estimate_heading_noise(experience, score.area_m2)
    assert estimate_score(experience, dlp_heading_rad=0.3).dlp_heading_rad == 0.3
    few = _walk(Eyes(), travels=10).experience
    assert estimate_score(few).dlp_heading_rad == Score().dlp_heading_rad
