"""The estimate of where places are along true maps, for tests of the filter and its windows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from symbolic_walks import Eyes, Truth, make_grid, observe, walk_randomly

from hssh_kb.place_filter import PlaceFilter, Prediction


def walk_grid(size: int, travels: int, eyes: Eyes, seed: int) -> Truth:
    """Return a random walk on a square grid of L, T and +."""
    rng = np.random.default_rng(seed)
    world = make_grid(size, size)
    return observe(world, walk_randomly(world, travels, rng), eyes, rng)


def follow_truth(
    truth: Truth, heading_var: float = 1e-6
) -> Iterator[tuple[Prediction, PlaceFilter]]:
    """Yield the prediction of each visit of the true map but the first, and the filter after it."""
    state, number = PlaceFilter.start(), {0: 0}
    for v, first in enumerate(truth.partition[1:], 1):
        ahead = state.predict(truth.experience.visits[v].displacement, 1.0)
        if first == v:
            number[v] = ahead.filter.count
            state = ahead.found_place()
        else:
            state = ahead.close(number[first], 0.0, (1e-9, 1e-9, heading_var))
        yield ahead, state
