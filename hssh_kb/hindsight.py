"""Where a complete map shows, looking back, that it went wrong.

A wrong map seldom breaks an axiom; it makes do: it holds two places where there is one, on top of
each other, or takes closures that fit badly. In the true map that is rare. Where it happens often
in a row, a closure not long before was wrong, and the right map waits there, behind maps that
seemed better at the time.

Source: ours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from hssh_kb.node import Node
from hssh_kb.score import Score

_ROOM_NATS = 1.0  # a new place that leaves the known ones less room than that is strange
_FIT_NATS = 3.0  # a closure so much less probable than a new place is strange
_TURN_NATS = 1.0  # so are headings that cost more
_STRANGE_NATS = 4.0  # in one stretch: then it is worth looking back
LOOKED_AT = 20
"""Visits that may be strange for one reason."""
_BEFORE = 40  # visits before them among which the mistake is looked for
_OFTEN = 2  # times that one stretch is looked into


class Stretch(NamedTuple):
    """Visits to look back at: from ``start`` up to ``end``; strange from ``strange`` on."""

    start: int
    end: int
    strange: Node


def rate_strangeness(node: Node, new_nats: float) -> float:
    """Return by how much [nats] what a map says of its latest visit is stranger than usual.

    Parameters
    ----------
    node : the map.
    new_nats : layout addend of a new place.
    """
    addends = node.addends
    if node.is_new:
        return max(0.0, -addends.exclusion - _ROOM_NATS)
    fit = max(0.0, new_nats - addends.layout - _FIT_NATS)
    return fit + max(0.0, -addends.heading - _TURN_NATS)


def find_strange_stretch(
    lead: Node | None, since: int, score: Score, tried: dict[int, int]
) -> Stretch | None:
    """Return the first stretch of a map that is strange and was not looked into often.

    Parameters
    ----------
    lead : the map; None if there is none.
    since : the first visit to look at.
    score : parameters of the log posterior.
    tried : serial of the first strange node of a stretch -> how often it was looked into; counted
        up for the stretch returned.
    """
    chain, node = list[Node](), lead
    while node is not None and node.visit >= max(since, 0):
        chain.append(node)
        node = node.parent
    chain.reverse()
    new_nats = -math.log(score.area_m2)
    odd = [rate_strangeness(one, new_nats) for one in chain]
    for k, one in enumerate(chain):
        if odd[k] == 0 or sum(odd[k : k + LOOKED_AT]) < _STRANGE_NATS:
            continue
        if tried.get(one.serial, 0) < _OFTEN:
            tried[one.serial] = tried.get(one.serial, 0) + 1
            end = min(one.visit + LOOKED_AT, chain[-1].visit)
            return Stretch(max(0, one.visit - _BEFORE), end, one)
    return None
