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

import math

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Visit
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.leaf_queues import LeafQueues
from hssh_kb.map_tree import MapTree
from hssh_kb.node import GATE_NATS, Node
from hssh_kb.repair import Repair, propose_repairs
from hssh_kb.revise import revise_map
from hssh_kb.score import Score, estimate_score
from hssh_kb.search_budget import Budget

_STUCK = 24  # expansions without getting deeper, before the depths are tried in turn
_WINDOW = 16  # depths tried in turn at first; doubled each time that is in vain
_SLACK_NATS = 24.0  # leaves that much below the best of their depth are not worth a turn
_SURPRISE_NATS = 1.5  # what the favourite may pay beyond a new place before others get a turn
_REVISED_WORK = 60_000  # units of work for one revision at most, where travels slip
_REVISED_LITTLE = 5_000  # ... where they do not, and best-first search seldom errs
_HURRY = 0.4  # share of the budget after which the best map is taken to the end as it is
_COMPLETED = 8  # maps taken to the end when the budget is spent
_REGRET_NATS = 8.0  # a best map this close to the highest hopes needs little doubt
_DESPAIR_NATS = 60.0  # a best map this far below them was most likely met by chance
_LAST_CYCLES = 24  # cycles in vain that such a map is given more, where travels do not slip


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
        visits = list(self._experience.visits)
        self._visits: list[Visit] = []
        for visit in visits:
            self._add(visit)

    def _reset(self, score: Score) -> None:
        self.tree = MapTree(score, **self._keywords)
        self._queues = LeafQueues()
        self._reached: list[bool] = []
        self._reserve: list[Node] = []
        self._seen: set[object] = set()
        self._deepest = 0
        self._stale = 0
        self._window = _WINDOW
        self._surprise = 0.0
        self.expansions = 0

    @property
    def score(self) -> Score:
        """The parameters of the log posterior."""
        return self.tree.score

    def _add(self, visit: Visit) -> None:
        self._visits.append(visit)
        self._queues.add_depth()
        self._reached.append(False)
        for root in self.tree.add_visit(visit):
            self._queues.queue_chain(root)
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
        if self._estimated and known in (2, 4, 8, 16):
            visits = tuple(self._visits)
            self._reset(estimate_score(Experience(visits, slip=self._slip)))
            self._visits = []
            for one in visits:
                self._add(one)
        self._add(visit)

    # -- growing ---------------------------------------------------------------------------

    def _grow_at(self, depth: int) -> None:
        item = self._queues.pop(depth)
        if isinstance(item, Repair):
            # Every map on the way to the repaired one is a leaf that other maps may grow from.
            self._queues.queue_chain(item.carry_out(self.tree))
        else:
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
                self._queues.queue_chain(child)
                best = max(best, child.score - node.score)
        if node.stage == 1:
            new = self.score.place_prior - math.log(self.score.area_m2)
            if best > -math.inf:
                # A new place that nothing speaks against is the least a rival may hope for.
                self._queues.raise_hope(depth + 1, max(best, new), self._reached[depth + 1])
            self._queues.push(depth, node.score + new - GATE_NATS, node)
            for repair in propose_repairs(tree, node, options, best):
                if repair.key not in self._seen:
                    self._seen.add(repair.key)
                    self._queues.push(depth + 1, repair.estimate, repair)
        elif node.stage == 2 and self._has_rest(node):
            self._reserve.append(node)
        self._stale += 1
        if best > -math.inf:
            self._reached[depth + 1] = True
            if depth + 1 > self._deepest:
                self._deepest, self._stale = depth + 1, 0
                new = self.score.place_prior - math.log(self.score.area_m2)
                self._surprise += max(new - best - _SURPRISE_NATS / 8, 0.0)

    def _has_rest(self, node: Node) -> bool:
        return self.score.slip > 0 or len(self._visits[node.visit + 1].readings) > 1

    def _open_reserve(self) -> bool:
        """Bring back the maps whose improbable children were put off; False if there are none."""
        opened, self._reserve = self._reserve, []
        for node in opened:
            self._queues.push(node.visit, node.score, node)
        return bool(opened)

    # -- searching -------------------------------------------------------------------------

    def search(
        self,
        *,
        budget_s: float | None = None,
        budget_work: float | None = None,
        patience: int | None = None,
    ) -> None:
        """Grow maps until the best complete ones are found or the budget is spent.

        Where travels may slip, there always is a complete map: when the budget is spent before
        one was met, the best maps of the most visits are taken to the end greedily.

        Parameters
        ----------
        budget_s : seconds of wall time; None for no limit.
        budget_work : units of work, the same on every machine; None for no limit.
        patience : how many cycles in vain to spend on rivals of the best complete map, each
            reaching twice as far back as the one before; None for as many as its regret
            against the highest hopes calls for. While visits arrive one by one, 0 or 1 is
            quick, and later visits make up for what was missed.
        """
        last = len(self._visits) - 1
        if last < 1:
            return
        budget = Budget(lambda: self.tree.work, budget_work, budget_s)
        self._stale, self._window = 0, _WINDOW
        self._grow_all(budget, patience)
        if not self._has_complete() and self.score.slip > 0:
            self._dive(_COMPLETED)
        if self._has_complete() and self._is_doubtful(self._queues.choose_depth()[1]):
            self._revise(last, budget, 4)
        self.spent = budget.is_spent()

    def _grow_all(self, budget: Budget, patience: int | None) -> None:
        """Grow maps until no rival of the best complete one is worth it."""
        last, idle = len(self._visits) - 1, 0
        while not budget.is_spent():
            depth, prospect = self._queues.choose_depth()
            if prospect == -math.inf:
                if self._has_complete() or not self._open_reserve():
                    return
            elif self._has_complete():
                if idle == 0 and self._is_doubtful(prospect):
                    self._revise(last, budget)
                if idle >= (self._count_cycles(prospect) if patience is None else patience):
                    return
                idle = 0 if self._run_cycle(budget) else idle + 1
            elif self._stale <= _STUCK and self._surprise < _SURPRISE_NATS:
                self._grow_at(depth)
            elif budget.is_spent(_HURRY) or self._is_lost():
                self._revise(self._deepest, budget)
                self._dive()
            else:
                self._run_cycle(budget)

    def _has_complete(self) -> bool:
        return self._queues.has_items(len(self._visits) - 1)

    def _is_lost(self) -> bool:
        """Return whether to take the best map to the end as it is, to be revised as a whole."""
        return self.score.slip > 0 and self._window > 4 * _WINDOW

    def _count_cycles(self, prospect: float) -> int:
        """Return how many cycles in vain it takes to believe that the best map is found."""
        whole = int(math.log2(max(len(self._visits) / _WINDOW, 1))) + 1
        if self.score.slip == 0 and prospect - float(self._queues.tops[-1]) >= _DESPAIR_NATS:
            return whole + _LAST_CYCLES
        return whole + 3 if self._is_doubtful(prospect) else whole

    def _is_doubtful(self, prospect: float) -> bool:
        """Return whether the best complete map falls short of the highest hopes by far."""
        regret = prospect - float(self._queues.tops[-1])
        return self.score.slip > 0 or regret >= _REGRET_NATS

    def _run_cycle(self, budget: Budget) -> bool:
        """Grow the best leaf of each of the deepest depths in turn, and the best of all.

        Maps are then compared with others that have explained the same visits. Returns whether
        that got deeper, or a better complete map; if not, the next cycle reaches further back.
        """
        queues, last = self._queues, len(self._visits) - 1
        self._surprise = 0.0
        before = self._deepest, float(queues.tops[last])
        depth = max(0, self._deepest - self._window)
        while depth < min(self._deepest + 1, last) and not budget.is_spent():
            if queues.tops[depth] > queues.peaks[depth] - _SLACK_NATS:
                self._grow_at(depth)
            depth += 1
        if not budget.is_spent():
            depth, prospect = queues.choose_depth()
            if prospect > -math.inf:
                self._grow_at(depth)
        if (self._deepest, float(queues.tops[last])) > before:
            self._window = max(_WINDOW, self._window // 2)
            return True
        self._window = min(2 * self._window, max(last, _WINDOW))
        if self.score.slip > 0 and not self._has_complete():
            self._revise(self._deepest, budget)
        return False

    def _dive(self, count: int = 1) -> None:
        """Grow the best of the deepest maps, and always its best child, to the last visit."""
        for leaf in self._queues.list_best(self._deepest, count):
            node: Node | None = leaf
            while node is not None and node.visit < len(self._visits) - 1:
                if node.stage == 0:
                    self._expand(node)
                grown = list((node.children or {}).values())
                node = max(grown, key=lambda child: child.score, default=None)
        self._stale = 0

    def _revise(self, depth: int, budget: Budget, count: int = 1) -> None:
        """Revise the best maps of a depth as a whole; whatever that makes waits as a leaf."""
        partitions: set[tuple[int, ...]] = set()
        work = count * (_REVISED_WORK if self.score.slip else _REVISED_LITTLE)
        is_over = budget.allot(work)
        for node in self._queues.list_best(depth, 40 * count):
            partition = tuple(one.decision.place for one in node.chain())
            if partition not in partitions:
                partitions.add(partition)
                for better in revise_map(self.tree, node, is_over, self._seen):
                    self._queues.queue_chain(better)
            if len(partitions) == count:
                break

    def exhaust(self) -> tuple[Hypothesis, ...]:
        """Grow every map to the last visit and return all consistent ones, best first.

        For small experiences only: their number explodes.
        """
        last = len(self._visits) - 1
        while True:
            depth, prospect = self._queues.choose_depth()
            if prospect > -math.inf:
                self._grow_at(depth)
            elif not self._open_reserve():
                nodes = self._queues.list_best(last, len(self._queues))
                return tuple(self.tree.hypothesis(node) for node in nodes)

    def best(self, k: int = 1) -> tuple[Hypothesis, ...]:
        """Return the k best maps of all visits so far, those differing in places or turns."""
        return self._best_at(len(self._visits) - 1, k)

    def _best_at(self, depth: int, k: int) -> tuple[Hypothesis, ...]:
        return self._pick_maps(self._queues.list_best(depth, 50 * k), k)

    def _pick_maps(self, nodes: list[Node], k: int) -> tuple[Hypothesis, ...]:
        """Return the first k maps that differ in places or turns."""
        out: list[Hypothesis] = []
        known: set[object] = set()
        for node in nodes:
            found = self.tree.hypothesis(node)
            key = found.visits, found.offsets
            if key not in known:
                known.add(key)
                out.append(found)
            if len(out) == k:
                break
        return tuple(out)

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
        return self._pick_maps(sorted(found, key=lambda node: (-node.score, node.serial)), k)

    @property
    def leaves(self) -> int:
        """How many maps wait."""
        return len(self._queues)

    def is_proven(self) -> bool:
        """Return whether no waiting map can beat the best complete one, whatever comes.

        The bound is safe: each travel still to come is credited with the density of an
        innovation as narrow as its displacement alone.
        """
        last = len(self._visits) - 1
        if not self._has_complete():
            return False
        top = float(self._queues.tops[last])
        ahead = 0.0
        for depth in range(last - 1, -1, -1):
            move = self._visits[depth + 1].displacement
            weights = [math.log(r.weight) for r in self._visits[depth + 1].readings]
            ahead += max(weights) + self.score.bound_travel(None if move is None else move.cov)
            if self._queues.tops[depth] + ahead > top + 1e-9:
                return False
        return not self._reserve
