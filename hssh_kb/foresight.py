"""What the rival maps expect to be seen on a walk, and what seeing it would do to the doubt.

A walk is told as a robot would do it whichever map is true: at each place, how far to turn
clockwise from the dlp it faces, then travel. Each map foretells the star at the far end of a
travel if that travel has been made before in it; of a way that is unexplored in it, it expects
anything, which is the distribution of what has been seen so far.

Source: ours; expected entropy as the measure of an experiment after Shannon, its use for places
after the localisation procedures that Beeson 2008, section 10.1.2, names.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Reading
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.place_graph import PlaceDlp
from perception.geometry import Array, wrap_angle
from perception.star import Star

View = tuple[tuple[int, int], ...]
"""A star as seen on arrival: per dlp, clockwise from the one faced, alpha and the clockwise
distance to its opposite. Two arrivals look alike if their views are equal."""

_SAME_DLP_RAD = np.deg2rad(30)


def see_star(star: Star, facing: int) -> View:
    """Return what one sees who faces a dlp of a star.

    Examples
    --------
    >>> t = Star.parse(["a-0", "b+1", "a+1", "b-1"])
    >>> see_star(t, 0)
    ((0, 2), (1, 2), (1, 2), (1, 2))
    >>> see_star(t, 1) == see_star(Star.parse(["y+1", "x+1", "y-1", "x-0"]), 0)
    True
    """
    size = len(star)
    around = [(facing + k) % size for k in range(size)]
    return tuple((star.alpha[k], (star.opposite(k) - k) % size) for k in around)


@dataclass(frozen=True)
class Stand:
    """Where the robot stands in one map: place (its first visit) and the dlp it faces."""

    place: int
    facing: int


@dataclass(frozen=True)
class MapWalker:
    """One map to walk about in.

    Attributes
    ----------
    stars : star of each place, by its first visit.
    joined : gateway -> gateway at the other end of the travel, both ways.
    """

    stars: Mapping[int, Star]
    joined: Mapping[PlaceDlp, PlaceDlp]

    @classmethod
    def make(cls, experience: Experience, hypothesis: Hypothesis) -> MapWalker:
        """Return the walker of a map; travels that it doubts join nothing."""
        stars = {p: hypothesis.reading(experience, p).star for p in hypothesis.places}
        joined = dict[PlaceDlp, PlaceDlp]()
        for v in range(1, len(hypothesis.visits)):
            before, now = hypothesis.reading(experience, v - 1), hypothesis.reading(experience, v)
            if before.depart is None or now.arrive is None or v in hypothesis.doubted:
                continue
            start = hypothesis.place_dlp(experience, v - 1, before.depart)
            end = hypothesis.place_dlp(experience, v, now.star.opposite(now.arrive))
            joined[start], joined[end] = end, start
        return cls(stars, joined)

    def travel(self, place: int, dlp: int) -> Stand | None:
        """Return where leaving along a dlp leads to; None if that way is unexplored."""
        end = self.joined.get((place, dlp))
        return None if end is None else Stand(end[0], self.stars[end[0]].opposite(end[1]))

    def view(self, stand: Stand) -> View:
        """Return what is seen at a stand."""
        return see_star(self.stars[stand.place], stand.facing)


@dataclass(frozen=True)
class Belief:
    """The doubt after a walk on which everything came as the leading map expects.

    Attributes
    ----------
    joint : (n,) probability of each map together with what was seen.
    stands : where the robot stands in each map; None where the map has no prediction any more.
    settled_bits : expected entropy of the branches in which something else was seen before: the
        walk ends there.
    parted : maps that expected something else on the way.
    """

    joint: Array
    stands: tuple[Stand | None, ...]
    settled_bits: float = 0.0
    parted: frozenset[int] = frozenset()

    @property
    def entropy_bits(self) -> float:
        """Expected entropy of the maps if the walk ends here, bits."""
        return self.settled_bits + weigh_doubt(self.joint)


@dataclass(frozen=True)
class Forecast:
    """What one more travel promises.

    Attributes
    ----------
    entropy_bits : expected entropy of the maps after it.
    stands : where each map says it leads to; None where the map expects anything.
    onward : the belief if what comes is what the leading map expects; None if that map expects
        anything.
    """

    entropy_bits: float
    stands: tuple[Stand | None, ...]
    onward: Belief | None


def weigh_doubt(joint: Array) -> float:
    """Return P H, the probability of a branch times the entropy in it, bits.

    Parameters
    ----------
    joint : (n,) probabilities of each map together with the branch; they sum to P.

    Examples
    --------
    >>> weigh_doubt(np.array([0.5, 0.5])), weigh_doubt(np.array([0.25, 0.0]))
    (1.0, 0.0)
    """
    some = joint[joint > 0]
    return max(0.0, -float(np.sum(some * np.log2(some / some.sum())))) if some.size else 0.0


class Foresight:
    """Foretells walks under rival maps.

    Parameters
    ----------
    experience : what was lived through.
    maps : the rival maps, all of them of the whole experience.
    weights : (n,) probability of each; they sum to 1.
    lead : index of the map that walks are planned on.

    Raises
    ------
    InputError : no maps, or weights that are no probabilities.

    Source
    ------
    Ours.
    """

    def __init__(
        self,
        experience: Experience,
        maps: Sequence[Hypothesis],
        weights: Array,
        *,
        lead: int = 0,
    ) -> None:
        if not maps or len(weights) != len(maps) or (weights < 0).any():
            raise InputError("foresight needs at least one map, and a weight of each")
        self.experience, self.maps, self.lead = experience, tuple(maps), lead
        self.weights = np.asarray(weights / weights.sum())
        self.walkers = tuple(MapWalker.make(experience, h) for h in maps)

    @cached_property
    def seen(self) -> Mapping[View, float]:
        """Probability of each view where anything may come; what is left is something new.

        The views of all arrivals so far, each reading counting by its weight, and one more that
        was like none of them.
        """
        counts = Counter[View]()
        for visit in self.experience.visits:
            for reading in visit.readings:
                counts.update(_list_views(reading))
        total = counts.total() + 1.0
        return {view: count / total for view, count in counts.items()}

    @cached_property
    def misread(self) -> float:
        """Probability that the star seen is not that of the place.

        The mean weight of the alternatives: 0 in an experience that has none.
        """
        return float(np.mean([1.0 - visit.readings[0].weight for visit in self.experience.visits]))

    def start(self) -> Belief:
        """Return the belief at the last visit."""
        stands = tuple(self._stand(h) for h in self.maps)
        return Belief(self.weights, stands)

    def _stand(self, hypothesis: Hypothesis) -> Stand:
        last = len(hypothesis.visits) - 1
        arrive = hypothesis.reading(self.experience, last).arrive
        place, facing = hypothesis.place_dlp(self.experience, last, arrive or 0)
        return Stand(place, facing)

    def step(self, belief: Belief, turn: int) -> Forecast:
        """Foretell one travel.

        Parameters
        ----------
        belief : the belief before it.
        turn : how many dlps clockwise of the one faced the robot leaves by, in the leading map.
        """
        stands = tuple(self._travel(belief, i, turn) for i in range(len(self.maps)))
        views = [
            None if stand is None else self.walkers[i].view(stand) for i, stand in enumerate(stands)
        ]
        leading = views[self.lead]
        lost = np.array([view is None for view in views])
        settled, onward, rest = belief.settled_bits, None, 1.0
        for view in dict.fromkeys(view for view in views if view is not None):
            chance = self.seen.get(view, 0.0)
            rest -= chance
            alike = np.array([other == view for other in views])
            likely = np.where(lost, chance, self.misread * chance + (1 - self.misread) * alike)
            joint = belief.joint * likely
            if view == leading:
                parted = frozenset(np.flatnonzero(~alike & ~lost).tolist())
                kept = tuple(s if a else None for s, a in zip(stands, alike, strict=True))
                onward = Belief(joint, kept, 0.0, belief.parted | parted)
            settled += 0.0 if view == leading else weigh_doubt(joint)
        settled += weigh_doubt(belief.joint * np.where(lost, rest, self.misread * rest))
        if onward is None:
            return Forecast(settled, stands, None)
        onward = Belief(onward.joint, onward.stands, settled, onward.parted)
        return Forecast(onward.entropy_bits, stands, onward)

    def _travel(self, belief: Belief, i: int, turn: int) -> Stand | None:
        stand, lead = belief.stands[i], belief.stands[self.lead]
        if stand is None or lead is None:
            return None
        mine, theirs = self.walkers[self.lead], self.walkers[i]
        if mine.view(lead) == theirs.view(stand):
            size = len(theirs.stars[stand.place])
            return theirs.travel(stand.place, (stand.facing + turn) % size)
        # Only at the last visit may maps read the star before one's eyes in different ways.
        dlp = self._align(i, lead, turn)
        return None if dlp is None else theirs.travel(stand.place, dlp)

    def _align(self, i: int, lead: Stand, turn: int) -> int | None:
        """Return the dlp, in another map's reading of the last visit, that points the same way."""
        last = len(self.experience) - 1
        mine = self.maps[self.lead]
        own, other = (h.reading(self.experience, last) for h in (mine, self.maps[i]))
        if not (own.headings and other.headings):
            return None
        size = len(own.star)
        k = (lead.facing + turn - mine.offsets[last]) % size
        away = np.abs(wrap_angle(np.array(other.headings) - own.headings[k]))
        nearest = int(away.argmin())
        if away[nearest] > _SAME_DLP_RAD:
            return None
        return self.maps[i].place_dlp(self.experience, last, nearest)[1]


def _list_views(reading: Reading) -> dict[View, float]:
    """Weigh the views of an arrival; at the first visit, those through any gateway."""
    star = reading.star
    if reading.arrive is not None:
        return {see_star(star, reading.arrive): reading.weight}
    doors = [k for k in range(len(star)) if star.alpha[star.opposite(k)]]
    views = dict[View, float]()
    for k in doors:
        view = see_star(star, k)
        views[view] = views.get(view, 0.0) + reading.weight / len(doors)
    return views
