"""The tree of maps: its nodes, how one grows, and the states of those used last.

A node is one map after visits 0..v; its state is kept for the nodes used last and rebuilt from
an ancestor when needed.

Source: Beeson 2008, Algorithm 8.1; readings, doubts and scores: ours.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from hssh_kb.consistency import MapState
from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Visit
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.node import GATE_NATS, NOTHING, Decision, LeafState, Node, Option
from hssh_kb.place_filter import PlaceFilter
from hssh_kb.score import TERMS, Addends, Score
from hssh_kb.weigh_visits import VisitWeigher

_CACHE_BYTES = 320 * 2**20
_KEPT = 64  # of the states rebuilt on the way to one, one in so many is kept


class MapTree(VisitWeigher):
    """Visits, score and nodes of one tree of maps.

    Parameters
    ----------
    score : parameters of the log posterior.
    order, planarity : which axioms to hold the maps to.
    """

    def __init__(self, score: Score, *, order: bool = True, planarity: bool = True) -> None:
        super().__init__(score, order=order, planarity=planarity)
        self.root: Node | None = None
        self.made = 0
        self._cache: OrderedDict[int, tuple[Node, int]] = OrderedDict()
        self._cached_bytes = 0

    def add_visit(self, visit: Visit) -> list[Node]:
        """Take in one more visit; returns the new roots if it is the first, else nothing.

        Raises
        ------
        InputError : the visit lacks what a travel needs.
        """
        if self.note_visit(visit):
            return []
        first = Node(None, -1, Decision(-1, 0, 0, False), NOTHING, 0, 0)
        self.root = first
        first.children = {}
        first.queued = True
        roots = []
        for i, reading in enumerate(visit.readings):
            addends = Addends(0, 0, 0, math.log(reading.weight), 0, 0)
            roots.append(self.child(first, Option(Decision(0, 0, i, False), addends, None)))
        return roots

    def child(self, node: Node, option: Option) -> Node:
        """Return the child of a node by an option, made if it is not there yet."""
        if node.children is None:
            node.children = {}
        known = node.children.get(option.decision)
        if known is not None:
            return known
        self.made += 1
        places = node.places + (option.decision.place == node.places)
        made = Node(node, node.visit + 1, option.decision, option.addends, places, self.made)
        node.children[option.decision] = made
        return made

    def state_of(self, node: Node) -> LeafState:
        """Return the full state of a map, rebuilt from its nearest ancestor that has one."""
        if node.state is not None:
            if node.serial in self._cache:
                self._cache.move_to_end(node.serial)
            return node.state
        todo = [node]
        above = node.parent
        while above is not None and above.visit >= 0 and above.state is None:
            todo.append(above)
            above = above.parent
        state = above.state if above is not None and above.visit >= 0 else None
        for k, one in reversed(list(enumerate(todo))):
            state = self._start(one) if state is None else self.advance(state, one)
            if k % _KEPT == 0:
                self._keep(one, state)
        if state is None:
            raise InputError("the tree of maps has no visit yet")
        return state

    def release(self, node: Node) -> None:
        """Forget the state of a map that will hardly be asked for again."""
        kept = self._cache.pop(node.serial, None)
        if kept is not None:
            self._cached_bytes -= kept[1]
            node.state = None

    def _start(self, node: Node) -> LeafState:
        i = node.decision.reading
        star = self.visits[0].readings[i].star
        return LeafState(MapState.start(star), PlaceFilter.start(), 0, 0, i, (0,), (i,), (0j,))

    def _keep(self, node: Node, state: LeafState) -> None:
        above = node.parent.state if node.parent else None
        is_shared = above is not None and above.judge is state.judge
        size = state.filter.nbytes + 2000 + (0 if is_shared else 200 * len(state.judge.joined))
        node.state = state
        self._cache[node.serial] = node, size
        self._cached_bytes += size
        while self._cached_bytes > _CACHE_BYTES and len(self._cache) > 64:
            _, (old, freed) = self._cache.popitem(last=False)
            old.state = None
            self._cached_bytes -= freed

    def advance(self, state: LeafState, node: Node) -> LeafState:
        """Return the state of a map one visit further, by the decision of a node."""
        v, decision = node.visit, node.decision
        prediction = self.predict(state, v)
        place, offset, i, doubted = decision
        star = self.visits[v].readings[i].star
        new = place == len(state.firsts)
        self.work += 2 + len(state.filter.places) // 16
        judge, firsts, read = state.judge, state.firsts, state.place_readings
        bearings = state.bearings
        if new:
            judge = judge.add_place(star)
            firsts, read, bearings = (*firsts, v), (*read, i), (*bearings, 0j)
            filter_ = prediction.found_place()
        else:
            turn, noise = self.find_closure_noise(state, prediction, v, decision)
            filter_ = prediction.close(place, turn, noise)
        depart = self.leave(state, v)
        if not doubted and depart is not None:
            enter = self.enter(v, decision)
            told = self.tell_bearings(state, v, depart, enter, len(star))
            if told is not None:
                seen = list(bearings)
                seen[state.place] += told[0]
                seen[place] += told[1]
                bearings = tuple(seen)
            judge = judge.join(state.place, depart, place, enter, v)
        doubts = state.doubts + doubted
        return LeafState(judge, filter_, place, offset, i, firsts, read, bearings, doubts)

    def options(self, node: Node, *, far: bool = False, lean: bool = False) -> Iterator[Option]:
        """Yield every way to take the visit after a node, refused ones with their refusal.

        Parameters
        ----------
        node : a map.
        far : yield the closures outside the gate instead of the rest.
        lean : leave out ways that are worse at once and matter only after a later clash: new
            places by another than the best reading, doubts of a travel nothing speaks against.
        """
        state, v = self.state_of(node), node.visit + 1
        prediction = self.predict(state, v)
        depart = self.leave(state, v)
        forced = None if depart is None else state.judge.follow(state.place, depart)
        gate = -math.log(self.score.area_m2) - GATE_NATS
        held = prediction.filter.places
        near = {*held[self.score.expect_closures(prediction) > gate].tolist()}
        if forced:
            near.add(forced[0])
        if not far:
            yield from self.weigh_new_places(state, prediction, v, depart, forced is not None, lean)
        for place in range(len(state.firsts)) if far else sorted(near):
            if (place in near) != far:
                yield from self.weigh_closures(state, prediction, v, depart, place, lean)

    def find_place_under(self, node: Node) -> tuple[int, float]:
        """Return the place that the next visit most likely lies on, going by displacement alone.

        Returns
        -------
        place, worth : number of the place, -1 if the displacement calls for none; what a closure
            there adds to the log posterior, outliers aside.
        """
        prediction = self.predict(self.state_of(node), node.visit + 1)
        held = prediction.filter.places
        if prediction.unknown or not len(held):
            return -1, -math.inf
        worth = self.score.expect_closures(prediction)
        slot = int(np.argmax(worth))
        return int(held[slot]), float(worth[slot])

    def find_fixed(self, node: Node) -> int:
        """Return the only place that travel allows for the visit after a map, -1 if any may be."""
        state = self.state_of(node)
        depart = self.leave(state, node.visit + 1)
        known = None if depart is None else state.judge.follow(state.place, depart)
        return -1 if known is None else known[0]

    def weigh(self, node: Node, decision: Decision) -> Option | None:
        """Return one way to take the visit after a node; None if the stars do not match."""
        state, v = self.state_of(node), node.visit + 1
        prediction = self.predict(state, v)
        depart = self.leave(state, v)
        if decision.place == len(state.firsts):
            taken = depart is not None and state.judge.follow(state.place, depart) is not None
            for option in self.weigh_new_places(state, prediction, v, depart, taken, False):
                if option.decision == decision:
                    return option
            return None
        first, read_as = state.firsts[decision.place], state.place_readings[decision.place]
        if decision.offset not in self.isomorphisms(v, decision.reading, first, read_as):
            return None
        refusal = None if decision.doubted else self.judge(state, depart, decision, v)
        return Option(decision, self.weigh_closure(state, prediction, v, depart, decision), refusal)

    def hypothesis(self, node: Node) -> Hypothesis:
        """Return a map in plain form, with its score."""
        chain = node.chain()[1:]
        firsts: list[int] = []
        visits, offsets, readings, doubted = [], [], [], []
        sums = [0.0] * len(TERMS)
        for one in chain:
            place, offset, reading, doubt = one.decision
            if place == len(firsts):
                firsts.append(one.visit)
            visits.append(firsts[place])
            offsets.append(offset)
            readings.append(reading)
            if doubt:
                doubted.append(one.visit)
            for k, value in enumerate(one.addends):
                sums[k] += value
        return Hypothesis(
            tuple(visits),
            tuple(offsets),
            tuple(readings) if any(readings) else (),
            node.score,
            dict(zip(TERMS, sums, strict=True)),
            tuple(doubted),
        )

    def pick_maps(self, nodes: Iterable[Node], count: int) -> tuple[Hypothesis, ...]:
        """Return the first maps of some nodes that differ in places or turns."""
        found: dict[object, Hypothesis] = {}
        for node in nodes:
            one = self.hypothesis(node)
            found.setdefault((one.visits, one.offsets), one)
            if len(found) == count:
                break
        return tuple(found.values())


def score_hypothesis(experience: Experience, hypothesis: Hypothesis, score: Score) -> Hypothesis:
    """Return a hypothesis with ``log_posterior`` and ``terms`` under a score.

    Raises
    ------
    InputError : the hypothesis does not fit the experience (visits, readings or offsets).

    Source
    ------
    Ours.
    """
    tree, node = grow_hypothesis(experience, hypothesis, score, order=False, planarity=False)
    found = tree.hypothesis(node)
    return replace(hypothesis, log_posterior=found.log_posterior, terms=found.terms)


def grow_hypothesis(
    experience: Experience,
    hypothesis: Hypothesis,
    score: Score,
    *,
    order: bool = True,
    planarity: bool = True,
) -> tuple[MapTree, Node]:
    """Return a tree that holds one map only, and its node; what the axioms refuse is kept.

    Parameters
    ----------
    experience, hypothesis : the map, and the visits it is of (it may lack the latest ones).
    score : parameters of the log posterior.
    order, planarity : the axioms by which later visits are judged.

    Raises
    ------
    InputError : the hypothesis does not fit the experience (visits, readings or offsets).
    """
    tree = MapTree(score, order=order, planarity=planarity)
    node: Node | None = None
    number: dict[int, int] = {}
    for v, first in enumerate(hypothesis.visits):
        roots = tree.add_visit(experience.visits[v])
        reading = hypothesis.readings[v] if hypothesis.readings else 0
        place = number.setdefault(first, len(number))
        decision = Decision(place, hypothesis.offsets[v], reading, v in hypothesis.doubted)
        if node is None:
            node = roots[reading]
            continue
        option = tree.weigh(node, decision)
        if option is None:
            raise InputError(f"hypothesis: visit {v} does not match the star of place {first}")
        node = tree.child(node, option._replace(refusal=None))
    if node is None:
        raise InputError("hypothesis: has no visits")
    return tree, node
