"""How sure gateways are, from what the robot did and from how far it saw through them.

A lidar that looks forward sees of a way beside or behind it no more than a sliver. The robot cannot
pass there as far as it has seen, so the skeleton ends early; but what is free in line beyond the
gateway tells a way from a niche. What nobody could look into may be either: it stays in doubt, and
with it the star. And a gateway that the robot went through is one.

Source: ours; it stands for the turn on the spot that Beeson 2008, 5.3.2, asks of a robot whose
lidar sees a half circle, where the drive is over and cannot be changed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from perception.continuity import StarReading, read_stars
from perception.gateways import Gateway, rate_way
from perception.geometry import Array
from perception.grid import Cells, Image, Mask, classify
from perception.level import is_crossed
from perception.region import Index
from perception.sight import look_along, measure_looks
from perception.topology import LocalTopology

_WIDER = 1.1
"""Gateways so many times wider than the narrowest frontier that counts are no doors left ajar."""

_SEEN_FAR, _SEEN_SPREAD = 2.0, 0.35
"""A way seen so many times the least depth straight on is even odds: an alcove is no deeper; and
how fast the odds grow with what is seen."""

_ALCOVE = 1.25
"""An alcove whose end is seen is no deeper than so many times its width."""

_HIDDEN = 0.5
"""Odds even: of a way that nobody could look into, no wall is known to end it."""

_UNDRIVEN = 0.94
"""Surest that a way is where the robot did not drive: of the arms of a crossing about one in twenty
is missing, or too much, in what another passage shows (recorded logs)."""

_DEAD_END = 0.3
"""How much less likely it is that a path ends in a place than that it goes on, where one way on is
in doubt: corners are many, dead ends are few (recorded logs)."""

_FAN_RAD = np.radians(np.arange(-60.0, 61.0, 10.0))
"""Directions in which one looks out of a gateway for a way that does not go on straight."""

_STARTS = np.linspace(0.1, 0.9, 9)
"""Shares of the width of a gateway from which one looks out of it."""


def weigh_gateways(
    topology: LocalTopology,
    image: Image,
    way_px: Array,
    *,
    min_frontier_px: float,
    min_depth_px: float,
    is_over: bool = False,
) -> LocalTopology:
    """Read the star anew, with gateways as sure as what the robot did and saw makes them.

    Parameters
    ----------
    topology : as found in the image.
    way_px : (n, 2) points the robot drove by, pixels, in order.
    min_frontier_px, min_depth_px : a frontier so wide, or a way so far, is even odds; more is more.
    is_over : the robot has left: where it did not look, how far a way leads says nothing.
    """
    if not topology.gateways:
        return topology
    cells, limits = classify(image), (min_frontier_px, min_depth_px)
    gateways = tuple(
        replace(g, confidence=_confide(g, cells, way_px, limits, is_over))
        for g in topology.gateways
    )
    x, y = topology.base_px.mean(axis=0).tolist()
    readings = _doubt_dead_ends(read_stars(gateways, (x, y)))
    return replace(topology, gateways=gateways, readings=readings)


def _doubt_dead_ends(readings: tuple[StarReading, ...]) -> tuple[StarReading, ...]:
    """Return the readings, surest first, those of a dead end less sure beside others."""
    weights = [r.weight * (_DEAD_END if sum(r.star.alpha) == 1 else 1.0) for r in readings]
    total = sum(weights)
    told = [replace(r, weight=w / total) for r, w in zip(readings, weights, strict=True)]
    return tuple(sorted(told, key=lambda r: -r.weight))


def _confide(
    gateway: Gateway, cells: Cells, way_px: Array, limits_px: tuple[float, float], is_over: bool
) -> float:
    """Return the probability that a way leads out of a gateway."""
    min_frontier_px, min_depth_px = limits_px
    if gateway.frontier_px <= 0 or is_crossed(gateway, way_px):
        return 1.0
    depth, seen = gateway.depth_px, see_beyond(gateway, cells.free)
    if gateway.width_px >= _WIDER * min_frontier_px:
        depth = max(depth, seen)
    sure = rate_way(gateway.frontier_px, depth, min_frontier_px, min_depth_px)
    if min_depth_px > 0:
        hidden, alcove = share_hidden(gateway, cells), _ALCOVE * gateway.width_px
        far = hidden * _is_far(seen, 0.0, min_depth_px)
        far += (1.0 - hidden) * _is_far(seen, alcove, min_depth_px)
        unseen = sure
        if is_over:
            unseen = rate_way(
                gateway.frontier_px, max(depth, 2.0 * min_depth_px), min_frontier_px, min_depth_px
            )
        sure = max(sure * far, unseen * _HIDDEN * hidden)
    return min(sure, _UNDRIVEN)


def _is_far(seen_px: float, alcove_px: float, min_depth_px: float) -> float:
    """Return the probability that what is seen so far is a way, not an alcove of that depth."""
    over = seen_px - max(_SEEN_FAR * min_depth_px, alcove_px)
    return 1.0 / (1.0 + math.exp(-max(min(over / (_SEEN_SPREAD * min_depth_px), 60.0), -60.0)))


def see_beyond(gateway: Gateway, free: Mask) -> float:
    """Return how far the space beyond a gateway is seen to reach, straight out or aslant, in cells.

    Aslant the width of the gateway does not count: so much more one sees in any alcove that is as
    wide, from one of its corners to the other.

    Parameters
    ----------
    free : (H, W) mask of the free cells.

    Source
    ------
    Ours.
    """
    aslant = see_through(gateway, free, _FAN_RAD) - gateway.width_px
    return max(see_through(gateway, free), aslant)


def share_hidden(gateway: Gateway, cells: Cells) -> float:
    """Return the share of the looks straight out of a gateway that end at unknown cells.

    What ends there is not seen to end: something hides it, or the robot looked elsewhere.

    Source
    ------
    Ours.
    """
    solid = cv2.dilate(cells.occupied.view(np.uint8), np.ones((3, 3), np.uint8))
    x, y, on = _look_out(gateway, cells.free, np.zeros(1))
    first = np.argmin(on, axis=-1)[:, 0]
    looks = np.arange(len(first))
    stop = solid[
        np.clip(y[looks, 0, first], 0, len(solid) - 1),
        np.clip(x[looks, 0, first], 0, solid.shape[1] - 1),
    ]
    return float(np.mean((stop == 0) | on[:, 0].all(axis=-1)))


def see_through(gateway: Gateway, free: Mask, turns_rad: Array | None = None) -> float:
    """Return how far free cells go on out of a gateway, in cells; off the grid, for ever.

    Parameters
    ----------
    free : (H, W) mask of the free cells.
    turns_rad : (k,) directions to look in, from straight out; straight out alone by default.
    """
    _, _, on = _look_out(gateway, free, np.zeros(1) if turns_rad is None else turns_rad)
    return float(measure_looks(on).max())


def _look_out(gateway: Gateway, free: Mask, turns_rad: Array) -> tuple[Index, Index, Mask]:
    """Return (starts, k, steps) columns, rows, and whether they are free, of looks out of it."""
    one, other = np.array(gateway.ends_px, float)
    starts = one + _STARTS[:, None] * (other - one)
    return look_along(starts, gateway.outward_rad + turns_rad, free)
