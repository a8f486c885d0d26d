"""What kind of gateway a constriction is: door, mouth of a room or way, or mere narrowing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from perception.constrictions import Constriction
from perception.doors import DoorEvidence, DoorRule, find_doors, find_things, gather_evidence
from perception.floor_space import FloorSpace
from perception.geometry import Array
from perception.skeleton import Branch, Skeleton

GatewayKind = Literal["door", "mouth", "narrowing"]

_SAME_CELLS = 3
_PARTNER_M = (0.5, 6.0)
_PARTNER_SHIFT_M = 0.4
_PARTNER_COSINE = 0.94
_PARTNER_WIDTH = 1.3


@dataclass(frozen=True)
class MouthRule:
    """What makes a constriction the mouth of a room, bay or way.

    Both ends are corners of wall, which the skeleton passes in an arc: so many degrees about the
    one, and about the other. A mouth into a closed space needs less than one between two spaces
    that are joined elsewhere too; and there the corridor itself, which has gaps alike before and
    behind it, is told apart. Two more kinds are in line with a wall: the gap between the tip of a
    wall, which the skeleton turns back about, and a flat wall (``tip``); and a gap plainly narrower
    than what lies before and behind it (``line``).

    Source
    ------
    Ours; the arcs are what Beeson 2008, Algorithm 6.4, calls anchors. Measured on the rooms of
    tests/bench/bench_floor_maps.py.
    """

    closed_opening: float = 1.05
    closed_arc_deg: float = 25.0
    closed_other_arc_deg: float = 70.0
    joined_opening: float = 1.1
    joined_arc_deg: float = 45.0
    joined_other_arc_deg: float = 75.0
    sure_opening: float = 1.5
    sure_arc_deg: float = 30.0
    tip_opening: float = 1.25
    tip_arc_deg: float = 110.0
    tip_in_line: float = 0.6
    line_opening: float = 1.35
    line_arc_deg: float = 28.0
    line_in_line: float = 0.9
    line_width_m: float = 2.6
    least_area_m2: float = 1.0
    most_closed_area_m2: float = 60.0
    thing_m: float = 1.5
    width_m: float = 4.0


_NARROWING = 1.2


def tell_kinds(
    space: FloorSpace,
    skeleton: Skeleton,
    constrictions: Sequence[Constriction],
    *,
    door_rule: DoorRule | None = None,
    mouth_rule: MouthRule | None = None,
) -> tuple[GatewayKind | None, ...]:
    """Return the kind of each constriction; None if it is hardly one."""
    if not constrictions:
        return ()
    evidence = gather_evidence(space, skeleton, constrictions)
    door = find_doors(constrictions, evidence, door_rule)
    mouth = find_mouths(space, skeleton, constrictions, evidence, mouth_rule)
    kinds = list[GatewayKind | None]()
    for one, is_door, is_mouth in zip(constrictions, door, mouth, strict=True):
        if is_door or is_mouth:
            kinds.append("door" if is_door else "mouth")
        else:
            kinds.append("narrowing" if one.opening >= _NARROWING else None)
    return tuple(kinds)


def find_mouths(
    space: FloorSpace,
    skeleton: Skeleton,
    constrictions: Sequence[Constriction],
    evidence: DoorEvidence,
    rule: MouthRule | None = None,
) -> NDArray[np.bool_]:
    """Tell of each constriction whether it is a mouth; some doors are too."""
    rule = rule or MouthRule()
    width = np.array([c.width_m for c in constrictions])
    opening = np.array([c.opening for c in constrictions])
    arcs = [_measure_arcs(space, skeleton.branches[c.branch], c.point) for c in constrictions]
    less, more = np.sort(np.array(arcs), axis=1).T
    area = evidence.area_m2
    closed = (area >= rule.least_area_m2) & (area < rule.most_closed_area_m2)
    alone = ~_has_partner(constrictions, space.resolution_m) | (opening > rule.sure_opening)
    mouth = closed & (opening >= rule.closed_opening)
    mouth &= (less > rule.closed_arc_deg) & (more > rule.closed_other_arc_deg)
    joined = ~closed & alone & (opening >= rule.joined_opening)
    joined &= (less > rule.joined_arc_deg) & (more > rule.joined_other_arc_deg)
    sure = (opening >= rule.sure_opening) & (less > rule.sure_arc_deg) & (alone | closed)
    in_line = np.minimum(evidence.in_line, evidence.in_line_near)
    line = (opening >= rule.line_opening) & (less > rule.line_arc_deg)
    line &= in_line >= rule.line_in_line
    tip = (opening >= rule.tip_opening) & (more > rule.tip_arc_deg) & (in_line >= rule.tip_in_line)
    mouth |= joined | sure | ((line | tip) & (width < rule.line_width_m))
    mouth &= ~find_things(evidence, rule.thing_m) & (width < rule.width_m)
    return np.asarray(mouth & (area >= 0.8 * rule.least_area_m2))


def _measure_arcs(space: FloorSpace, branch: Branch, i: int) -> tuple[float, float]:
    """Return the arc (degrees) in which a branch passes the nearest wall cell on either side."""
    arcs = []
    for side in (branch.left, branch.right):
        far = np.abs(side - side[i]) > _SAME_CELLS
        before, after = np.flatnonzero(far[:i]), np.flatnonzero(far[i:])
        first = int(before[-1]) + 1 if len(before) else 0
        last = i + int(after[0]) - 1 if len(after) else len(side) - 1
        corner = space.region.walls[side[i]]
        (ax, ay), (bx, by) = (branch.points_px[[first, last]] - corner).tolist()
        arcs.append(abs(math.degrees(math.atan2(ax * by - ay * bx, ax * bx + ay * by))))
    return arcs[0], arcs[1]


def _has_partner(constrictions: Sequence[Constriction], resolution_m: float) -> NDArray[np.bool_]:
    """Tell whether there is a gap alike straight before or behind each: a corridor's own width."""
    ends: Array = np.array([c.ends_px for c in constrictions], float) * resolution_m
    centre = ends.mean(axis=1)
    across = ends[:, 1] - ends[:, 0]
    length = np.maximum(np.hypot(*across.T), 1e-9)
    across = across / length[:, None]
    width = np.array([c.width_m for c in constrictions])
    found = np.zeros(len(centre), bool)
    for i in range(len(centre)):
        gap = centre - centre[i]
        ahead = np.abs(gap @ np.array([-across[i, 1], across[i, 0]]))
        alike = (ahead > _PARTNER_M[0]) & (ahead < _PARTNER_M[1])
        alike &= np.abs(gap @ across[i]) < _PARTNER_SHIFT_M
        alike &= np.abs(across @ across[i]) > _PARTNER_COSINE
        ratio = width / width[i]
        found[i] = bool((alike & (ratio < _PARTNER_WIDTH) & (ratio > 1 / _PARTNER_WIDTH)).any())
    return found
