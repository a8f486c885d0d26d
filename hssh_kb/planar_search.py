"""Some planar map of a long experience under assumptions, by growing the tree of maps."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator, Sequence
from itertools import count

from hssh_kb.congruence import Assumption
from hssh_kb.enumerator import TreeEnumerator
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis

_FIRST_NODES = 400
_GROWTH = 1.2


def find_planar_map(
    experience: Experience,
    assumptions: Sequence[Assumption],
    least: Hypothesis,
    end: float,
) -> Hypothesis | None:
    """Return some planar map in which assumptions hold, or None if none was found in time.

    Depth first, compact maps first, begun anew in another random order when it gets nowhere. What
    the least map of the assumptions makes one place is one place here.

    Source
    ------
    Ours; the tree is that of Beeson 2008, Algorithm 8.1.
    """
    nodes = float(_FIRST_NODES)
    for attempt in count():
        if time.monotonic() >= end:
            break
        tree = _AssumingTree(experience, assumptions, least, end, int(nodes), attempt)
        complete = tree.run()
        if tree.found:
            return tree.found[0]
        if complete and not tree.given_up and not tree.skipped:
            break
        nodes *= _GROWTH
    return None


class _AssumingTree(TreeEnumerator):
    """Grows only maps in which assumptions hold, and not for long."""

    def __init__(
        self,
        experience: Experience,
        assumptions: Sequence[Assumption],
        least: Hypothesis,
        end: float,
        most_nodes: int,
        seed: int,
    ) -> None:
        super().__init__(experience, len(experience), limit=1, end=end)
        self.most_nodes, self.given_up, self.skipped = most_nodes, False, False
        self.rng = random.Random(seed)
        self.boldness = (1.0, 0.8, 0.5, 0.2)[seed % 4]
        self.same: dict[int, list[int]] = {}
        self.different: dict[int, list[int]] = {}
        for a in assumptions:
            later, earlier = max(a.one, a.other), min(a.one, a.other)
            (self.same if a.same else self.different).setdefault(later, []).append(earlier)
        for v, p in enumerate(least.visits):
            if p < v:
                self.same.setdefault(v, []).append(p)

    def _grow(self, v: int) -> None:
        """Go on only if the visit just placed agrees with the assumptions."""
        last, place = v - 1, self.visits[v - 1]
        if self.found or self.given_up:
            return
        if self.nodes > self.most_nodes:
            self.given_up = True
            return
        if any(self.visits[w] != place for w in self.same.get(last, ())):
            return
        if any(self.visits[w] == place for w in self.different.get(last, ())):
            return
        super()._grow(v)

    def _closures(self, v: int, came: int, out: int) -> Iterator[tuple[int, int]]:
        """Yield the ways to close a loop, boldly or not, and in another order each time."""
        ways = list(super()._closures(v, came, out))
        self.rng.shuffle(ways)
        if self.rng.random() < self.boldness or self.same.get(v):
            yield from ways
        elif ways:
            self.skipped = True


def sample_planar_maps(experience: Experience, end: float) -> Iterator[Hypothesis]:
    """Yield planar maps of an experience, compact ones for the most part, until the time is out.

    Source
    ------
    Ours: what a search for the best map starts from, and falls back on.
    """
    identity = tuple(range(len(experience)))
    least = Hypothesis(identity, (0,) * len(experience))
    for attempt in count():
        if time.monotonic() >= end:
            return
        most_nodes = _FIRST_NODES + 20 * attempt
        tree = _AssumingTree(experience, (), least, end, most_nodes, attempt)
        tree.run()
        yield from tree.found
