"""The incremental judge: tells whether a growing map is still consistent with the axioms.

Plain Python beside the logic program, for the search over the tree of maps: one
:class:`MapState` holds what a map asserts (which gateway leads to which, the paths, the
rotation system), and every way to take the next visit is tested against it in microseconds.
States are never changed; growing one gives a new one.

Source: Beeson 2008, equations 3.6-3.10 (order) and Algorithm 8.1; planarity after Savelli and
Kuipers 2004 as the genus of the rotation system; the incremental forms are ours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from typing import NamedTuple

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Reading
from hssh_kb.hypothesis import Hypothesis
from perception.star import Star

_BASE = 1 << 10  # gateway k of place p is coded p * _BASE + k


class Refusal(NamedTuple):
    """Why a travel cannot be taken as proposed.

    Attributes
    ----------
    axiom : ``star_isomorphism``, ``travel_function``, ``reversibility``, ``order`` or
        ``planarity``.
    travels : the earlier travels (named by the visits they lead to) that stand against it.
    """

    axiom: str
    travels: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class MapState:
    """What one map asserts after some visits; immutable.

    Places are numbered 0, 1, ... in order of their first visits.

    Attributes
    ----------
    stars : star of each place.
    joined : gateway code -> code of the gateway at the other end of its travel.
    travel : gateway code -> visit that the first travel through it led to.
    path : local-path code -> name of its path (the code of one of its local-paths).
    on_path : name of a path -> the places on it.
    component : number of the connected part of the map that each place is in.
    """

    stars: tuple[Star, ...]
    joined: dict[int, int]
    travel: dict[int, int]
    path: dict[int, int]
    on_path: dict[int, frozenset[int]]
    component: tuple[int, ...]
    _faces: dict[int, tuple[int, ...]] = field(default_factory=dict, compare=False, repr=False)

    @classmethod
    def start(cls, star: Star) -> MapState:
        """Return the map of the first visit."""
        return cls((star,), {}, {}, {}, {}, (0,))

    def add_place(self, star: Star) -> MapState:
        """Return the map with one more place, not yet joined to anything."""
        return MapState(
            (*self.stars, star),
            self.joined,
            self.travel,
            self.path,
            self.on_path,
            (*self.component, len(self.component)),
        )

    def follow(self, place: int, depart: int) -> tuple[int, int] | None:
        """Return (place, gateway) that the gateway ``depart`` is known to lead to, else None."""
        code = self.joined.get(place * _BASE + depart)
        return None if code is None else divmod(code, _BASE)

    def find_travel(self, place: int, depart: int) -> int:
        """Return the visit that the first travel through a gateway led to, -1 if none yet."""
        return self.travel.get(place * _BASE + depart, -1)

    def find_refusal(
        self,
        place: int,
        depart: int,
        other: int,
        gateway: int,
        *,
        order: bool = True,
        planarity: bool = True,
        explain: bool = True,
    ) -> Refusal | None:
        """Return why no travel can lead from one gateway to another, or None if it can.

        Parameters
        ----------
        place, depart : where the travel starts: place and index of the dlp left along.
        other, gateway : where it ends: place and index of the dlp of the gateway come in by
            (the opposite of the dlp faced).
        order, planarity : which of the axioms to hold it to.
        explain : name the travels that stand against it.
        """
        start, end = place * _BASE + depart, other * _BASE + gateway
        known = self.joined.get(start)
        if known == end:
            return None
        if known is not None:
            return Refusal("travel_function", (self.travel[start],))
        if end in self.joined or start == end:
            return Refusal("reversibility", (self.travel[end],) if end in self.joined else ())
        if order:
            names = self._find_order_clash(place, depart, other, gateway)
            if names:
                found = map(self._travels_of_path, names) if explain else ()
                return Refusal("order", tuple(chain.from_iterable(found)))
        together = self.component[place] == self.component[other]
        if planarity and together and not self._share_face(start, end):
            return Refusal("planarity", self._trace_face(place, depart) if explain else ())
        return None

    def join(self, place: int, depart: int, other: int, gateway: int, visit: int) -> MapState:
        """Return the map with one travel more; the travel must not be refused."""
        start, end = place * _BASE + depart, other * _BASE + gateway
        if start in self.joined:
            return self
        joined, travel = self.joined.copy(), self.travel.copy()
        joined[start], joined[end] = end, start
        travel[start] = travel[end] = visit
        path, on_path = self._merge_paths(place, depart, other, gateway)
        old, new = self.component[other], self.component[place]
        component = self.component
        if other == len(component) - 1 and component.index(old) == other:
            component = (*component[:-1], new)  # a place just met, the usual case
        elif old != new:
            component = tuple(new if c == old else c for c in component)
        return MapState(self.stars, joined, travel, path, on_path, component)

    def _local_path(self, place: int, k: int) -> int:
        return place * _BASE + min(k, self.stars[place].opposites[k])

    def _merge_paths(
        self, place: int, depart: int, other: int, gateway: int
    ) -> tuple[dict[int, int], dict[int, frozenset[int]]]:
        path, on_path = self.path.copy(), self.on_path.copy()
        one, two = self._local_path(place, depart), self._local_path(other, gateway)
        name, gone = path.get(one, one), path.get(two, two)
        if name == gone:
            path[one] = path[two] = name
            on_path[name] = on_path.get(name, frozenset()) | {place, other}
            return path, on_path
        if len(on_path.get(name, ())) < len(on_path.get(gone, ())):
            name, gone = gone, name
        members = on_path.pop(gone, None)
        if members is not None:
            for code, root in self.path.items():
                if root == gone:
                    path[code] = name
        path[one] = path[two] = name
        on_path[name] = on_path.get(name, frozenset()) | (members or frozenset()) | {place, other}
        return path, on_path

    def _find_order_clash(
        self, place: int, depart: int, other: int, gateway: int
    ) -> tuple[int, ...]:
        """Return the names of the paths that cannot be joined: a place would be on one twice."""
        one, two = self._local_path(place, depart), self._local_path(other, gateway)
        name, gone = self.path.get(one, one), self.path.get(two, two)
        if name == gone:
            return (name,)
        mine = self.on_path.get(name) or frozenset((place,))
        theirs = self.on_path.get(gone) or frozenset((other,))
        if mine.isdisjoint(theirs):
            return ()
        return name, gone

    def _travels_of_path(self, name: int) -> tuple[int, ...]:
        found = set()
        for code, root in self.path.items():
            if root == name:
                place, k = divmod(code, _BASE)
                for dlp in (k, self.stars[place].opposites[k]):
                    visit = self.travel.get(place * _BASE + dlp)
                    if visit is not None:
                        found.add(visit)
        return tuple(sorted(found))

    def _step_round(self, code: int) -> int:
        """Return the gateway after one, clockwise round the face that lies on its left."""
        place, k = divmod(self.joined.get(code, code), _BASE)
        return place * _BASE + (k + 1) % len(self.stars[place])

    def _share_face(self, start: int, end: int) -> bool:
        """Return whether two gateways not travelled yet open into one face.

        Faces are followed from both at once, so a long one costs no more than the way round
        the short one or, if they are the same, the shorter way between the two.
        """
        joined, stars = self.joined, self.stars
        one, two = start, end
        while True:
            place, k = divmod(joined.get(one, one), _BASE)
            one = place * _BASE + (k + 1) % len(stars[place].dlps)
            if one == end:
                return True
            place, k = divmod(joined.get(two, two), _BASE)
            two = place * _BASE + (k + 1) % len(stars[place].dlps)
            if two == start:
                return True
            if one == start or two == end:
                return False

    def _trace_face(self, place: int, depart: int) -> tuple[int, ...]:
        """Return the travels round the face that a gateway not travelled yet opens into.

        Traced once for all closures that are refused from one gateway.
        """
        start = place * _BASE + depart
        known = self._faces.get(start)
        if known is None:
            travels, code = set(), self._step_round(start)
            while code != start:
                if code in self.joined:
                    travels.add(self.travel[code])
                code = self._step_round(code)
            known = self._faces[start] = tuple(sorted(travels))
        return known


def check_star(reading: Reading) -> None:
    """Check that a reading can be judged.

    Raises
    ------
    InputError : the star has more than 1,023 dlps.
    """
    if len(reading.star) >= _BASE:
        raise InputError(f"a star of {len(reading.star)} dlps is beyond what a place can have")


@dataclass(frozen=True)
class Verdict:
    """The judge's word on a whole hypothesis.

    Attributes
    ----------
    consistent : no axiom is violated.
    visit : the first visit that cannot stand, None if consistent.
    refusal : why, None if consistent.
    state : the map after the last visit that could stand.
    """

    consistent: bool
    visit: int | None
    refusal: Refusal | None
    state: MapState


def judge_hypothesis(
    experience: Experience,
    hypothesis: Hypothesis,
    *,
    order: bool = True,
    planarity: bool = True,
) -> Verdict:
    """Judge a hypothesis from its first visit to its last.

    Travels that the hypothesis doubts assert nothing.

    Source
    ------
    Ours, for the axioms of Beeson 2008 named in the module.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> bend = ["a+1", "b+1", "a-0", "b-0"]
    >>> experience = make_experience([(bend, None, 0), (bend, 3, 0), (bend, 3, None)])
    >>> judge_hypothesis(experience, Hypothesis((0, 1, 2), (0, 0, 0))).consistent
    True
    >>> judge_hypothesis(experience, Hypothesis((0, 1, 1), (0, 0, 0))).refusal.axiom
    'reversibility'
    """
    stars = [hypothesis.reading(experience, v).star for v in range(len(hypothesis.visits))]
    state = MapState.start(stars[0])
    number = {0: 0}
    for v in range(1, len(hypothesis.visits)):
        first, offset = hypothesis.visits[v], hypothesis.offsets[v]
        if first == v:
            number[v] = len(state.stars)
            state = state.add_place(stars[v])
        elif offset not in stars[v].isomorphisms(stars[first]):
            return Verdict(False, v, Refusal("star_isomorphism", ()), state)
        if v in hypothesis.doubted:
            continue
        ends = _locate_travel(experience, hypothesis, v, number)
        refusal = state.find_refusal(*ends, order=order, planarity=planarity)
        if refusal is not None:
            return Verdict(False, v, refusal, state)
        state = state.join(*ends, v)
    return Verdict(True, None, None, state)


def _locate_travel(
    experience: Experience, hypothesis: Hypothesis, v: int, number: dict[int, int]
) -> tuple[int, int, int, int]:
    """Return (place, depart, other place, gateway) of the travel to visit v."""
    before, now = hypothesis.reading(experience, v - 1), hypothesis.reading(experience, v)
    if before.depart is None or now.arrive is None:
        raise InputError(
            f"{experience.source or 'experience'}: the travel to visit {v} lacks 'depart' at "
            f"visit {v - 1} or 'arrive' at visit {v}"
        )
    start = hypothesis.place_dlp(experience, v - 1, before.depart)
    end = hypothesis.place_dlp(experience, v, now.star.opposite(now.arrive))
    return number[start[0]], start[1], number[end[0]], end[1]
