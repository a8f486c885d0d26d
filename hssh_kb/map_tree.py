"""The nodes of the tree of maps, and how one grows: every way to take the next visit.

A node is one map after visits 0..v. It knows its parent and its own decision; the full state of
the map (judge and filter) is kept for the nodes used last and rebuilt from an ancestor when
needed.

Source: Beeson 2008, Algorithm 8.1; readings, doubts and scores: ours.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from hssh_kb.consistency import MapState, Refusal, check_star
from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Reading, Visit
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.place_filter import PlaceFilter, Prediction
from hssh_kb.score import TERMS, Addends, Score

GATE_NATS = 14.0
_CACHE_BYTES = 192 * 2**20
_NOTHING = Addends(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Decision(NamedTuple):
    """How one visit is taken: as which place, turned how, read how, its travel doubted or not.

    Attributes
    ----------
    place : number of the place; the number of places so far for a new one.
    offset : dlp k of the visit is dlp (k + offset) mod m of the place.
    reading : index of the reading of the visit.
    doubted : the travel to the visit asserts nothing.
    """

    place: int
    offset: int
    reading: int
    doubted: bool


@dataclass(slots=True)
class LeafState:
    """Everything one map says, for growing it; never changed once made."""

    judge: MapState
    filter: PlaceFilter
    place: int
    offset: int
    reading: int
    firsts: tuple[int, ...]
    place_readings: tuple[int, ...]
    bearings: tuple[complex, ...]
    prediction: Prediction | None = None
    newness: tuple[float, float] | None = None


class Node:
    """One map after visits 0..v."""

    __slots__ = (
        "addends",
        "children",
        "decision",
        "parent",
        "places",
        "queued",
        "score",
        "serial",
        "stage",
        "state",
        "visit",
    )

    def __init__(
        self,
        parent: Node | None,
        visit: int,
        decision: Decision,
        addends: Addends,
        places: int,
        serial: int,
    ) -> None:
        self.parent, self.visit, self.decision = parent, visit, decision
        self.addends, self.places, self.serial = addends, places, serial
        self.score: float = (parent.score if parent else 0.0) + sum(addends)
        self.stage = 0
        self.queued = False
        self.state: LeafState | None = None
        self.children: dict[Decision, Node] | None = None

    @property
    def is_new(self) -> bool:
        """Whether the latest visit is the first to its place."""
        return self.parent is not None and self.decision.place == self.parent.places

    def chain(self) -> list[Node]:
        """Return the nodes from the root to this one."""
        out: list[Node] = []
        node: Node | None = self
        while node is not None:
            out.append(node)
            node = node.parent
        return out[::-1]


class Option(NamedTuple):
    """One way to take the next visit, with what it adds, or why the axioms refuse it."""

    decision: Decision
    addends: Addends
    refusal: Refusal | None


class MapTree:
    """Visits, score and nodes of one tree of maps.

    Parameters
    ----------
    score : parameters of the log posterior.
    order, planarity : which axioms to hold the maps to.

    Attributes
    ----------
    work : units of work done so far; see :mod:`hssh_kb.search_budget`.
    """

    def __init__(self, score: Score, *, order: bool = True, planarity: bool = True) -> None:
        self.score: Score = score
        self.order, self.planarity = order, planarity
        self.visits: list[Visit] = []
        self.root: Node | None = None
        self.made = self.work = 0
        self._shapes: list[tuple[int, ...]] = []
        self._shape_of: dict[tuple[tuple[int, ...], tuple[int, ...]], int] = {}
        self._turns: dict[tuple[int, int], tuple[int, ...]] = {}
        self._cache: OrderedDict[int, tuple[Node, int]] = OrderedDict()
        self._cached_bytes = 0
        self._matches: dict[tuple[int, int, int, int, int], tuple[float, float, float]] = {}

    def add_visit(self, visit: Visit) -> list[Node]:
        """Take in one more visit; returns the new roots if it is the first, else nothing.

        Raises
        ------
        InputError : the visit lacks what a travel needs.
        """
        v = len(self.visits)
        for reading in visit.readings:
            check_star(reading)
            if v and reading.arrive is None:
                raise InputError(f"visit {v}: lacks 'arrive', the dlp faced on arrival")
        self.visits.append(visit)
        self._shapes.append(tuple(map(self._name_shape, visit.readings)))
        if v:
            return []
        first = Node(None, -1, Decision(-1, 0, 0, False), _NOTHING, 0, 0)
        self.root = first
        first.children = {}
        first.queued = True
        roots = []
        for i, reading in enumerate(visit.readings):
            addends = Addends(0, 0, 0, math.log(reading.weight), 0, 0)
            roots.append(self.child(first, Option(Decision(0, 0, i, False), addends, None)))
        return roots

    def _name_shape(self, reading: Reading) -> int:
        star = reading.star
        return self._shape_of.setdefault((star.alpha, star.opposites), len(self._shape_of))

    def isomorphisms(self, visit: int, reading: int, first: int, other: int) -> tuple[int, ...]:
        """Return every offset that lines up a reading of a visit with one of a first visit."""
        key = self._shapes[visit][reading], self._shapes[first][other]
        turns = self._turns.get(key)
        if turns is None:
            mine = self.visits[visit].readings[reading].star
            turns = mine.isomorphisms(self.visits[first].readings[other].star)
            self._turns[key] = turns
        return turns

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
        for one in reversed(todo):
            state = self._start(one) if state is None else self.advance(state, one)
            self._keep(one, state)
        if state is None:
            raise InputError("the tree of maps has no visit yet")
        return state

    def _start(self, node: Node) -> LeafState:
        i = node.decision.reading
        star = self.visits[0].readings[i].star
        return LeafState(MapState.start(star), PlaceFilter.start(), 0, 0, i, (0,), (i,), (0j,))

    def _keep(self, node: Node, state: LeafState) -> None:
        size = state.filter.cov.nbytes + 200 * len(state.judge.joined) + 2000
        node.state = state
        self._cache[node.serial] = node, size
        self._cached_bytes += size
        while self._cached_bytes > _CACHE_BYTES and len(self._cache) > 64:
            _, (old, freed) = self._cache.popitem(last=False)
            old.state = None
            self._cached_bytes -= freed

    def predict(self, state: LeafState, visit: int) -> Prediction:
        """Return where the next visit should be, after a map."""
        if state.prediction is None:
            self.work += 1 + len(state.firsts) // 50
            move = self.visits[visit].displacement
            state.prediction = state.filter.predict(move, self.score.length_m)
        return state.prediction

    def leave(self, state: LeafState, visit: int) -> int | None:
        """Return the index, in its place's star, of the dlp that leads to a visit."""
        reading = self.visits[visit - 1].readings[state.reading]
        if reading.depart is None:
            return None
        return (reading.depart + state.offset) % len(reading.star)

    def enter(self, visit: int, decision: Decision) -> int:
        """Return the index, in its place's star, of the dlp of the gateway come in by."""
        reading = self.visits[visit].readings[decision.reading]
        if reading.arrive is None:
            raise InputError(f"visit {visit}: lacks 'arrive', the dlp faced on arrival")
        return (reading.star.opposite(reading.arrive) + decision.offset) % len(reading.star)

    def advance(self, state: LeafState, node: Node) -> LeafState:
        """Return the state of a map one visit further, by the decision of a node."""
        v, decision = node.visit, node.decision
        prediction = self.predict(state, v)
        place, offset, i, doubted = decision
        star = self.visits[v].readings[i].star
        new = place == len(state.firsts)
        self.work += 2 + len(state.firsts) ** 2 // 1000
        judge, firsts, read = state.judge, state.firsts, state.place_readings
        bearings = state.bearings
        if new:
            judge = judge.add_place(star)
            firsts, read, bearings = (*firsts, v), (*read, i), (*bearings, 0j)
            filter_ = prediction.found_place()
        else:
            turn, noise = self._closure_noise(state, prediction, v, decision)
            filter_ = prediction.close(place, turn, noise)
        depart = self.leave(state, v)
        if not doubted and depart is not None:
            enter = self.enter(v, decision)
            told = self._tell_bearings(state, v, depart, enter, len(star))
            if told is not None:
                seen = list(bearings)
                seen[state.place] += told[0]
                seen[place] += told[1]
                bearings = tuple(seen)
            judge = judge.join(state.place, depart, place, enter, v)
        return LeafState(judge, filter_, place, offset, i, firsts, read, bearings)

    def _closure_noise(
        self, state: LeafState, prediction: Prediction, v: int, decision: Decision
    ) -> tuple[float, tuple[float, float, float]]:
        turn, var, _ = self._match(state, v, decision)
        innovation = prediction.measure(decision.place, turn)
        return turn, self.score.weigh_closure(prediction, innovation, var)[2]

    def _match(self, state: LeafState, v: int, decision: Decision) -> tuple[float, float, float]:
        first, read = state.firsts[decision.place], state.place_readings[decision.place]
        key = v, decision.reading, first, read, decision.offset
        known = self._matches.get(key)
        if known is None:
            reading = self.visits[v].readings[decision.reading]
            known = self._matches[key] = self.score.match_headings(
                self.visits[first].readings[read].headings,
                reading.headings,
                decision.offset,
                reading.star.alpha,
            )
        return known

    def _tell_bearings(
        self, state: LeafState, v: int, depart: int, enter: int, size: int
    ) -> tuple[complex, complex] | None:
        """Return what a travel tells of the direction of the stars at its two ends."""
        move = self.visits[v].displacement
        if move is None or self.visits[v].readings[0].headings or not (move.x or move.y):
            return None
        way = float(state.filter.mean[0, 2]) + math.atan2(move.y, move.x)
        before = len(self.visits[v - 1].readings[state.reading].star)
        out = way + 2 * math.pi * depart / before
        back = way + math.pi + 2 * math.pi * enter / size
        return complex(math.cos(out), math.sin(out)), complex(math.cos(back), math.sin(back))

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
        near = (self.score.expect_closures(prediction) > gate).tolist()
        fixed = forced[0] if forced else -1
        if not far:
            yield from self._new_places(state, prediction, v, depart, forced is not None, lean)
        for place in range(len(state.firsts)):
            if (near[place] or place == fixed) != far:
                yield from self._closures(state, prediction, v, depart, place, lean)

    def _price(self, reading_weight: float, doubted: bool) -> tuple[float, float]:
        slip = self.score.slip
        doubts = (math.log(slip) if doubted else math.log1p(-slip)) if slip else 0.0
        return math.log(reading_weight), doubts

    def _new_places(
        self,
        state: LeafState,
        prediction: Prediction,
        v: int,
        depart: int | None,
        taken: bool,
        lean: bool,
    ) -> Iterator[Option]:
        self.work += 1
        if state.newness is None:
            state.newness = self.score.weigh_new(prediction)
        layout, exclusion = state.newness
        place = len(state.firsts)
        for i, reading in enumerate(self.visits[v].readings):
            if lean and i:
                break
            decision = Decision(place, 0, i, False)
            heading = self._weigh_bearings(state, v, depart, decision)
            read, doubts = self._price(reading.weight, False)
            refusal = None
            if taken and depart is not None:
                stands = state.judge.find_travel(state.place, depart)
                refusal = Refusal("travel_function", (stands,))
            prior = self.score.place_prior
            yield Option(
                decision, Addends(layout, heading, exclusion, read, prior, doubts), refusal
            )
            if self.score.slip and (refusal is not None or not lean):
                doubts = self._price(1.0, True)[1]
                yield Option(
                    replace_doubt(decision),
                    Addends(layout, 0.0, exclusion, read, prior, doubts),
                    None,
                )

    def _closures(
        self,
        state: LeafState,
        prediction: Prediction,
        v: int,
        depart: int | None,
        place: int,
        lean: bool,
    ) -> Iterator[Option]:
        first, read_as = state.firsts[place], state.place_readings[place]
        for i in range(len(self.visits[v].readings)):
            turns = self.isomorphisms(v, i, first, read_as)
            for offset in turns:
                decision = Decision(place, offset, i, False)
                refusal = self._judge(state, depart, decision, v)
                if refusal is not None and not self.score.slip:
                    yield Option(decision, _NOTHING, refusal)
                    continue
                weighed = self._weigh_closure(state, prediction, v, depart, decision)
                yield Option(decision, weighed, refusal)
                if self.score.slip and (refusal is not None or not lean):
                    doubted = replace_doubt(decision)
                    weighed = self._weigh_closure(state, prediction, v, depart, doubted)
                    yield Option(doubted, weighed, None)

    def _judge(
        self, state: LeafState, depart: int | None, decision: Decision, v: int
    ) -> Refusal | None:
        if depart is None:
            return None
        return state.judge.find_refusal(
            state.place,
            depart,
            decision.place,
            self.enter(v, decision),
            order=self.order,
            planarity=self.planarity,
        )

    def _weigh_closure(
        self,
        state: LeafState,
        prediction: Prediction,
        v: int,
        depart: int | None,
        decision: Decision,
    ) -> Addends:
        self.work += 1
        turn, var, misfit = self._match(state, v, decision)
        innovation = prediction.measure(decision.place, turn)
        layout, heading, _ = self.score.weigh_closure(prediction, innovation, var)
        heading += misfit
        if not decision.doubted:
            heading += self._weigh_bearings(state, v, depart, decision)
        reading = self.visits[v].readings[decision.reading]
        read, doubts = self._price(reading.weight, decision.doubted)
        return Addends(layout, heading, 0.0, read, 0.0, doubts)

    def _weigh_bearings(
        self, state: LeafState, v: int, depart: int | None, decision: Decision
    ) -> float:
        if depart is None:
            return 0.0
        size = len(self.visits[v].readings[decision.reading].star)
        told = self._tell_bearings(state, v, depart, self.enter(v, decision), size)
        if told is None:
            return 0.0
        weight = self.score.weigh_bearing(state.bearings[state.place], told[0])
        if decision.place < len(state.bearings):
            weight += self.score.weigh_bearing(state.bearings[decision.place], told[1])
        return weight

    def weigh(self, node: Node, decision: Decision) -> Option | None:
        """Return one way to take the visit after a node; None if the stars do not match."""
        state, v = self.state_of(node), node.visit + 1
        prediction = self.predict(state, v)
        depart = self.leave(state, v)
        if decision.place == len(state.firsts):
            taken = depart is not None and state.judge.follow(state.place, depart) is not None
            for option in self._new_places(state, prediction, v, depart, taken, False):
                if option.decision == decision:
                    return option
            return None
        first, read_as = state.firsts[decision.place], state.place_readings[decision.place]
        if decision.offset not in self.isomorphisms(v, decision.reading, first, read_as):
            return None
        refusal = None if decision.doubted else self._judge(state, depart, decision, v)
        return Option(
            decision, self._weigh_closure(state, prediction, v, depart, decision), refusal
        )

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


def replace_doubt(decision: Decision) -> Decision:
    """Return the decision with its travel doubted."""
    return decision._replace(doubted=True)


def score_hypothesis(experience: Experience, hypothesis: Hypothesis, score: Score) -> Hypothesis:
    """Return a hypothesis with ``log_posterior`` and ``terms`` under a score.

    Raises
    ------
    InputError : the hypothesis does not fit the experience (visits, readings or offsets).

    Source
    ------
    Ours.
    """
    tree = MapTree(score, order=False, planarity=False)
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
    found = tree.hypothesis(node)
    return replace(hypothesis, log_posterior=found.log_posterior, terms=found.terms)
