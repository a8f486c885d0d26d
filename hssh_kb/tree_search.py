"""Best-first search over the tree of maps, joined with conflict-driven learning.

Maps that have explained the same visits are compared with each other: at each depth the best
waiting map grows next, as long as its score is within a slack of the best living map of that
depth and the front of grown maps is not too wide. When maps die of what was learned
(:mod:`hssh_kb.growing_tree`), the fronts of the depths they leave fill again from the maps that
wait there, so that the search jumps back to the closure that was wrong.

Every so many visits, and at the end, the best map is looked back at: where it is strange, more
maps grow (:mod:`hssh_kb.hindsight`); places that it holds twice are merged
(:mod:`hssh_kb.doubles`).

Source: Beeson 2008, sections 8.2 and 10.1.2; the fronts and the looking back are ours.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable

from hssh_kb.doubles import Visits, merge_doubles
from hssh_kb.experience import Visit
from hssh_kb.growing_tree import GrowingTree
from hssh_kb.hindsight import LOOKED_AT, find_strange_stretch
from hssh_kb.revise import revise_map
from hssh_kb.score import Score
from hssh_kb.search_budget import Budget

_STAGES = ((8, 0.5), (32, 0.75), (128, 1.0))
"""Fronts narrow first, then wider: maps grown of one depth at most, and share of the slack."""
_BLURRED = 0.075  # noise of travels beyond which narrow fronts lose the right map: widest only
_AGAIN = 2.0  # share of the work for the first complete map that widening may cost at most ...
_AGAIN_LEAST = 100_000  # ... or this, where it was found soon ...
_AGAIN_MOST = 400_000  # ... and this, where the walk is long
_SLACK_NATS = 10.0  # maps that far below the best of their depth wait ...
_SLACK_PER_NOISE = 100.0  # ... and more by the noise of travels: then mistakes take longer to show
_REVISED = 4  # complete maps, of other places each, that are revised where travels slip
_REVISED_WORK = 60_000  # units of work for one revision at most, where travels slip
_SWEPT = 0.5  # share of the budget for the fronts where travels slip; the rest is for revising
_PATIENCE = 3  # stretches looked back at in vain before the search ends
_LOOK_BACK_NATS = 10.0  # maps that much worse are grown where the favourite went wrong ...
_MOST_EXTRA_NATS = 30.0  # ... each time that is looked into, up to that
_LOOK_BACK_WORK = 600_000  # units of work after which a search looks back no more
_STRETCH = 250  # visits after which a long walk is looked back at, before the search goes on
_MERGE_WORK_PER_VISIT = 200  # units of work that merging may cost, saved up ...
_MERGE_WORK = 100_000  # ... to so much at most
_DETOURS = 4  # maps grown for each visit at most to get to the end when the budget is spent


class TreeOfMaps(GrowingTree):
    """The tree of possible maps, searched for the best.

    Attributes
    ----------
    spent : the latest search ended because its budget was spent.

    Source
    ------
    Beeson 2008, Algorithm 8.1, in best-first order.
    """

    def _reset(self, score: Score) -> None:
        super()._reset(score)
        self.spent = False
        self._seen: set[object] = set()
        self._swept = [0] * len(_STAGES)
        self._extra: list[float] = []
        self._looked: dict[int, int] = {}
        self._look_from = 0
        self._merged_to = -_STRETCH
        self._merge_credit = 0.0
        self._put_off: dict[Visits, float] = {}
        self._variance = 0.0

    def _add(self, visit: Visit) -> None:
        super()._add(visit)
        self._extra.append(0.0)
        if visit.displacement is not None:
            cov = visit.displacement.cov
            self._variance += (cov[0][0] + cov[1][1]) / 2

    def search(
        self,
        *,
        budget_s: float | None = None,
        budget_work: float | None = None,
    ) -> None:
        """Grow maps until the fronts have reached the last visit or the budget is spent.

        When the budget is spent before a complete map was met, the best map of the most visits
        is taken to the end greedily.

        Parameters
        ----------
        budget_s : seconds of wall time; None for no limit.
        budget_work : units of work, the same on every machine; None for no limit.
        """
        last = len(self._visits) - 1
        if last < 1:
            return
        budget = Budget(lambda: self.tree.work, budget_work, budget_s)
        slips = self.score.slip > 0
        self._sweep_ever_wider(lambda: budget.is_spent(_SWEPT if slips else 1.0))
        if not self._fronts.living[-1]:
            self._finish()
        if slips:
            self._revise(budget)
        self._look_from = last - LOOKED_AT  # what is further back was looked at
        self.spent = budget.is_spent() or (
            max(self._swept) < last and self._fronts.count_leaves() > 0
        )

    def _sweep_ever_wider(self, is_over: Callable[[], bool]) -> None:
        """Let the fronts grow, ever wider until that finds no better map."""
        blurred = self.score.slip > 0 or self._measure_noise() > _BLURRED
        first = len(_STAGES) - 1 if blurred else 0
        lead, start, is_enough = None, self.tree.work, is_over
        for stage in range(first, len(_STAGES)):
            for goal in self._list_goals(stage) if stage == first else [len(self._visits) - 1]:
                self._sweep(stage, goal, is_enough)
                if self.score.slip == 0:
                    end = start + _LOOK_BACK_WORK * goal / (len(self._visits) - 1)
                    self._look_back(stage, goal, self._end_by(end, is_enough))
                    self._merge_doubles(goal)
            found = self.lead
            if found is not None and (found is lead or is_enough()):
                return
            if found is not None and lead is None:
                again = max(_AGAIN * (self.tree.work - start), _AGAIN_LEAST)
                end = self.tree.work + min(again, _AGAIN_MOST)
                is_enough = self._end_by(end, is_over)
            lead = found

    def _list_goals(self, stage: int) -> list[int]:
        """Return the visits at which to look back, evenly spread, the last among them."""
        start, last = self._swept[stage], len(self._visits) - 1
        count = max(1, round((last - start) / _STRETCH))
        return [start + (last - start) * (k + 1) // count for k in range(count)]

    def _look_back(self, stage: int, goal: int, is_over: Callable[[], bool]) -> None:
        """Grow more maps where the best complete one shows that it went wrong, while that helps."""
        patience = _PATIENCE
        while patience and not is_over():
            lead = self._find_lead(goal)
            stretch = find_strange_stretch(lead, self._look_from, self.score, self._looked)
            if stretch is None:
                return
            for depth in range(stretch.start, stretch.end):
                self._extra[depth] = min(self._extra[depth] + _LOOK_BACK_NATS, _MOST_EXTRA_NATS)
            self._swept[stage] = stretch.start
            self._sweep(stage, goal, is_over)
            patience = patience - 1 if self._find_lead(goal) is lead else _PATIENCE

    def _end_by(self, work: float, is_over: Callable[[], bool]) -> Callable[[], bool]:
        return lambda: self.tree.work >= work or is_over()

    def _merge_doubles(self, goal: int) -> None:
        """Merge places that the best map holds twice; the maps made wait as leaves.

        What that costs is saved up visit by visit; the budget of a search has no say. The last
        merger tried may cost more than is left: then the next ones come later.
        """
        lead = self._find_lead(goal)
        if lead is None or goal < self._merged_to + _STRETCH // 2:
            return
        saved = self._merge_credit + _MERGE_WORK_PER_VISIT * (goal - self._merged_to)
        self._merged_to, end = goal, self.tree.work + min(saved, _MERGE_WORK)
        is_over = self._end_by(end, lambda: False)
        for better in merge_doubles(self.tree, lead, is_over, self._put_off):
            self._fronts.wait(better)
        self._merge_credit = end - self.tree.work

    def _sweep(self, stage: int, last: int, is_over: Callable[[], bool]) -> None:
        """Let the front of each depth grow, from the first that may have changed to the last."""
        fronts = self._fronts
        depth = self._swept[stage]
        while depth < last and not is_over():
            self._widen(depth, stage, is_over)
            self._repair(depth + 1, is_over)
            if fronts.living[depth + 1]:
                depth += 1
            elif stage < len(_STAGES) - 1:
                break  # wider fronts are less likely to die out
            elif any(fronts.living[:last]) or fronts.bring_back():
                depth = 0  # nothing lives that deep: the fronts before it fill again
            else:
                break
        self._swept[stage] = min(depth, last)

    def _widen(self, depth: int, stage: int, is_over: Callable[[], bool]) -> None:
        """Grow the best waiting maps of a depth until its front is as wide as it should be."""
        width, share = _STAGES[-1 if self._extra[depth] else stage]
        fronts, slack = self._fronts, share * self._find_slack() + self._extra[depth]
        grown = fronts.list_grown(depth)
        while not is_over():
            top = fronts.top(depth)
            better = len(grown) - bisect.bisect_right(grown, top)
            near = better < width and top >= fronts.peak(depth) - slack
            if top == -math.inf or not (near or fronts.count_grown(depth) == 0):
                return
            node = fronts.take(depth)
            if node is not None:
                self._expand(node)
                bisect.insort(grown, node.worth)

    def _find_slack(self) -> float:
        """Return how far [nats] below the best of its depth a map is grown at once."""
        return _SLACK_NATS + _SLACK_PER_NOISE * min(self._measure_noise(), 0.3)

    def _measure_noise(self) -> float:
        """Return the standard deviation of the displacements as a share of a typical travel."""
        return math.sqrt(self._variance / max(len(self._visits) - 1, 1)) / self.score.length_m

    def _finish(self) -> None:
        """Take the best of the deepest maps to the last visit, whatever it costs them."""
        last = len(self._visits) - 1
        for _ in range(_DETOURS * len(self._visits)):
            deepest = max((d for d in range(last + 1) if self._fronts.living[d]), default=last)
            node = self._fronts.take(deepest) if deepest < last else None
            if node is None:
                return
            self._expand(node)

    def _revise(self, budget: Budget) -> None:
        """Revise the best complete maps as a whole; whatever that makes waits as a leaf."""
        partitions: set[tuple[int, ...]] = set()
        is_over = budget.allot(_REVISED * _REVISED_WORK)
        for node in self._fronts.list_best(len(self._visits) - 1, 40 * _REVISED):
            partition = tuple(one.decision.place for one in node.chain())
            if partition not in partitions:
                partitions.add(partition)
                for better in revise_map(self.tree, node, is_over, self._seen):
                    self._fronts.wait(better)
            if len(partitions) == _REVISED:
                break
