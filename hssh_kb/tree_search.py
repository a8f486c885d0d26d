"""Best-first search over the tree of maps, joined with conflict-driven learning.

Maps that have explained the same visits are compared with each other: at each depth the best
waiting map grows next, as long as its score is within a slack of the best living map of that
depth and the front of grown maps is not too wide. When a visit refutes a map, the reason is
learned: a set of closures that cannot stand together (:mod:`hssh_kb.nogoods`). All maps that
hold it die at once, at whatever depth they wait; the fronts of the depths they leave fill again
from the maps that wait there, so that the search jumps back to the closure that was wrong. A
complete map that is strange, looking back, calls for more maps there (:mod:`hssh_kb.hindsight`).
No consistent map is ever dropped, only left waiting.

Source: Beeson 2008, sections 8.2 and 10.1.2; lazy evaluation after Johnson's tree of maps;
the fronts and the learning are ours.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable

from hssh_kb.doubles import find_doubles
from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Visit
from hssh_kb.fronts import Fronts
from hssh_kb.hindsight import LOOKED_AT, find_strange_stretch
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.map_tree import MapTree
from hssh_kb.node import GATE_NATS, Node
from hssh_kb.nogoods import Nogood, is_refuted, learn_nogood
from hssh_kb.repair import RepairQueue, propose_repairs
from hssh_kb.revise import Change, merge_labels, revise_map, thread_visits
from hssh_kb.score import Score, estimate_score
from hssh_kb.search_budget import Budget

_STAGES = ((8, 0.5), (32, 0.75), (128, 1.0))
"""Fronts narrow first, then wider: maps grown of one depth at most, and share of the slack."""
_BLURRED = 0.075  # noise of travels beyond which narrow fronts lose the right map: widest only
_AGAIN = 2.0  # share of the work for the first complete map that widening may cost at most ...
_AGAIN_LEAST = 100_000  # ... or this, where it was found soon
_SLACK_NATS = 10.0  # maps that far below the best of their depth wait ...
_SLACK_PER_NOISE = 100.0  # ... and more by the noise of travels: then mistakes take longer to show
_REVISED = 4  # complete maps, of other places each, that are revised where travels slip
_REVISED_WORK = 60_000  # units of work for one revision at most, where travels slip
_REPAIRS = 16  # repairs of one depth carried out at a time
_PROMISE_NATS = 8.0  # ... if they promise a map that near the best one
_SWEPT = 0.5  # share of the budget for the fronts where travels slip; the rest is for revising
_PATIENCE = 3  # stretches looked back at in vain before the search ends
_LOOK_BACK_NATS = 10.0  # maps that much worse are grown where the favourite went wrong ...
_MOST_EXTRA_NATS = 30.0  # ... each time that is looked into, up to that
_LOOK_BACK_WORK = 600_000  # units of work after which a search looks back no more
_STRETCH = 250  # visits after which a long walk is looked back at, before the search goes on
_MOST_WORSE_NATS = 12.0  # a merger that makes a map so much worse on the way is given up
_ESTIMATED = (2, 4, 8, 16, 32, 64)  # visits known when the score is estimated anew
_DETOURS = 4  # maps grown for each visit at most to get to the end when the budget is spent


class TreeOfMaps:
    """The tree of possible maps, growing as visits arrive.

    Parameters
    ----------
    score : parameters of the log posterior; estimated from ``experience`` if not given.
    experience : visits to start with.
    order, planarity : which axioms to hold the maps to.

    Attributes
    ----------
    tree : the maps.
    expansions : maps grown.
    spent : the latest search ended because its budget was spent.

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
        self.spent = False
        self._reset(score)
        self._visits: list[Visit] = []
        for visit in self._experience.visits:
            self._add(visit)

    def _reset(self, score: Score) -> None:
        self.tree = MapTree(score, **self._keywords)
        self._fronts = Fronts()
        self._reached: list[bool] = []
        self._seen: set[object] = set()
        self._swept = [0] * len(_STAGES)
        self._extra: list[float] = []
        self._looked: dict[int, int] = {}
        self._look_from = 0
        self._merged_to = 0
        self._variance = 0.0
        self._repairs = RepairQueue()
        self.nogoods: dict[int, list[Nogood]] = {}
        self.expansions = 0

    @property
    def score(self) -> Score:
        """The parameters of the log posterior."""
        return self.tree.score

    def _add(self, visit: Visit) -> None:
        self._visits.append(visit)
        self._fronts.add_depth()
        self._reached.append(False)
        self._extra.append(0.0)
        if visit.displacement is not None:
            cov = visit.displacement.cov
            self._variance += (cov[0][0] + cov[1][1]) / 2
        for root in self.tree.add_visit(visit):
            self._fronts.wait(root)
            self._reached[0] = True

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
        if self._estimated and known in _ESTIMATED:
            visits = tuple(self._visits)
            self._reset(estimate_score(Experience(visits, slip=self._slip)))
            self._visits = []
            for one in visits:
                self._add(one)
        self._add(visit)

    # -- growing ---------------------------------------------------------------------------

    def _expand(self, node: Node) -> None:
        """Make the children of a map; the first time those worth it, the next time the rest."""
        tree, fronts = self.tree, self._fronts
        self.expansions += 1
        node.stage += 1
        options = list(tree.options(node, far=node.stage == 2, lean=node.stage < 3))
        best = -math.inf
        for option in options:
            if option.refusal is None:
                child = tree.child(node, option)
                best = max(best, child.score - node.score)
                if is_refuted(self.nogoods, child):
                    child.dead = True
                else:
                    fronts.wait(child)
        self._reached[node.visit + 1] |= best > -math.inf
        fixed = -1 if self.score.slip > 0 else tree.find_fixed(node)
        if node.stage == 1:
            for repair in propose_repairs(self.tree, node, options, best, fixed):
                self._repairs.add(repair)
        if best == -math.inf and fixed >= 0:
            self._learn(node)
        elif node.stage == 1 and fixed < 0:
            far = node.worth - math.log(self.score.area_m2) - GATE_NATS
            fronts.put_off(node, far, node.worth if self._has_lean(node) else far)
        elif node.stage == 2 and self._has_lean(node):
            fronts.put_off(node, node.worth, node.worth)
        fronts.settle(node)

    def _has_lean(self, node: Node) -> bool:
        """Return whether growing a map at first leaves ways out that are not far off."""
        return self.score.slip > 0 or len(self._visits[node.visit + 1].readings) > 1

    def _repair(self, depth: int, is_over: Callable[[], bool]) -> None:
        """Carry out the repairs that promise a map of a depth near the best one."""
        for _ in range(_REPAIRS):
            least = math.inf if is_over() else self._fronts.peak(depth) - _PROMISE_NATS
            repair = self._repairs.take(depth, least)
            if repair is None:
                return
            made = repair.carry_out(self.tree)
            chain = made.chain()
            if not any(c.dead or (not c.queued and is_refuted(self.nogoods, c)) for c in chain):
                self._fronts.wait(made)

    def _learn(self, node: Node) -> None:
        """Learn why a map cannot take its next visit; all maps with that mistake die."""
        nogood = learn_nogood(self._visits, [one.decision for one in node.chain()[1:]])
        if nogood is None:
            return
        self.nogoods.setdefault(nogood.latest, []).append(nogood)
        for one in self._fronts.list_living(nogood.latest):
            if nogood.holds_in([above.decision for above in one.chain()[1:]]):
                self._fronts.bury(one)

    # -- searching -------------------------------------------------------------------------

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
                    self._look_back(stage, goal, self._end_by(start + _LOOK_BACK_WORK, is_enough))
                    self._merge_doubles(goal, is_enough)
            found = self.lead
            if found is not None and (found is lead or is_enough()):
                return
            if found is not None and lead is None:
                end = self.tree.work + max(_AGAIN * (self.tree.work - start), _AGAIN_LEAST)
                is_enough = self._end_by(end, is_over)
            lead = found

    def _list_goals(self, stage: int) -> list[int]:
        """Return the visits at which to look back, evenly spread, the last among them."""
        start, last = self._swept[stage], len(self._visits) - 1
        count = max(1, round((last - start) / _STRETCH))
        return [start + (last - start) * (k + 1) // count for k in range(count)]

    def _find_lead(self, depth: int) -> Node | None:
        """Return the best map of the visits up to one; None if there is none."""
        return next(iter(self._fronts.list_best(depth, 1)), None)

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

    def _merge_doubles(self, goal: int, is_over: Callable[[], bool]) -> None:
        """Merge places that the best map holds twice; the maps made wait as leaves."""
        if goal < min(self._merged_to + _STRETCH // 2, len(self._visits) - 1):
            return
        self._merged_to = goal
        tried = set[tuple[int, int]]()
        lead = self._find_lead(goal)
        while lead is not None and not is_over():
            labels = [one.decision.place for one in lead.chain()[1:]]
            better = None
            for pair in find_doubles(self.tree, lead):
                firsts = labels.index(pair[0]), labels.index(pair[1])
                if firsts in tried or is_over():
                    continue
                tried.add(firsts)
                change = Change(("merge", *pair), merge_labels(labels, [pair]))
                made = thread_visits(
                    self.tree, lead, change, loose=True, most_worse=_MOST_WORSE_NATS
                )
                print("   merge",pair,firsts,None if made is None else round(made.score-lead.score,1))
                if made is not None and made.score > lead.score:
                    self._fronts.wait(made)
                    better = made
                    break
            lead = better

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

    def exhaust(self) -> tuple[Hypothesis, ...]:
        """Grow every map to the last visit and return all consistent ones, best first.

        For small experiences only: their number explodes.
        """
        last = len(self._visits) - 1
        while True:
            node = next(filter(None, map(self._fronts.take, range(last))), None)
            if node is not None:
                self._expand(node)
            elif not self._fronts.bring_back():
                nodes = self._fronts.list_best(last, self._fronts.living[last])
                return tuple(self.tree.hypothesis(node) for node in nodes)

    def best(self, k: int = 1) -> tuple[Hypothesis, ...]:
        """Return the k best maps of all visits so far, those differing in places or turns."""
        return self.tree.pick_maps(self._fronts.list_best(len(self._visits) - 1, 50 * k), k)

    @property
    def lead(self) -> Node | None:
        """The best map of all visits so far as a node of the tree; None if there is none."""
        return self._find_lead(len(self._visits) - 1)

    def reached(self, depth: int) -> bool:
        """Return whether some map has explained the visits up to one."""
        return self._reached[depth]

    def best_so_far(self, depth: int, k: int) -> tuple[Hypothesis, ...]:
        """Return the best maps of the visits up to one, whether they wait or were refuted."""
        found, todo = list[Node](), [self.tree.root]
        while todo:
            node = todo.pop()
            if node is not None and node.visit == depth:
                found.append(node)
            elif node is not None and node.children:
                todo.extend(child for child in node.children.values() if child.queued)
        return self.tree.pick_maps(sorted(found, key=lambda node: (-node.score, node.serial)), k)

    @property
    def leaves(self) -> int:
        """How many maps wait."""
        return self._fronts.count_leaves()

    def is_proven(self) -> bool:
        """Return whether no waiting map can beat the best complete one, whatever comes.

        The bound is safe: each travel still to come is credited with the density of an
        innovation as narrow as its displacement alone.
        """
        last = len(self._visits) - 1
        lead = self.lead
        if lead is None:
            return False
        top, ahead = lead.score, 0.0
        for depth in range(last - 1, -1, -1):
            ahead += self.tree.bound_visit(depth + 1)
            if self._fronts.bound(depth) + ahead > top + 1e-9:
                return False
        return True
