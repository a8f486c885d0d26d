"""The nodes of the tree of maps: one map after visits 0..v, its latest decision, its state.

A node knows its parent and its own decision; the full state (judge and filter) hangs on the
nodes used last only.

Source: Beeson 2008, Algorithm 8.1; readings and doubts: ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from hssh_kb.consistency import MapState, Refusal
from hssh_kb.place_filter import PlaceFilter, Prediction
from hssh_kb.score import Addends

GATE_NATS = 14.0
NOTHING = Addends(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


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
    """Everything one map says, for growing it; never changed once made.

    Attributes
    ----------
    doubts : how many travels are doubted.
    """

    judge: MapState
    filter: PlaceFilter
    place: int
    offset: int
    reading: int
    firsts: tuple[int, ...]
    place_readings: tuple[int, ...]
    bearings: tuple[complex, ...]
    doubts: int = 0
    prediction: Prediction | None = None
    newness: tuple[float, float] | None = None


class Node:
    """One map after visits 0..v.

    Attributes
    ----------
    stage : how often it was grown; the rest of the ways on may be put off.
    queued : it waits or has waited; ``waits`` : it does so now.
    worth : the score without the prior on places: a map with fewer of them has more of it
        still to pay, so maps of the same visits are compared without.
    heirs : children that live, and 1 if it waits; it lives as long as there are any.
    dead : it was refuted.
    """

    __slots__ = (
        "addends",
        "children",
        "dead",
        "decision",
        "heirs",
        "parent",
        "places",
        "queued",
        "score",
        "serial",
        "stage",
        "state",
        "visit",
        "waits",
        "worth",
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
        self.worth: float = (parent.worth if parent else 0.0) + sum(addends) - addends.places
        self.stage = 0
        self.queued = self.waits = self.dead = False
        self.heirs = 0
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


def replace_doubt(decision: Decision) -> Decision:
    """Return the decision with its travel doubted."""
    return decision._replace(doubted=True)
