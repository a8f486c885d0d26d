"""Why another map took the lead when a visit arrived: which beliefs changed, and what refuted them.

Source: Beeson 2008, section 8.2 (a refuted map gives way to the next); the words are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from hssh_kb.consistency import Refusal
from hssh_kb.errors import InputError
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.map_tree import MapTree, grow_hypothesis
from hssh_kb.node import Node
from hssh_kb.score import Score
from hssh_kb.theory import find_axiom

_CALLED_FOR_NATS = 1.0  # the displacements call for a place this much more than for what is left
_MOST_BELIEFS = 3
_AXIOMS = {"order": "order_irreflexive"}


@dataclass(frozen=True)
class Belief:
    """What two maps hold of one visit.

    Attributes
    ----------
    visit : the visit.
    before, after : first visit of the place it was held to be at, and is held to be at now; the
        visit itself stands for a place of its own.
    """

    visit: int
    before: int
    after: int


@dataclass(frozen=True)
class ChangeOfMind:
    """Another map leads since a visit arrived.

    Attributes
    ----------
    visit : the visit on whose arrival it took the lead.
    before : the former favourite, of the visits before.
    after : the favourite now.
    beliefs : the visits that the two put at other places.
    refusal : the axiom that keeps the former favourite from what the displacement calls for,
        and the travels that stand against it; None if it was outdone without being refuted.
    lost_nats : how much less probable the former favourite is now, at its best; infinite if no
        map grows out of it.
    text : one or two sentences for all of it, in the user's names.
    """

    visit: int
    before: Hypothesis
    after: Hypothesis
    beliefs: tuple[Belief, ...]
    refusal: Refusal | None
    lost_nats: float
    text: str


def explain_change(
    experience: Experience,
    before: Hypothesis,
    after: Hypothesis,
    score: Score,
    *,
    order: bool = True,
    planarity: bool = True,
    grown: tuple[MapTree, Node] | None = None,
) -> ChangeOfMind | None:
    """Compare the favourites before and after the latest visit of an experience.

    Parameters
    ----------
    experience : all visits so far.
    before, after : the best maps of all visits but the latest, and of all visits.
    score : parameters of the log posterior.
    order, planarity : which axioms hold.
    grown : the former favourite in a tree of all visits, where there is one; else it is grown anew.

    Returns
    -------
    ChangeOfMind or None : None if the one map grew out of the other.

    Raises
    ------
    InputError : the two maps are not of all visits but the latest and of all visits.

    Source
    ------
    Ours.
    """
    beliefs, last = list_beliefs(experience, before, after), len(experience) - 1
    if not beliefs:
        return None
    if grown is None:
        known = replace(experience, visits=experience.visits[:last])
        grown = grow_hypothesis(known, before, score, order=order, planarity=planarity)
        grown[0].note_visit(experience.visits[last])
    called, refusal, best = _find_refusal(*grown)
    lost = (after.log_posterior or 0.0) - best
    told = [_tell_beliefs(experience, beliefs, last)]
    if refusal is not None:
        told.append(_tell_refusal(experience, called, refusal, last))
    elif lost > 0:
        told.append(
            f"The former best map is less probable by {lost:.1f} nats now: it fits the "
            f"displacement of {experience.visit_label(last)} worse."
        )
    return ChangeOfMind(last, before, after, beliefs, refusal, lost, " ".join(told))


def list_beliefs(
    experience: Experience, before: Hypothesis, after: Hypothesis
) -> tuple[Belief, ...]:
    """Return the visits that two maps put at other places, the latest visit aside.

    Raises
    ------
    InputError : the two maps are not of all visits but the latest and of all visits.
    """
    last = len(experience) - 1
    if (len(before.visits), len(after.visits)) != (last, last + 1):
        raise InputError(
            f"the maps are of {len(before.visits)} and {len(after.visits)} visits, "
            f"expected {last} and {last + 1}"
        )
    pairs = enumerate(zip(before.visits, after.visits, strict=False))
    return tuple(Belief(v, one, other) for v, (one, other) in pairs if one != other)


def explain_symbolic_change(
    experience: Experience, before: Hypothesis, after: Hypothesis
) -> ChangeOfMind | None:
    """Compare the favourites before and after the latest visit where minimality decides.

    Parameters, returns and errors are those of :func:`explain_change`.

    Source
    ------
    Ours.
    """
    from hssh_kb.check import check

    beliefs, last = list_beliefs(experience, before, after), len(experience) - 1
    if not beliefs:
        return None
    told = [_tell_beliefs(experience, beliefs, last)]
    for belief in beliefs:
        sign = "=" if belief.before != belief.visit else "!="
        other = belief.before if sign == "=" else belief.after
        found = check(experience, [f"v{belief.visit}{sign}v{other}"])
        if found.consistent is False and found.violations:
            told.append(f"What was held cannot be: {found.violations[0].text}")
            break
    else:
        told.append("What was held is still possible, but takes more paths or places now.")
    return ChangeOfMind(last, before, after, beliefs, None, 0.0, " ".join(told))


def _find_refusal(tree: MapTree, node: Node) -> tuple[int, Refusal | None, float]:
    """Return the place the displacement calls for (its first visit), why it is refused, the rest.

    The rest is the log posterior of the map with its best way to take the visit.
    """
    state = tree.state_of(node)
    options = [*tree.options(node)]
    if all(option.refusal is not None for option in options):
        options += tree.options(node, far=True)
    left = [sum(option.addends) for option in options if option.refusal is None]
    best = max(left, default=-math.inf)
    depart = tree.leave(state, node.visit + 1)
    known = None if depart is None else state.judge.follow(state.place, depart)
    if known is not None and depart is not None:
        place = known[0]
        travel = state.judge.find_travel(state.place, depart)
        fits = [one for one in options if one.decision.place == place and one.refusal is None]
        refusal = None if fits else Refusal("travel_function", (travel,))
        return state.firsts[place], refusal, node.score + best
    place, worth = tree.find_place_under(node)
    if place < 0 or worth < best + _CALLED_FOR_NATS:
        return -1, None, node.score + best
    there = [one for one in options if one.decision.place == place]
    if any(one.refusal is None for one in there):
        return state.firsts[place], None, node.score + best
    first = state.firsts[place]
    refusal = Refusal("star_isomorphism", (first,))
    if there:
        refusal = tree.judge(state, depart, there[0].decision, node.visit + 1)
    return first, refusal, node.score + best


def _tell_beliefs(experience: Experience, beliefs: tuple[Belief, ...], last: int) -> str:
    name = experience.visit_label

    def place(visit: int, at: int) -> str:
        return "a place of its own" if at == visit else f"the place of {name(at)}"

    told = [
        f"{name(b.visit)} was held to be {place(b.visit, b.before)} and is now held to be "
        f"{place(b.visit, b.after)}"
        for b in beliefs[:_MOST_BELIEFS]
    ]
    more = len(beliefs) - len(told)
    rest = f" (and {more} more visit{'s' * (more > 1)} changed place)" if more else ""
    return f"When {name(last)} arrived, another map took the lead: {'; '.join(told)}{rest}."


def _tell_refusal(experience: Experience, called: int, refusal: Refusal, last: int) -> str:
    name, axiom = experience.visit_label, find_axiom(_AXIOMS.get(refusal.axiom, refusal.axiom))
    rule = f"axiom {axiom.number} ({axiom.title})"
    if refusal.axiom == "star_isomorphism":
        return (
            f"In the former map {name(last)} lies where {name(called)} is, but the two saw "
            f"stars that no turn carries onto each other, which {rule} forbids."
        )
    travels = [f"the travel from {name(t - 1)} to {name(t)}" for t in refusal.travels[:3]]
    if refusal.axiom == "travel_function" and len(refusal.travels) == 1:
        return (
            f"The former map has left that way before: {travels[0]} led to the place of "
            f"{name(called)}, whose star is not the one seen at {name(last)}; {rule} forbids it."
        )
    return (
        f"In the former map {name(last)} lies where {name(called)} is, but {rule} forbids this "
        f"closure because of {' and '.join(travels)}."
    )
