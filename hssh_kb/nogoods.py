"""Conflict-driven learning: why no map with certain closures can stand, whatever else it says.

Where the robot goes on through a gateway it went through before, the axioms of travel fix the place
it comes to. If the star seen there is not the star of that place, the map is refuted. The mistake
lies further back: each visit since was fixed by the one before it, up to closures that were
chosen. A nogood is the set of those chosen closures (and of the readings of stars that it
rests on), found by explaining, as congruence closure does, why two visits had to be one place.
It follows from the axioms and the observations alone, so every map that holds it is refuted, now
and later.

Only equalities of visits are ever to blame: a new place behind an untried gateway contradicts
nothing, and what travel being a function and reversible makes of equalities only grows
with them.

Source: proof forests of congruence closure after Nieuwenhuis & Oliveras, "Fast congruence closure
and extensions", Information and Computation 205, 2007, section 3; clause learning as in
clingo; the use in a tree of maps is ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from hssh_kb.errors import InputError
from hssh_kb.experience import Visit
from hssh_kb.node import Decision, Node


class Same(NamedTuple):
    """Two visits are one place: dlp k of ``visit`` is dlp (k + turn) mod size of ``earlier``."""

    visit: int
    earlier: int
    turn: int
    size: int


@dataclass(frozen=True)
class Nogood:
    """Closures and readings that cannot stand together.

    Attributes
    ----------
    closures : the equalities of visits.
    readings : (visit, index) of the readings they rest on, at visits with more than one.
    refuted_at : the visit whose star showed it.
    """

    closures: tuple[Same, ...]
    readings: tuple[tuple[int, int], ...]
    refuted_at: int

    @property
    def latest(self) -> int:
        """The latest visit it speaks of; 0 if it speaks of none, and then no map can stand."""
        closures = max((one.visit for one in self.closures), default=0)
        return max(closures, max((v for v, _ in self.readings), default=0))

    def holds_in(self, decisions: Sequence[Decision]) -> bool:
        """Return whether a map, given by its decisions up to :attr:`latest` at least, has it."""
        for visit, index in self.readings:
            if decisions[visit].reading != index:
                return False
        for visit, earlier, turn, size in self.closures:
            one, other = decisions[visit], decisions[earlier]
            if one.place != other.place or (one.offset - other.offset - turn) % size:
                return False
        return True


def is_refuted(nogoods: Mapping[int, Sequence[Nogood]], node: Node) -> bool:
    """Return whether a map holds a nogood that speaks of its latest visit.

    Parameters
    ----------
    nogoods : those known, by the latest visit that each speaks of.
    node : the map.
    """
    known = nogoods.get(node.visit)
    if not known:
        return False
    decisions = [one.decision for one in node.chain()[1:]]
    return any(nogood.holds_in(decisions) for nogood in known)


@dataclass
class _Forest:
    """Why each visit of a map is where it is.

    Attributes
    ----------
    anchor : visit -> an earlier visit to the same place, itself for the first.
    because : visit -> the two visits whose being one place fixed that, None if it was chosen.
    """

    anchor: list[int] = field(default_factory=list)
    because: list[tuple[int, int] | None] = field(default_factory=list)

    def list_steps(self, one: int, other: int) -> list[int]:
        """Return the visits whose steps to their anchors lead from one visit to another."""
        steps = []
        while one != other:
            one, other = max(one, other), min(one, other)
            if self.anchor[one] == one:
                raise InputError(f"visits {other} and {one} are not at one place in this map")
            steps.append(one)
            one = self.anchor[one]
        return steps


def learn_nogood(visits: Sequence[Visit], decisions: Sequence[Decision]) -> Nogood | None:
    """Return why a map cannot take its next visit, None if travel does not fix where that is.

    Parameters
    ----------
    visits : the visits, the one that refutes the map among them.
    decisions : of the map, one a visit; no travel is doubted.
    """
    forest, gateways = _explain_all(visits, decisions)
    last = len(decisions) - 1
    known = gateways.get(_leave(visits, decisions, last))
    if known is None:
        return None
    travel, onward = known
    fixed = travel - 1 if onward else travel
    closures: set[Same] = set()
    used = {last, travel - 1, travel}
    todo, done = [(last, fixed)], set[int]()
    while todo:
        for step in forest.list_steps(*todo.pop()):
            if step in done:
                continue
            done.add(step)
            reason, anchor = forest.because[step], forest.anchor[step]
            used |= {step, anchor}
            if reason is None:
                closures.add(_equate(visits, decisions, step, anchor))
            else:
                used |= {step - 1, reason[1]}
                todo.append(reason)
    readings = tuple((v, decisions[v].reading) for v in sorted(used) if len(visits[v].readings) > 1)
    return Nogood(tuple(sorted(closures)), readings, last + 1)


def _equate(visits: Sequence[Visit], decisions: Sequence[Decision], one: int, other: int) -> Same:
    size = len(visits[one].readings[decisions[one].reading].star)
    turn = (decisions[one].offset - decisions[other].offset) % size
    return Same(one, other, turn, size)


def _leave(
    visits: Sequence[Visit], decisions: Sequence[Decision], visit: int
) -> tuple[int, int] | None:
    """Return (place, dlp) of the gateway a visit was left by."""
    decision = decisions[visit]
    reading = visits[visit].readings[decision.reading]
    if reading.depart is None:
        return None
    return decision.place, (reading.depart + decision.offset) % len(reading.star)


def _enter(
    visits: Sequence[Visit], decisions: Sequence[Decision], visit: int
) -> tuple[int, int] | None:
    """Return (place, dlp) of the gateway a visit was come to by."""
    decision = decisions[visit]
    reading = visits[visit].readings[decision.reading]
    if reading.arrive is None:
        return None
    inward = reading.star.opposite(reading.arrive)
    return decision.place, (inward + decision.offset) % len(reading.star)


def _explain_all(
    visits: Sequence[Visit], decisions: Sequence[Decision]
) -> tuple[_Forest, dict[tuple[int, int] | None, tuple[int, bool]]]:
    """Return why each visit is where it is, and the first travel through each gateway.

    A travel is given by the visit it led to, and whether it set out from the gateway.
    """
    forest = _Forest()
    gateways: dict[tuple[int, int] | None, tuple[int, bool]] = {}
    firsts: dict[int, int] = {}
    for v, decision in enumerate(decisions):
        first = firsts.setdefault(decision.place, v)
        out = _leave(visits, decisions, v - 1) if v else None
        known = gateways.get(out)
        if first == v or known is None:
            forest.anchor.append(first)
            forest.because.append(None)
        else:
            travel, onward = known
            forest.anchor.append(travel if onward else travel - 1)
            forest.because.append((v - 1, travel - 1 if onward else travel))
        if out is not None and known is None:
            into = _enter(visits, decisions, v)
            gateways[out] = v, True
            if into is not None:
                gateways[into] = v, False
    return forest, gateways
