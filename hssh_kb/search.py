"""Best-first search over the tree of maps, all leaves at any depth in play.

Leaves wait in one queue a depth, ordered by log posterior. A leaf's prospect is its score plus,
for each visit still to come, the best change of score that any map had there; the leaf of the
best prospect grows next. When the favourites are refuted and nothing gets deeper, the search
cycles through the depths instead, growing the best leaf of each, so that maps are compared
with others that have explained the same visits. No consistent leaf is dropped, only left
waiting.

Source: Beeson 2008, sections 8.2 and 10.1.2; lazy evaluation after Johnson's tree of maps;
the prospect, the cycles and the repairs are ours.
"""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Visit
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.map_tree import MapTree, Node
from hssh_kb.repair import Repair, propose_repairs
from hssh_kb.revise import revise_map
from hssh_kb.score import Score, estimate_score

RIVAL_NATS = 12.0
_STUCK = 24  # expansions without getting deeper, before other depths are tried in turn
_LOST = 400  # ... before the best map is completed as it is, to be revised as a whole
_MORE_EFFORT = 1.3  # of the work until the first complete map, to look for rivals


@dataclass(frozen=True)
class SearchResult:
    """What the search found.

    Attributes
    ----------
    maps : the best complete maps, best first; if none is consistent, the best maps of the
        visits before ``inconsistent_from``.
    proven : no waiting map can beat the first one, under the score.
    expansions : maps grown.
    leaves : maps that wait.
    inconsistent_from : the first visit that no map could explain, None if all are explained.
    reason : one sentence on how the search ended.
    """

    maps: tuple[Hypothesis, ...]
    proven: bool
    expansions: int
    leaves: int
    inconsistent_from: int | None
    reason: str


_Item = tuple[float, int, Node | Repair]


