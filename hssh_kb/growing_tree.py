"""The tree of possible maps, growing as visits arrive; how it is searched is told elsewhere.

When a visit refutes a map, the reason is learned: a set of closures that cannot stand together
(:mod:`hssh_kb.nogoods`). All maps that hold it die at once, at whatever depth they wait. No
consistent map is ever dropped, only left waiting.

Source: Beeson 2008, section 8.2; lazy evaluation after Johnson's tree of maps; the learning is
ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Visit
from hssh_kb.fronts import Fronts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.map_tree import MapTree
from hssh_kb.node import GATE_NATS, Node
from hssh_kb.nogoods import Nogood, is_refuted, learn_nogood
from hssh_kb.repair import RepairQueue, propose_repairs
from hssh_kb.score import Score, estimate_score

_REPAIRS = 16  # repairs of one depth carried out at a time
_PROMISE_NATS = 8.0  # ... if they promise a map that near the best one
_ESTIMATED = (2, 4, 8, 16, 32, 64)  # visits known when the score is estimated anew


class GrowingTree:
    """The tree of possible maps, growing as visits arrive.

    Parameters
    ----------
    score : parameters of the log posterior; estimated from ``experience`` if not given.
    experience : visits to start with.
    order, planarity : which axioms to hold the maps to.

    Attributes
    ----------
    tree : the maps.
    nogoods : what was learned of closures that cannot stand together, by the latest visit.
    expansions : maps grown.

    Source
    ------
    Beeson 2008, Algorithm 8.1.
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
        self._visits: list[Visit] = []
        for visit in self._experience.visits:
            self._add(visit)

    def _reset(self, score: Score) -> None:
        self.tree = MapTree(score, **self._keywords)
        self._fronts = Fronts()
        self._reached: list[bool] = []
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

    def _find_lead(self, depth: int) -> Node | None:
        """Return the best map of the visits up to one; None if there is none."""
        return next(iter(self._fronts.list_best(depth, 1)), None)

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
