"""Some planar maps of an experience, by growing the tree of maps in random orders."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from itertools import count

from hssh_kb.enumerator import TreeEnumerator
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis

_FIRST_NODES, _MORE_NODES = 400, 20


def sample_planar_maps(experience: Experience, end: float) -> Iterator[Hypothesis]:
    """Yield planar maps of an experience, compact ones for the most part, until the time is out.

    Depth first, begun anew in another random order when it gets nowhere.

    Source
    ------
    Ours: what a search for the best map falls back on. The tree is that of Beeson 2008,
    Algorithm 8.1.
    """
    for attempt in count():
        if time.monotonic() >= end:
            return
        tree = _RandomTree(experience, end, _FIRST_NODES + _MORE_NODES * attempt, attempt)
        tree.run()
        yield from tree.found


class _RandomTree(TreeEnumerator):
    """Grows maps in a random order, and not for long."""

    def __init__(self, experience: Experience, end: float, most_nodes: int, seed: int) -> None:
        super().__init__(experience, len(experience), limit=1, end=end)
        self.most_nodes = most_nodes
        self.rng = random.Random(seed)
        self.boldness = (1.0, 0.8, 0.5, 0.2)[seed % 4]

    def _grow(self, v: int) -> None:
        """Go on unless a map was found or it takes too long."""
        if not self.found and self.nodes <= self.most_nodes:
            super()._grow(v)

    def _closures(self, v: int, came: int, out: int) -> Iterator[tuple[int, int]]:
        """Yield the ways to close a loop, boldly or not, and in another order each time."""
        ways = list(super()._closures(v, came, out))
        self.rng.shuffle(ways)
        if self.rng.random() < self.boldness:
            yield from ways
