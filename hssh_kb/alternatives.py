"""What else might be: how the ranked maps stand to an assumption that no axiom forbids."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hssh_kb.check import parse_assumption
from hssh_kb.congruence import Assumption
from hssh_kb.maps import minimal_maps
from hssh_kb.ranking import count_map, measure_map

if TYPE_CHECKING:
    from hssh_kb.hypothesis import Hypothesis
    from hssh_kb.kb import KnowledgeBase


@dataclass(frozen=True)
class Standing:
    """How ranked maps stand to assumptions.

    Attributes
    ----------
    maps : numbers of the ranked maps in which all assumptions hold. of : how many maps there are.
    text : one sentence.
    """

    maps: tuple[int, ...]
    of: int
    text: str


def find_standing(kb: KnowledgeBase, assumptions: Sequence[str], number: int = 1) -> Standing:
    """Say in which of the ranked maps assumptions such as ``v7=v2`` hold, and how far map 1 is off.

    Raises
    ------
    InputError : an assumption that cannot be read.
    """
    supposed = [parse_assumption(kb.experience, text) for text in assumptions]
    maps = tuple(
        i for i, h in enumerate(kb.hypotheses, 1) if all(_holds(h, a) is True for a in supposed)
    )
    return Standing(maps, len(kb.hypotheses), _tell_standing(kb, supposed, maps, number))


def tell_possible(
    kb: KnowledgeBase, visit: int, earlier: int, number: int = 1, budget_s: float = 5.0
) -> str:
    """Say what became of it that two visits may be one place: in which map they are, or its price.

    Parameters
    ----------
    kb : the ranked maps.
    visit, earlier : two visits that no axiom keeps apart.
    number : the map to compare with.
    budget_s : seconds to spend on the best map in which they are one place.

    Source
    ------
    Ours.
    """
    standing = find_standing(kb, [f"v{visit}=v{earlier}"], number)
    if standing.maps or kb.ranked_by == "posterior":
        return f"possible. {standing.text}"
    start = time.monotonic()
    policy = kb.ranked.policy
    supposed = [Assumption(visit, earlier, True, "")]
    found = minimal_maps(kb.experience, policy=policy, supposed=supposed, budget_s=budget_s)
    if not found.maps or time.monotonic() - start >= budget_s:
        return f"possible. {standing.text}"
    mine = kb.hypothesis(number)
    if measure_map(kb.experience, found.maps[0], policy) == measure_map(
        kb.experience, mine, policy
    ):
        return "possible, in another map that ties with this one"
    return (
        f"possible, but the best map in which they are one place has "
        f"{_tell_size(kb, found.maps[0])}, this one {_tell_size(kb, mine)}"
    )


def _holds(hypothesis: Hypothesis, assumption: Assumption) -> bool | None:
    visits = hypothesis.visits
    if max(assumption.one, assumption.other) >= len(visits):
        return None
    return (visits[assumption.one] == visits[assumption.other]) == assumption.same


def _tell_standing(
    kb: KnowledgeBase, supposed: Sequence[Assumption], maps: Sequence[int], number: int
) -> str:
    count = len(kb.hypotheses)
    it = "It holds" if len(supposed) == 1 else "They hold together"
    if maps and count == 1:
        return f"{it} in the one ranked map."
    if maps:
        shown = ", ".join(map(str, maps[:8])) + (", ..." if len(maps) > 8 else "")
        return f"{it} in {len(maps)} of the {count} ranked maps ({shown})."
    told = f"{it} in none of the ranked maps ({count})"
    far = [text for a in supposed if (text := _tell_distance(kb, a, number))]
    if far:
        return f"{told}; map {number} puts {' and '.join(far)}."
    return f"{told}."


def _tell_distance(kb: KnowledgeBase, assumption: Assumption, number: int) -> str:
    """Return how far apart a map puts two visits that are supposed to be one place."""
    layout, hypothesis = kb.layout(number), kb.hypothesis(number)
    if layout is None or not assumption.same or _holds(hypothesis, assumption) is not False:
        return ""
    index = {place: i for i, place in enumerate(hypothesis.places)}
    one, other = (hypothesis.visits[v] for v in (assumption.one, assumption.other))
    distance_m = math.dist(layout.poses[index[one], :2], layout.poses[index[other], :2])
    return f"v{assumption.one} (P{one}) and v{assumption.other} (P{other}) {distance_m:.1f} m apart"


def _tell_size(kb: KnowledgeBase, hypothesis: Hypothesis) -> str:
    paths, places = count_map(kb.experience, hypothesis)
    return f"{paths} path{'s' * (paths != 1)} and {places} place{'s' * (places != 1)}"