class TreeOfMaps:
    """The tree of possible maps, growing as visits arrive.

    Parameters
    ----------
    score : parameters of the log posterior; estimated from ``experience`` if not given.
    experience : visits to start with.
    order, planarity : which axioms to hold the maps to.

    Source
    ------
    Beeson 2008, Algorithm 8.1, in best-first order.
    """

    def __init__(
        self,
        score: Score | None = None,
        *,
        experience: Experience | None = None,
        order: bool = True,
        planarity: bool = True,
    ) -> None:
        self._estimated = score is None
        self._experience = experience or Experience(())
        if score is None:
            score = estimate_score(self._experience)
        self._keywords = {"order": order, "planarity": planarity}
        self._slip = self._experience.slip
        self._reset(score)
        visits = list(self._experience.visits)
        self._visits: list[Visit] = []
        for visit in visits:
            self._add(visit)

    def _reset(self, score: Score) -> None:
        self.tree = MapTree(score, **self._keywords)
        self._heaps: list[list[_Item]] = []
        self._change: list[float | None] = []
        self._tops, self._hopes = np.zeros(0), np.zeros(0)
        self._prospect = -math.inf
        self._reserve: list[_Item] = []
        self._seen: set[object] = set()
        self._serial = 0
        self._deepest = 0
        self._stale = 0
        self._cycle: Iterator[int] = iter(())
        self.expansions = 0

    @property
    def score(self) -> Score:
        """The parameters of the log posterior."""
        return self.tree.score

    def _add(self, visit: Visit) -> None:
        self._visits.append(visit)
        self._heaps.append([])
        self._change.append(None)
        self._tops = np.append(self._tops, -math.inf)
        self._hopes = np.append(self._hopes, 0.0)
        for root in self.tree.add_visit(visit):
            self._queue(root)

    def extend(self, visit: Visit, *, previous: Visit | None = None) -> None:
        """Take in the next visit.

        Parameters
        ----------
        visit : the visit that just happened.
        previous : the visit before it, if its ``depart`` became known only now.

        Raises
        ------
        InputError : the previous visit has no ``depart``.
        """
        if previous is not None and self._visits:
            self._visits[-1] = self.tree.visits[-1] = previous
        if self._visits and any(r.depart is None for r in self._visits[-1].readings):
            raise InputError(
                f"visit {len(self._visits) - 1}: lacks 'depart'; give the visit again with it"
            )
        known = len(self._visits)
        if self._estimated and known in (2, 4, 8, 16):
            visits = tuple(self._visits)
            self._reset(estimate_score(Experience(visits, slip=self._slip)))
            self._visits = []
            for one in visits:
                self._add(one)
        self._add(visit)

    # -- the queues ------------------------------------------------------------------------

    def _push(self, depth: int, score: float, item: Node | Repair) -> None:
        self._serial += 1
        heapq.heappush(self._heaps[depth], (-score, self._serial, item))
        if score > self._tops[depth]:
            self._tops[depth] = score

    def _pop(self, depth: int) -> Node | Repair:
        heap = self._heaps[depth]
        item = heapq.heappop(heap)[2]
        self._tops[depth] = -heap[0][0] if heap else -math.inf
        return item

    def _queue(self, node: Node) -> None:
        node.queued = True
        self._push(node.visit, node.score, node)

    def _choose_depth(self) -> int | None:
        """Return the depth whose best leaf has the best prospect; None if all are complete."""
        prospects = self._tops[:-1] + np.cumsum(self._hopes[:0:-1])[::-1]
        if not len(prospects):
            return None
        depth = int(np.argmax(prospects))
        self._prospect = float(prospects[depth])
        return depth if self._prospect > -math.inf else None

    def _choose_cyclic(self) -> int | None:
        """Return the next depth of the cycle that has a leaf to grow."""
        for _ in range(2):
            for depth in self._cycle:
                if depth < len(self._visits) - 1 and self._heaps[depth]:
                    return depth
            low = 0
            self._cycle = iter(range(low, len(self._visits) - 1))
        return None

    # -- growing ---------------------------------------------------------------------------

    def _grow_at(self, depth: int) -> None:
        item = self._pop(depth)
        if isinstance(item, Repair):
            # Every map on the way to the repaired one is a leaf that other maps may grow from.
            node: Node | None = item.carry_out(self.tree)
            while node is not None and not node.queued:
                self._queue(node)
                node = node.parent
            return
        self._expand(item)

    def _expand(self, node: Node) -> None:
        """Make the children of a map; the first time those worth it, the next time the rest."""
        tree, depth = self.tree, node.visit
        self.expansions += 1
        node.stage += 1
        options = list(tree.options(node, far=node.stage == 2, lean=node.stage < 3))
        best = -math.inf
        for option in options:
            if option.refusal is None:
                child = tree.child(node, option)
                if not child.queued:
                    self._queue(child)
                best = max(best, child.score - node.score)
        if node.stage == 1:
            known = self._change[depth + 1]
            if best > -math.inf:
                # A new place that nothing speaks against is the least a rival may hope for.
                hope = max(best, -math.log(self.score.area_m2))
                hope = hope if known is None else max(known, hope)
                self._change[depth + 1] = self._hopes[depth + 1] = hope
            self._push(depth, node.score - math.log(self.score.area_m2) - 14.0, node)
            for repair in propose_repairs(tree, node, options, best):
                if repair.key not in self._seen:
                    self._seen.add(repair.key)
                    self._push(depth + 1, repair.estimate, repair)
        elif node.stage == 2 and self._has_rest(node):
            self._serial += 1
            heapq.heappush(self._reserve, (-node.score, self._serial, node))
        if best > -math.inf and depth + 1 > self._deepest:
            self._deepest, self._stale = depth + 1, 0
        else:
            self._stale += 1

    def _has_rest(self, node: Node) -> bool:
        return self.score.slip > 0 or len(self._visits[node.visit + 1].readings) > 1

    def _open_reserve(self) -> bool:
        """Bring back the next map whose improbable children were put off."""
        if not self._reserve:
            return False
        score, _, node = heapq.heappop(self._reserve)
        if isinstance(node, Node):
            self._push(node.visit, -score, node)
        return True

    # -- searching -------------------------------------------------------------------------

    def search(self, *, best: int = 5, budget_s: float | None = None) -> None:
        """Grow maps until the best complete ones are found or the budget is spent.

        Parameters
        ----------
        best : how many maps are wanted.
        budget_s : seconds of wall time; None for no limit.
        """
        last = len(self._visits) - 1
        if last < 1:
            return
        start = time.monotonic()
        end = math.inf if budget_s is None else start + budget_s
        hurry = math.inf if budget_s is None else start + 0.4 * budget_s
        self._stale, limit = 0, math.inf
        while time.monotonic() < end and self.expansions < limit:
            if self._heaps[last]:
                if limit == math.inf:
                    limit = _MORE_EFFORT * self.expansions + 8 * best
                    self._revise(last, end)
                depth = self._choose_depth()
                if depth is None or self._is_settled(best):
                    break
                self._grow_at(depth)
            elif self._stale > _LOST or time.monotonic() > hurry:
                self._revise(self._deepest, end)
                self._dive()
                self._stale = 0
            elif not self._grow_somewhere(end):
                break
        if self._heaps[last]:
            self._revise(last, end)

    def _grow_somewhere(self, end: float) -> bool:
        """Grow one map while none is complete; return False if none is left to grow."""
        depth = self._choose_depth()
        if depth is None:
            return self._open_reserve()
        if self._stale > _STUCK:
            if self._stale % (4 * _STUCK) == _STUCK + 1:
                self._revise(self._deepest, end)
            depth = self._choose_cyclic() or depth
        self._grow_at(depth)
        return True

    def _dive(self) -> None:
        """Grow the best of the deepest maps, and always its best child, to the last visit."""
        leaves = [item for _, _, item in sorted(self._heaps[self._deepest])]
        node: Node | None = next((item for item in leaves if isinstance(item, Node)), None)
        while node is not None and node.visit < len(self._visits) - 1:
            if node.stage == 0:
                self._expand(node)
            grown = list((node.children or {}).values())
            node = max(grown, key=lambda child: child.score, default=None)

    def _revise(self, depth: int, end: float) -> None:
        """Revise the best map of a depth as a whole; whatever that makes waits as a leaf."""
        found = [item for _, _, item in heapq.nsmallest(4, self._heaps[depth])]
        maps = [item for item in found if isinstance(item, Node)]
        if not maps:
            return

        def is_over() -> bool:
            return time.monotonic() >= end

        for better in revise_map(self.tree, maps[0], is_over, self._seen):
            node: Node | None = better
            while node is not None and not node.queued:
                self._queue(node)
                node = node.parent

    def _is_settled(self, best: int) -> bool:
        """Return whether no waiting map has the prospect to be among the best."""
        found = heapq.nsmallest(best, self._heaps[-1])
        top = -found[0][0]
        floor = -found[-1][0] if len(found) == best else -math.inf
        return self._prospect <= max(floor, top - RIVAL_NATS)

    def best(self, k: int = 1) -> tuple[Hypothesis, ...]:
        """Return the k best maps of all visits so far, those differing in places or turns."""
        return self._best_at(len(self._visits) - 1, k)

    def _best_at(self, depth: int, k: int) -> tuple[Hypothesis, ...]:
        out: list[Hypothesis] = []
        known: set[object] = set()
        for _, _, item in sorted(self._heaps[depth])[: 50 * k]:
            if isinstance(item, Node):
                found = self.tree.hypothesis(item)
                key = found.visits, found.offsets
                if key not in known:
                    known.add(key)
                    out.append(found)
            if len(out) == k:
                break
        return tuple(out)

    def reached(self, depth: int) -> bool:
        """Return whether some map has explained the visits up to one."""
        return depth == 0 or self._change[depth] is not None

    def best_so_far(self, depth: int, k: int) -> tuple[Hypothesis, ...]:
        """Return the best maps of the visits up to one."""
        return self._best_at(depth, k)

    @property
    def leaves(self) -> int:
        """How many maps wait."""
        return sum(map(len, self._heaps))

    def is_proven(self) -> bool:
        """Return whether no waiting map can beat the best complete one, whatever comes.

        The bound is safe: each travel still to come is credited with the density of an
        innovation as narrow as its displacement alone.
        """
        last = len(self._visits) - 1
        if not self._heaps[last]:
            return False
        top = -self._heaps[last][0][0]
        ahead = 0.0
        for depth in range(last - 1, -1, -1):
            move = self._visits[depth + 1].displacement
            weights = [math.log(r.weight) for r in self._visits[depth + 1].readings]
            ahead += max(weights) + self.score.bound_travel(None if move is None else move.cov)
            if self._heaps[depth] and -self._heaps[depth][0][0] + ahead > top + 1e-9:
                return False
        return not self._reserve


