"""Where the displacements call for a closure that the axioms refuse: which readings to doubt.

A star read wrongly seldom breaks an axiom by itself, since every visit may be a new place. It
breaks them together with the displacements: two visits lie on one spot and saw stars that do not
agree. The smallest sets of readings that cannot all stand are those of the axioms, under the
assumption that the two are one place.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from hssh_kb.check import check
from hssh_kb.experience import Experience
from hssh_kb.map_tree import MapTree
from hssh_kb.node import Node

SURPRISE_NATS = 4.0
"""A closure so much more probable than the new place that a map makes of a visit is called for.

Of many places a few do lie very near others: over the whole walk it takes so much more than chance
explains.
"""

STRAIN_NATS = 12.5
"""A closure this much less probable than a new place is five standard deviations off."""

_NARROW_NATS = -1.0  # places that leave more room than that lie on no other
_MOST_COMPANIONS = 3
_CHECK_BUDGET_S = 5.0


@dataclass(frozen=True)
class Contradiction:
    """The first visit at which displacements and axioms contradict each other.

    Attributes
    ----------
    visit : that visit. place : first visit of the place where it lies.
    surprise_nats : how much more probable this closure would be than what the best map says.
    doubts : the smallest sets of observations which, if wrong, explain it, in words; empty if
        none was found in time.
    text : what clashes and what to doubt, in the user's names.
    """

    visit: int
    place: int
    surprise_nats: float
    doubts: tuple[tuple[str, ...], ...]
    text: str


def find_contradiction(experience: Experience, tree: MapTree, lead: Node) -> Contradiction | None:
    """Find the first visit that a map makes a new place though it lies on a known one.

    Parameters
    ----------
    experience : what the robot went through.
    tree, lead : the tree of its maps, and the best of them, of all visits or of the first ones.

    Returns
    -------
    Contradiction or None : None if there is no such visit, or no axiom refuses the closure, or
        so many places as there are may well hold a few that lie that near each other.

    Source
    ------
    Ours.
    """
    surprises = list(_list_surprises(tree, lead))
    chance = math.log(lead.places)
    if sum(max(surprise - chance, 0.0) for *_, surprise in surprises) < SURPRISE_NATS:
        return None
    for node, first, surprise in surprises:
        visit = node.visit
        seen = replace(experience, visits=experience.visits[: visit + 1])
        there = [v for v in _list_visits(node, first) if v != first][:_MOST_COMPANIONS]
        supposed = [f"v{v}=v{first}" for v in (visit, *there)]
        found = check(seen, supposed, planarity=tree.planarity, budget_s=_CHECK_BUDGET_S)
        if found.consistent is False and found.violations:
            kept = [r for r in found.repairs if not any("assumption" in one for one in r)]
            least = min(map(len, kept), default=0)
            doubts = tuple(r for r in kept if len(r) == least)
            return _tell(experience, visit, first, surprise, doubts, found.violations[0].text)
    return None


def tell_strains(experience: Experience, tree: MapTree, lead: Node) -> str:
    """Say which displacements speak against the best map; '' if none does.

    Where the axioms leave one place only, a displacement that contradicts it is outvoted, however
    little it agrees; that is told, not hidden.

    Parameters
    ----------
    experience, tree, lead : as for :func:`find_contradiction`.

    Source
    ------
    Ours.
    """
    least = -math.log(tree.score.area_m2) - STRAIN_NATS
    strained = [n for n in lead.chain()[2:] if not n.is_new and n.addends.layout < least]
    if not strained:
        return _tell_needless(experience, tree, lead)
    worst = min(strained, key=lambda node: (node.addends.layout, node.visit))
    name = experience.visit_label
    first = _list_visits(worst, worst.visit)[0]
    more = len(strained) - 1
    others = f" ({more} more as well)" if more else ""
    return (
        f"The displacement from {name(worst.visit - 1)} to {name(worst.visit)} speaks against "
        f"{name(worst.visit)} being the place of {name(first)} by "
        f"{-worst.addends.layout:.0f} nats{others}, but nothing else fits better; doubt it."
    )


def _tell_needless(experience: Experience, tree: MapTree, lead: Node) -> str:
    """Say which two visits on one spot the best map keeps apart though no axiom asks for it."""
    for node, first, surprise in _list_surprises(tree, lead):
        name = experience.visit_label
        return (
            f"{name(node.visit)} lies where {name(first)} is, but what was observed later keeps "
            f"the two apart, against {surprise:.0f} nats: doubt the displacement to "
            f"{name(node.visit)}, or what came later."
        )
    return ""


def _list_surprises(tree: MapTree, lead: Node) -> Iterator[tuple[Node, int, float]]:
    """Yield the visits that a map makes new places though they lie on known ones.

    Each with the first visit of the known place, and by how much that is more probable [nats].
    """
    for node in lead.chain()[2:]:
        if not node.is_new or node.addends.exclusion > _NARROW_NATS or node.parent is None:
            continue
        place, worth = tree.find_place_under(node.parent)
        surprise = worth - sum(node.addends)
        if surprise >= SURPRISE_NATS:
            yield node, tree.state_of(node.parent).firsts[place], surprise


def _list_visits(node: Node, first: int) -> list[int]:
    """Return the visits that a map puts at the place of a visit."""
    chain = node.chain()[1:]
    place = chain[first].decision.place
    return [one.visit for one in chain if one.decision.place == place]


def _tell(
    experience: Experience,
    visit: int,
    place: int,
    surprise: float,
    doubts: tuple[tuple[str, ...], ...],
    clash: str,
) -> Contradiction:
    name = experience.visit_label
    text = f"{name(visit)} lies where {name(place)} is, but {clash}"
    if doubts:
        text += f" The least to doubt: {', or '.join(' and '.join(one) for one in doubts)}."
    return Contradiction(visit, place, surprise, doubts, text)
