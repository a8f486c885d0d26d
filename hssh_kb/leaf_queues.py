"""The leaves that wait: one queue a depth, and the hope of what each further visit may add.

Source: ours.
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from hssh_kb.node import Node
from hssh_kb.repair import Repair

Item = tuple[float, int, Node | Repair]


class LeafQueues:
    """Leaves by depth, each queue ordered by log posterior.

    Attributes
    ----------
    tops : best score waiting at each depth, -inf if none.
    hopes : the most that any map has gained by each visit, at least what a new place gains
        that nothing speaks against; 0 where no map has got to yet.
    peaks : best score of any map ever queued at each depth.
    """

    def __init__(self) -> None:
        self._heaps: list[list[Item]] = []
        self._serial = 0
        self.tops = np.zeros(0)
        self.hopes = np.zeros(0)
        self.peaks = np.zeros(0)

    def __len__(self) -> int:
        return sum(map(len, self._heaps))

    @property
    def depths(self) -> int:
        """How many depths there are: one a visit."""
        return len(self._heaps)

    def add_depth(self) -> None:
        """Make room for one more visit."""
        self._heaps.append([])
        self.tops = np.append(self.tops, -math.inf)
        self.hopes = np.append(self.hopes, 0.0)
        self.peaks = np.append(self.peaks, -math.inf)

    def has_items(self, depth: int) -> bool:
        """Return whether anything waits at a depth."""
        return bool(self._heaps[depth])

    def push(self, depth: int, score: float, item: Node | Repair) -> None:
        """Let an item wait at a depth."""
        self._serial += 1
        heapq.heappush(self._heaps[depth], (-score, self._serial, item))
        if score > self.tops[depth]:
            self.tops[depth] = score

    def queue_chain(self, node: Node | None) -> None:
        """Let a map wait, and every map on the way to it that does not yet."""
        while node is not None and not node.queued:
            node.queued = True
            self.push(node.visit, node.score, node)
            if node.score > self.peaks[node.visit]:
                self.peaks[node.visit] = node.score
            node = node.parent

    def pop(self, depth: int) -> Node | Repair:
        """Take out the best item of a depth."""
        heap = self._heaps[depth]
        item = heapq.heappop(heap)[2]
        self.tops[depth] = -heap[0][0] if heap else -math.inf
        return item

    def raise_hope(self, depth: int, gain: float, known: bool) -> None:
        """Note what a map gained by the visit at a depth."""
        self.hopes[depth] = max(gain, float(self.hopes[depth])) if known else gain

    def choose_depth(self) -> tuple[int, float]:
        """Return the depth whose best leaf has the best prospect, and that prospect.

        The prospect is the score plus the hopes of all visits to come; -inf if no leaf is
        left to grow.
        """
        if len(self.tops) < 2:
            return 0, -math.inf
        prospects = self.tops[:-1] + np.cumsum(self.hopes[:0:-1])[::-1]
        depth = int(np.argmax(prospects))
        return depth, float(prospects[depth])

    def list_best(self, depth: int, k: int) -> list[Node]:
        """Return the k best maps that wait at a depth, best first."""
        nodes = [item for item in self._heaps[depth] if isinstance(item[2], Node)]
        return [node for _, _, node in heapq.nsmallest(k, nodes) if isinstance(node, Node)]
