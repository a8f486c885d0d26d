"""Every way a map may take its next visit, weighed and judged.

Source: Beeson 2008, Algorithm 8.1; readings, doubts and scores: ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from hssh_kb.consistency import Refusal, check_star
from hssh_kb.errors import InputError
from hssh_kb.experience import Reading, Visit
from hssh_kb.node import NOTHING, Decision, LeafState, Option, replace_doubt
from hssh_kb.place_filter import Prediction
from hssh_kb.score import Addends, Score
from hssh_kb.travel_prior import Told, find_heading

_WINDOW_WORK = 1_000  # units of work that another window of places costs


class VisitWeigher:
    """The visits and the score; tells what a way to take a visit is worth, and if it can stand.

    Parameters
    ----------
    score : parameters of the log posterior.
    order, planarity : which axioms to hold the maps to.

    Attributes
    ----------
    visits : the visits so far.
    has_alternatives : some visit has more than one reading.
    work : units of work done so far; see :mod:`hssh_kb.search_budget`.

    Source
    ------
    Ours.
    """

    def __init__(self, score: Score, *, order: bool = True, planarity: bool = True) -> None:
        self.score: Score = score
        self.order, self.planarity = order, planarity
        self.visits: list[Visit] = []
        self.has_alternatives = False
        self.work = 0
        self._shapes: list[tuple[int, ...]] = []
        self._shape_of: dict[tuple[tuple[int, ...], tuple[int, ...]], int] = {}
        self._turns: dict[tuple[int, int], tuple[int, ...]] = {}
        self._lpm: list[tuple[dict[int, float], float]] = []
        self._told: dict[tuple[int, int], Told] = {}
        self._matches: dict[tuple[int, int, int, int, int], tuple[float, float, float]] = {}

    def note_visit(self, visit: Visit) -> int:
        """Take in one more visit; returns its number.

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
        self.has_alternatives |= len(visit.readings) > 1
        said = dict(visit.lpm_matches)
        self._lpm.append((said, max(0.0, *said.values()) if said else 0.0))
        self._shapes.append(tuple(map(self._name_shape, visit.readings)))
        return v

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

    def predict(self, state: LeafState, visit: int) -> Prediction:
        """Return where the next visit should be, after a map."""
        if state.prediction is None:
            self.work += 1 + len(state.filter.places) // 50
            move = self.visits[visit].displacement
            told = None if self._is_known(state, visit) else self._tell_travel(visit, state.reading)
            move = move if told is None else told.move
            state.prediction = state.filter.predict(move, self.score.length_m)
            if state.prediction.filter is not state.filter:
                self.work += _WINDOW_WORK
        return state.prediction

    def leave(self, state: LeafState, visit: int) -> int | None:
        """Return the index, in its place's star, of the dlp that leads to a visit."""
        reading = self.visits[visit - 1].readings[state.reading]
        if reading.depart is None:
            return None
        return (reading.depart + state.offset) % len(reading.star)

    def _is_known(self, state: LeafState, visit: int) -> bool:
        """Return whether the travel to a visit is through a corridor travelled before."""
        depart = self.leave(state, visit)
        return depart is None or state.judge.follow(state.place, depart) is not None

    def _tell_travel(self, visit: int, read: int) -> Told | None:
        """Return what a travel tells if it is the first through its corridor; None if no more.

        ``read`` is the reading of the visit left.
        """
        prior, move = self.score.travels, self.visits[visit].displacement
        if prior is None or move is None:
            return None
        known = self._told.get((visit, read))
        if known is None:
            heading = find_heading(self.visits[visit - 1].readings[read])
            known = self._told[visit, read] = prior.sharpen(move, heading)
        return known

    def _weigh_travel(self, state: LeafState, v: int) -> float:
        """Return what is taken off for a travel that any corridor would have explained as well."""
        told = self._tell_travel(v, state.reading)
        if told is None or not self._is_known(state, v):
            return 0.0
        return -told.log_density - math.log(self.score.area_m2)

    def bound_visit(self, v: int) -> float:
        """Return the most that a visit can ever add to the log posterior (a safe bound)."""
        move = self.visits[v].displacement
        known = self.score.bound_travel(None if move is None else move.cov)
        bound = known
        for read in range(len(self.visits[v - 1].readings)):
            told = self._tell_travel(v, read)
            if told is not None:
                off = -told.log_density - math.log(self.score.area_m2)
                bound = max(bound, known + off, self.score.bound_travel(told.move.cov))
        return bound + max(math.log(reading.weight) for reading in self.visits[v].readings)

    def enter(self, visit: int, decision: Decision) -> int:
        """Return the index, in its place's star, of the dlp of the gateway come in by."""
        reading = self.visits[visit].readings[decision.reading]
        if reading.arrive is None:
            raise InputError(f"visit {visit}: lacks 'arrive', the dlp faced on arrival")
        return (reading.star.opposite(reading.arrive) + decision.offset) % len(reading.star)

    def match(self, state: LeafState, v: int, decision: Decision) -> tuple[float, float, float]:
        """Return turn [rad], its variance and the misfit of a visit's headings at a known place.

        See :meth:`hssh_kb.score.Score.match_headings`; each pair is matched once.
        """
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

    def tell_bearings(
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

    def weigh_doubt(self, state: LeafState, v: int, doubted: bool) -> float:
        """Return what it costs a map to doubt, or to believe, the travel to a visit."""
        return self.score.weigh_doubt(doubted, state.doubts, v - 1)

    def weigh_lpm(self, v: int, first: int | None) -> float:
        """Return what the match of the local maps adds: 0 for what it speaks for most, else less.

        Parameters
        ----------
        v : the visit. first : the first visit to the place it is taken to; None for a new one.
        """
        said, most = self._lpm[v]
        return (0.0 if first is None else said.get(first, 0.0)) - most

    def weigh_new_places(
        self,
        state: LeafState,
        prediction: Prediction,
        v: int,
        depart: int | None,
        taken: bool,
        lean: bool,
    ) -> Iterator[Option]:
        """Yield the ways to take a visit as a new place.

        Parameters
        ----------
        state, prediction : the map, and where it expects the visit.
        v : number of the visit.
        depart : dlp of the current place that was left along, None if unknown.
        taken : that dlp is known to lead elsewhere already.
        lean : leave out other readings than the best, and doubts that nothing calls for.
        """
        self.work += 1
        if state.newness is None:
            state.newness = self.score.weigh_new(prediction)
        layout, exclusion = state.newness
        place, lpm = len(state.firsts), self.weigh_lpm(v, None)
        for i, reading in enumerate(self.visits[v].readings):
            if lean and i:
                break
            decision = Decision(place, 0, i, False)
            heading = self._weigh_bearings(state, v, depart, decision)
            read, doubts = math.log(reading.weight), self.weigh_doubt(state, v, False)
            refusal = None
            if taken and depart is not None:
                stands = state.judge.find_travel(state.place, depart)
                refusal = Refusal("travel_function", (stands,))
            prior = self.score.place_prior
            yield Option(
                decision, Addends(layout, heading, exclusion, read, prior, doubts, lpm), refusal
            )
            if self.score.slip and (refusal is not None or not lean):
                doubts = self.weigh_doubt(state, v, True)
                yield Option(
                    replace_doubt(decision),
                    Addends(layout, 0.0, exclusion, read, prior, doubts, lpm),
                    None,
                )

    def weigh_closures(
        self,
        state: LeafState,
        prediction: Prediction,
        v: int,
        depart: int | None,
        place: int,
        lean: bool,
    ) -> Iterator[Option]:
        """Yield the ways to take a visit as a known place; parameters as for a new one."""
        first, read_as = state.firsts[place], state.place_readings[place]
        for i in range(len(self.visits[v].readings)):
            turns = self.isomorphisms(v, i, first, read_as)
            for offset in turns:
                decision = Decision(place, offset, i, False)
                refusal = self.judge(state, depart, decision, v, explain=self.score.slip > 0)
                if refusal is not None and not self.score.slip:
                    yield Option(decision, NOTHING, refusal)
                    continue
                weighed = self.weigh_closure(state, prediction, v, depart, decision)
                yield Option(decision, weighed, refusal)
                if self.score.slip and (refusal is not None or not lean):
                    doubted = replace_doubt(decision)
                    weighed = self.weigh_closure(state, prediction, v, depart, doubted)
                    yield Option(doubted, weighed, None)

    def judge(
        self,
        state: LeafState,
        depart: int | None,
        decision: Decision,
        v: int,
        *,
        explain: bool = True,
    ) -> Refusal | None:
        """Return why a travel cannot be taken as decided, None if it can.

        Unless asked to explain, the travels that stand against it are not named.
        """
        if depart is None:
            return None
        return state.judge.find_refusal(
            state.place,
            depart,
            decision.place,
            self.enter(v, decision),
            order=self.order,
            planarity=self.planarity,
            explain=explain,
        )

    def weigh_closure(
        self,
        state: LeafState,
        prediction: Prediction,
        v: int,
        depart: int | None,
        decision: Decision,
    ) -> Addends:
        """Return what one closure adds to the log posterior, term by term."""
        self.work += 1
        turn, var, misfit = self.match(state, v, decision)
        innovation = prediction.measure(decision.place, turn)
        layout, heading, _ = self.score.weigh_closure(prediction, innovation, var)
        heading += misfit
        if not decision.doubted:
            heading += self._weigh_bearings(state, v, depart, decision)
        reading = self.visits[v].readings[decision.reading]
        read, doubts = math.log(reading.weight), self.weigh_doubt(state, v, decision.doubted)
        lpm = self.weigh_lpm(v, state.firsts[decision.place])
        travels = self._weigh_travel(state, v)
        return Addends(layout, heading, 0.0, read, 0.0, doubts, lpm, travels)

    def _weigh_bearings(
        self, state: LeafState, v: int, depart: int | None, decision: Decision
    ) -> float:
        if depart is None:
            return 0.0
        size = len(self.visits[v].readings[decision.reading].star)
        told = self.tell_bearings(state, v, depart, self.enter(v, decision), size)
        if told is None:
            return 0.0
        weight = self.score.weigh_bearing(state.bearings[state.place], told[0])
        if decision.place < len(state.bearings):
            weight += self.score.weigh_bearing(state.bearings[decision.place], told[1])
        return weight

    def find_closure_noise(
        self, state: LeafState, prediction: Prediction, v: int, decision: Decision
    ) -> tuple[float, tuple[float, float, float]]:
        """Return the turn [rad] of a closure and the variances (m2, m2, rad2) to close with."""
        turn, var, _ = self.match(state, v, decision)
        innovation = prediction.measure(decision.place, turn)
        return turn, self.score.weigh_closure(prediction, innovation, var)[2]
