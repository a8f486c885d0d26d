"""A skeleton that can be changed: branches removed, cut short and split, chains staying joined."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import defaultdict
from collections.abc import Sequence

from perception.skeleton import Branch, Node, Skeleton

_TINY = 8


class SkeletonGraph:
    """The branches of a skeleton by number, and which of them meet at each node.

    A number is never used twice; the branch made of two has a new one, and their tags.

    Attributes
    ----------
    nodes, branches : by number.
    at : numbers of the branches that end at a node; a loop counts once.
    tags : anything noted on a branch.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.nodes: dict[int, Node] = dict(skeleton.nodes)
        self.branches: dict[int, Branch] = dict(enumerate(skeleton.branches))
        self.at: dict[int, set[int]] = defaultdict(set)
        self.tags: dict[int, set[int]] = defaultdict(set)
        for k, branch in self.branches.items():
            self.at[branch.tail].add(k)
            self.at[branch.head].add(k)
        self._fresh = len(self.branches)

    def to_skeleton(self) -> Skeleton:
        """Return what is left."""
        kept = list(self.branches.values())
        return Skeleton({n: self.nodes[n] for b in kept for n in (b.tail, b.head)}, kept)

    def degree(self, node: int) -> int:
        """Return how many branch ends a node has."""
        loops = sum(self.branches[k].tail == self.branches[k].head for k in self.at[node])
        return len(self.at[node]) + loops

    def degrees(self) -> dict[int, int]:
        """Return how many branch ends each node has."""
        count = dict.fromkeys(self.nodes, 0)
        for branch in self.branches.values():
            count[branch.tail] += 1
            count[branch.head] += 1
        return count

    def is_leaf(self, k: int) -> bool:
        """Tell whether a branch has one end where nothing else ends."""
        branch = self.branches[k]
        tail, head = self.degree(branch.tail), self.degree(branch.head)
        return branch.tail != branch.head and (tail > 1) != (head > 1)

    def orient_leaf(self, k: int) -> Branch:
        """Return a leaf from its base outward."""
        branch = self.branches[k]
        return branch if self.degree(branch.tail) > 1 else branch.reversed()

    def shorten_leaf(self, k: int, keep: int) -> None:
        """Keep the first points of a leaf only, from its base."""
        outward = self.orient_leaf(k)
        x, y = outward.points_px[keep - 1].tolist()
        self.nodes[outward.head] = Node((x, y), float(outward.radius_px[keep - 1]))
        self.branches[k] = outward.part(0, keep, outward.tail, outward.head)

    def remove(self, k: int) -> list[int]:
        """Remove a branch; return the numbers of the branches joined for want of it."""
        branch = self.branches.pop(k)
        self.tags.pop(k, None)
        joined = []
        for node in {branch.tail, branch.head}:
            self.at[node].discard(k)
        for node in {branch.tail, branch.head}:
            made = self.join_at(node)
            if made is not None:
                joined.append(made)
        return [k for k in joined if k in self.branches]

    def join_at(self, node: int) -> int | None:
        """Join the two branches that end at a node; None if there are not two."""
        rest = sorted(self.at[node])
        if len(rest) != 2 or self.degree(node) != 2:
            return None
        one, two = self.branches.pop(rest[0]), self.branches.pop(rest[1])
        one = one if one.head == node else one.reversed()
        two = two if two.tail == node else two.reversed()
        joined = one.joined(two)
        fresh = self.add(joined)
        self.at.pop(node)
        for end in (joined.tail, joined.head):
            self.at[end] -= set(rest)
        self.tags[fresh] = self.tags.pop(rest[0], set()) | self.tags.pop(rest[1], set())
        return fresh

    def split(self, k: int, i: int) -> tuple[int, int, int]:
        """Split a branch at one of its points; return the node there and the two new branches.

        Tags are not carried over.
        """
        branch = self.branches.pop(k)
        for end in {branch.tail, branch.head}:
            self.at[end].discard(k)
        node = 1 + max(self.nodes)
        x, y = branch.points_px[i].tolist()
        self.nodes[node] = Node((x, y), float(branch.radius_px[i]))
        size = len(branch.points_px)
        one = self.add(branch.part(0, i + 1, branch.tail, node))
        two = self.add(branch.part(i, size, node, branch.head))
        return node, one, two

    def cut(self, k: int, points: Sequence[int]) -> set[int]:
        """Cut a branch at some of its points, in order; return the nodes of the loose ends.

        Tags are not carried over.
        """
        branch = self.branches.pop(k)
        self.tags.pop(k, None)
        for end in {branch.tail, branch.head}:
            self.at[end].discard(k)
        size = len(branch.points_px)
        bounds = [0, *(min(max(i, 1), size - 2) for i in points), size]
        loose = set[int]()
        fresh = 1 + max(self.nodes)
        for first, last in itertools.pairwise(bounds):
            if last - first < 2:
                continue
            tail, head = branch.tail, branch.head
            for at, inner in ((first, first > 0), (last - 1, last < size)):
                if not inner:
                    continue
                x, y = branch.points_px[at].tolist()
                self.nodes[fresh] = Node((x, y), float(branch.radius_px[at]))
                tail, head = (fresh, head) if at == first else (tail, fresh)
                loose.add(fresh)
                fresh += 1
            self.add(branch.part(first, last, tail, head))
        return loose

    def add(self, branch: Branch) -> int:
        """Add a branch between nodes; return its number."""
        fresh = self._fresh
        self._fresh += 1
        self.branches[fresh] = branch
        self.at[branch.tail].add(fresh)
        self.at[branch.head].add(fresh)
        return fresh

    def list_parts(self) -> list[list[int]]:
        """Return the numbers of the branches of each connected part."""
        seen, parts = set[int](), list[list[int]]()
        for first in self.branches:
            if first in seen:
                continue
            part, stack = list[int](), [first]
            seen.add(first)
            while stack:
                k = stack.pop()
                part.append(k)
                for node in (self.branches[k].tail, self.branches[k].head):
                    beyond = self.at[node] - seen
                    seen |= beyond
                    stack += beyond
            parts.append(part)
        return parts

    def count_points(self, part: Sequence[int]) -> int:
        """Return how many points some branches have together."""
        return sum(len(self.branches[k].points_px) for k in part)

    def keep_largest(self, branch: int | None = None) -> None:
        """Remove all but the connected part with the most points, or that of a branch."""
        parts = self.list_parts()
        kept = max(parts, key=self.count_points, default=None)
        if branch is not None:
            kept = next(part for part in parts if branch in part)
        for k in (k for part in parts if part is not kept for k in part):
            gone = self.branches.pop(k)
            self.at[gone.tail].discard(k)
            self.at[gone.head].discard(k)

    def drop_tiny_loops(self, tiny: int = _TINY) -> None:
        """Remove loops, and second links, too short to go around anything; join the chains.

        Parameters
        ----------
        tiny : they have fewer points than this.
        """
        linked, loose = set[tuple[int, int]](), set[int]()
        short = [(len(b.points_px), k) for k, b in self.branches.items() if len(b.points_px) < tiny]
        for _, k in sorted(short):
            branch = self.branches[k]
            link = (min(branch.tail, branch.head), max(branch.tail, branch.head))
            if branch.tail == branch.head or link in linked:
                self.branches.pop(k)
                loose.update(link)
                for node in link:
                    self.at[node].discard(k)
            linked.add(link)
        for node in loose:
            self.join_at(node)

    def measure_way(self, start: int, goal: int, without: int = -1) -> float:
        """Return the length of the shortest way from node to node that does not pass one branch.

        In pixels; infinite if there is none.
        """
        queue, done = [(0.0, start)], set[int]()
        while queue:
            here, node = heapq.heappop(queue)
            if node == goal:
                return here
            if node in done:
                continue
            done.add(node)
            for k in self.at[node]:
                if k == without:
                    continue
                branch = self.branches[k]
                other = branch.head if branch.tail == node else branch.tail
                if other not in done:
                    heapq.heappush(queue, (here + float(branch.steps_px[-1]), other))
        return math.inf