def search_maps(
    experience: Experience,
    *,
    best: int = 5,
    budget_s: float | None = None,
    order: bool = True,
    planarity: bool = True,
    score: Score | None = None,
) -> SearchResult:
    """Search the most probable maps of an experience.

    Parameters
    ----------
    experience : what the robot went through, with displacements.
    best : how many maps to return.
    budget_s : seconds of wall time to spend at most; None for no limit.
    order, planarity : which axioms to hold the maps to.
    score : parameters of the log posterior; estimated from the experience if not given.

    Returns
    -------
    SearchResult

    Raises
    ------
    InputError : the experience has no visits, or a visit lacks what a travel needs.

    Source
    ------
    Beeson 2008, Algorithm 8.1 and section 10.1.2; ours.
    """
    if not experience.visits:
        raise InputError(f"{experience.source or 'experience'}: has no visits to map")
    tree = TreeOfMaps(score, experience=experience, order=order, planarity=planarity)
    tree.search(best=best, budget_s=budget_s)
    maps = tree.best(best)
    if maps:
        proven = tree.is_proven()
        reason = (
            "no waiting map can be more probable"
            if proven
            else "no waiting map is likely to be more probable"
        )
        return SearchResult(maps, proven, tree.expansions, tree.leaves, None, reason)
    depth = max(d for d in range(len(experience)) if tree.reached(d))
    spent = tree.leaves > 0
    reason = (
        f"the budget of {budget_s} s was spent before any map explained visit {depth + 1}"
        if spent
        else f"inconsistent from visit {depth + 1}: no map explains it"
    )
    maps = tree.best_so_far(depth, best)
    return SearchResult(maps, False, tree.expansions, tree.leaves, depth + 1, reason)
