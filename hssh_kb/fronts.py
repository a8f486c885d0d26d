"""The maps that wait to be grown, depth by depth, and which maps still live.

A map lives while it waits or something that grew from it does. A waiting map is measured against
the best living map of the same visits, and when a favourite dies with all that came of it, the
others are measured against the next.

Source: ours.
"""

from __future__ import annotations

import heapq
import math

from hssh_kb.node import Node

Item = tuple[float, int, Node]


class Fronts:
    """Maps by depth (the number of the latest visit).

    Attributes
    ----------
    living : how many maps live, by depth.
    waiting : how many of them wait to be grown.
    """

    def __init__(self) -> None:
        self._heaps: list[list[Item]] = []
        self._peaks: list[list[Item]] = []
        self._rests: list[list[tuple[Node, float, float]]] = []
        self._serial = 0
        self.living: list[int] = []
        self.waiting: list[int] = []

    def add_depth(self) -> None:
        """Make room for one more visit."""
        self._heaps.append([])
        self._peaks.append([])
        self._rests.append([])
        self.living.append(0)
        self.waiting.append(0)

    # -- waiting and living -----------------------------------------------------------------

    def wait(self, node: Node) -> None:
        """Let a map wait, and every map on the way to it that never did."""
        todo = []
        above: Node | None = node
        while above is not None and not above.queued and not above.dead:
            todo.append(above)
            above = above.parent
        if above is not None and above.dead:
            return
        for one in reversed(todo):
            one.queued = True
            self._let_wait(one, one.worth)

    def _let_wait(self, node: Node, worth: float) -> None:
        node.waits = True
        self.waiting[node.visit] += 1
        self._serial += 1
        heapq.heappush(self._heaps[node.visit], (-worth, self._serial, node))
        self._wake(node)

    def _wake(self, node: Node | None) -> None:
        """Count one more that lives on in a map."""
        while node is not None and node.visit >= 0:
            node.heirs += 1
            if node.heirs > 1:
                return
            self.living[node.visit] += 1
            self._serial += 1
            heapq.heappush(self._peaks[node.visit], (-node.worth, self._serial, node))
            node = node.parent

    def _forsake(self, node: Node | None) -> None:
        """Count one less that lives on in a map."""
        while node is not None and node.visit >= 0:
            node.heirs -= 1
            if node.heirs > 0:
                return
            self.living[node.visit] -= 1
            node = node.parent

    def take(self, depth: int) -> Node | None:
        """Take out the best map that waits at a depth; :meth:`settle` it once it is grown."""
        self._clear(depth)
        heap = self._heaps[depth]
        return heapq.heappop(heap)[2] if heap else None

    def settle(self, node: Node) -> None:
        """Note that a map taken out waits no more: its children live for it."""
        if node.waits:
            node.waits = False
            self.waiting[node.visit] -= 1
            self._forsake(node)

    def bury(self, node: Node) -> None:
        """Let a map die with all that grew from it."""
        if node.dead:
            return
        lived = node.heirs > 0
        todo = [node]
        while todo:
            one = todo.pop()
            if one.dead:
                continue
            one.dead = True
            if one.heirs > 0:
                self.living[one.visit] -= 1
                self.waiting[one.visit] -= one.waits
            one.heirs, one.waits = 0, False
            todo.extend((one.children or {}).values())
        if lived:
            self._forsake(node.parent)

    # -- what is put off ---------------------------------------------------------------------

    def put_off(self, node: Node, worth: float, bound: float) -> None:
        """Put off the rest of the ways on from a grown map.

        Parameters
        ----------
        node : the map.
        worth : how it is to wait when it is brought back.
        bound : score of the map, less what the best of the rest falls short of the best
            way there could be.
        """
        self._rests[node.visit].append((node, worth, bound))

    def bring_back(self) -> bool:
        """Let all maps wait again that were put off; False if there are none."""
        found = False
        for depth, rest in enumerate(self._rests):
            self._rests[depth] = []
            for node, worth, _ in rest:
                if not node.dead:
                    found = True
                    self._let_wait(node, worth)
        return found

    # -- looking -----------------------------------------------------------------------------

    def _clear(self, depth: int) -> None:
        heap = self._heaps[depth]
        while heap and not heap[0][2].waits:
            heapq.heappop(heap)

    def top(self, depth: int) -> float:
        """Return the worth of the best map that waits at a depth, -inf if none does."""
        self._clear(depth)
        heap = self._heaps[depth]
        return -heap[0][0] if heap else -math.inf

    def peak(self, depth: int) -> float:
        """Return the worth of the best living map of a depth, -inf if none lives."""
        heap = self._peaks[depth]
        while heap and not heap[0][2].heirs:
            heapq.heappop(heap)
        return -heap[0][0] if heap else -math.inf

    def count_grown(self, depth: int) -> int:
        """Return how many living maps of a depth are grown."""
        return self.living[depth] - self.waiting[depth]

    def list_grown(self, depth: int) -> list[float]:
        """Return the worth of each living map of a depth that is grown, the worst first."""
        return sorted(node.worth for node in self.list_living(depth) if not node.waits)

    def count_leaves(self) -> int:
        """Return how many maps wait, those put off among them."""
        return sum(self.waiting) + sum(not item[0].dead for rest in self._rests for item in rest)

    def bound(self, depth: int) -> float:
        """Return the score that no map waiting or put off at a depth is above."""
        off = (most for node, _, most in self._rests[depth] if not node.dead)
        return max(self.top(depth), max(off, default=-math.inf))

    def list_living(self, depth: int) -> list[Node]:
        """Return the living maps of a depth."""
        return list({node.serial: node for _, _, node in self._peaks[depth] if node.heirs}.values())

    def list_best(self, depth: int, k: int) -> list[Node]:
        """Return the k maps of the best score that wait at a depth, best first."""
        nodes = [node for _, _, node in self._heaps[depth] if node.waits]
        return heapq.nsmallest(k, nodes, key=lambda node: (-node.score, node.serial))
