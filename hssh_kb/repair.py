"""Repairs: when the axioms refuse a closure that the displacements call for, change their mind.

A refusal names the travels and the readings it rests on. A repair takes a map, doubts one of
those travels or reads a place by another of its stars, and carries the rest of the map over
unchanged; so a refuted favourite gives way to its nearest consistent relative at once,
instead of after thousands of leaves that share its mistake.

Source: ours.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hssh_kb.map_tree import MapTree
from hssh_kb.node import Decision, Node, Option

_WORTH_NATS = 4.0
_MOST_TRAVELS = 6


@dataclass(frozen=True)
class Repair:
    """A map to be made from another by changing one earlier decision.

    Attributes
    ----------
    donor : the map to change.
    doubt : travel to doubt, or -1.
    place, reading : place to read anew and as what, or -1.
    decision : how to take the visit after the donor, offset and reading to be found anew if
        the place was read anew.
    estimate : log posterior to expect.
    """

    donor: Node
    doubt: int
    place: int
    reading: int
    decision: Decision
    estimate: float

    @property
    def key(self) -> tuple[object, ...]:
        """What tells this repair from others."""
        return self.donor.serial, self.doubt, self.place, self.reading, self.decision

    def carry_out(self, tree: MapTree) -> Node:
        """Return the repaired map, as far as it can stand."""
        chain = self.donor.chain()[1:]
        node = chain[0].parent
        if node is None:
            return self.donor
        first = next((one.visit for one in chain if one.decision.place == self.place), -1)
        for one in chain:
            further = self._take(tree, node, one.visit, one.decision, first)
            if further is None:
                return node
            node = further
        return self._take(tree, node, self.donor.visit + 1, self.decision, first) or node

    def _take(
        self, tree: MapTree, node: Node, v: int, decision: Decision, first: int
    ) -> Node | None:
        """Return the node after one more visit, as in the donor but for the change."""
        if v == first:
            decision = decision._replace(reading=self.reading)
        elif v == self.doubt:
            decision = decision._replace(doubted=True)
        if v == 0:
            if node.children is None:
                return None
            return node.children.get(decision)
        known = node.children.get(decision) if node.children else None
        changed = self.place >= 0 and decision.place == self.place and v != first
        if known is not None and not changed:
            return known
        best: Option | None = None
        for choice in self._choices(tree, v, first, decision) if changed else (decision,):
            option = tree.weigh(node, choice)
            if option is not None and option.refusal is None:
                worth = sum(option.addends)
                if best is None or worth > sum(best.addends):
                    best = option
        return None if best is None else tree.child(node, best)

    def _choices(self, tree: MapTree, v: int, first: int, decision: Decision) -> Iterator[Decision]:
        for i in range(len(tree.visits[v].readings)):
            for offset in tree.isomorphisms(v, i, first, self.reading):
                yield Decision(decision.place, offset, i, decision.doubted)


class RepairQueue:
    """Repairs that wait to be carried out, each noted once."""

    def __init__(self) -> None:
        self._waiting: dict[int, list[tuple[float, int, Repair]]] = {}
        self._seen: set[tuple[object, ...]] = set()

    def add(self, repair: Repair) -> None:
        """Note a repair."""
        if repair.key in self._seen:
            return
        self._seen.add(repair.key)
        promise = repair.estimate + repair.donor.worth - repair.donor.score
        waiting = self._waiting.setdefault(repair.donor.visit + 1, [])
        heapq.heappush(waiting, (-promise, len(self._seen), repair))

    def take(self, depth: int, least: float) -> Repair | None:
        """Take out the repair that promises the best map of a depth; None if below the least."""
        waiting = self._waiting.get(depth)
        if not waiting or -waiting[0][0] < least:
            return None
        return heapq.heappop(waiting)[2]


def propose_repairs(
    tree: MapTree, node: Node, options: Iterable[Option], best: float, fixed: int
) -> Iterator[Repair]:
    """Yield the repairs that a map's refused ways to take the next visit call for.

    Parameters
    ----------
    tree, node : the map.
    options : the ways, refused ones among them.
    best : what the best way that is not refused adds to the score.
    fixed : the only place that travel allows, -1 if it fixes none.
    """
    slip = tree.score.slip
    known = tree.state_of(node), node.visit
    price = tree.weigh_doubt(*known, True) - tree.weigh_doubt(*known, False)
    for option in options:
        worth = sum(option.addends)
        if option.refusal is None or worth + price < best - _WORTH_NATS or not slip:
            continue
        for travel in option.refusal.travels[-_MOST_TRAVELS:]:
            estimate = node.score + worth + price
            yield Repair(node, travel, -1, -1, option.decision, estimate)
    yield from _propose_readings(tree, node, best, fixed)


def _propose_readings(tree: MapTree, node: Node, best: float, fixed: int) -> Iterator[Repair]:
    """Yield the repairs that read a place anew so that the next visit can be it."""
    if not tree.has_alternatives:
        return
    state, v = tree.state_of(node), node.visit + 1
    worth = tree.score.expect_closures(tree.predict(state, v))
    held = tree.predict(state, v).filter.places
    for slot in np.flatnonzero(worth > best - 2 * _WORTH_NATS).tolist():
        place = int(held[slot])
        if fixed not in (-1, place):
            continue
        first, current = state.firsts[place], state.place_readings[place]
        stars = tree.visits[first].readings
        if len(stars) == 1:
            continue
        for j in sorted(range(len(stars)), key=lambda j: -stars[j].weight):
            swap = math.log(stars[j].weight / stars[current].weight)
            if j == current:
                continue
            for i, reading in enumerate(tree.visits[v].readings):
                if not tree.isomorphisms(v, i, first, j):
                    continue
                if tree.isomorphisms(v, i, first, current) and swap < 0:
                    continue
                estimate = node.score + float(worth[slot]) + swap + math.log(reading.weight)
                yield Repair(node, -1, place, j, Decision(place, 0, i, False), estimate)
                break
