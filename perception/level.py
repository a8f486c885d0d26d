"""The level of a map: which gateways count, corridors only or doors too.

Doors are *conditional* gateways: somebody who looks for an office minds them, somebody who follows
a corridor does not. So they are found like all others, and left out afterwards where they do not
count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from perception.errors import InputError
from perception.gateways import Gateway
from perception.geometry import Array
from perception.grid import OCCUPIED, Image, classify
from perception.topology import LocalTopology

Doors = Literal["keep", "ignore"]

_NECK_M = 1.0


@dataclass(frozen=True)
class Level:
    """What a gateway must be like to count.

    Attributes
    ----------
    doors : ``"ignore"`` leaves out what is known to be a door, however wide.
    min_width_m : narrower gateways do not count.
    min_frontier_m : nor those that lead only to narrower frontiers.
    min_depth_m : nor those that lead less far.

    Raises
    ------
    InputError : a limit is negative or no number, or ``doors`` is something else.

    Source
    ------
    "Conditional gateways": Beeson 2008, 10.1.1; the limits are ours.

    Examples
    --------
    >>> corridors = Level(min_width_m=1.2)
    >>> corridors.admits(0.9), corridors.admits(2.0), corridors.admits(2.0, is_door=True)
    (False, True, False)
    >>> Level(doors="keep").admits(0.9, is_door=True)
    True
    """

    doors: Doors = "ignore"
    min_width_m: float = 0.0
    min_frontier_m: float = 0.0
    min_depth_m: float = 0.0

    def __post_init__(self) -> None:
        if self.doors not in ("keep", "ignore"):
            raise InputError(f"doors={self.doors!r}: expected 'keep' or 'ignore'")
        for name in ("min_width_m", "min_frontier_m", "min_depth_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(f"{name} is {value}; expected metres, zero or more")

    def admits(
        self,
        width_m: float,
        frontier_m: float = math.inf,
        depth_m: float = math.inf,
        *,
        is_door: bool = False,
    ) -> bool:
        """Tell whether a gateway counts.

        Parameters
        ----------
        width_m, frontier_m, depth_m : of the gateway; infinite where not known.
        is_door : whether it is known to be a door.
        """
        if is_door and self.doors == "ignore":
            return False
        return (
            width_m >= self.min_width_m
            and frontier_m >= self.min_frontier_m
            and depth_m >= self.min_depth_m
        )

    @property
    def admits_all(self) -> bool:
        """Whether no limit is set."""
        return max(self.min_width_m, self.min_frontier_m, self.min_depth_m) <= 0


def close_gateways(
    image: Image,
    topology: LocalTopology,
    level: Level,
    resolution_m: float,
    way_px: Array | None = None,
) -> Image | None:
    """Shut the gateways that do not count at a level, as if each were a door.

    Parameters
    ----------
    image : (H, W) uint8, what the topology was found in.
    resolution_m : side of its cells.
    way_px : (n, 2) points that the robot drove by, pixels, in order; a gateway that it went
        through counts whatever it is like.

    Returns
    -------
    A copy of the image with walls across those gateways; None if all of them count.

    Source
    ------
    Ours. What lies behind a shut gateway is no part of the place any more: what was a crossing may
    be a bare path, a dead end may turn up behind it.
    """
    widths_px = measure_necks(image, topology, _NECK_M / resolution_m)
    shut = [
        g
        for g, width_px in zip(topology.gateways, widths_px, strict=True)
        if not level.admits(
            width_px * resolution_m,
            g.frontier_px * resolution_m if g.frontier_px > 0 else math.inf,  # a loop
            g.depth_px * resolution_m if g.frontier_px > 0 else math.inf,
        )
        and not (way_px is not None and is_crossed(g, way_px))
    ]
    if not shut:
        return None
    closed = image.copy()
    for gateway in shut:
        one, other = (tuple(round(v) for v in end) for end in gateway.ends_px)
        cv2.line(closed, one, other, OCCUPIED, 1)
    return closed


def measure_necks(image: Image, topology: LocalTopology, reach_px: float) -> list[float]:
    """Return how wide the way out of each gateway is where it is narrowest, in cells.

    Parameters
    ----------
    image : (H, W) uint8, what the topology was found in.
    reach_px : how far beyond a gateway one looks: an anchor may lie a little before the door.

    Source
    ------
    Ours.
    """
    clearance = cv2.distanceTransform(
        (~classify(image).occupied).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )
    points = topology.skeleton_px
    x, y = np.rint(points).astype(int).T
    radius = clearance[np.clip(y, 0, len(image) - 1), np.clip(x, 0, image.shape[1] - 1)]
    necks = []
    for g in topology.gateways:
        gap = points - g.centre_px
        ahead = gap @ np.array([math.cos(g.outward_rad), math.sin(g.outward_rad)])
        near = (np.hypot(*gap.T) <= reach_px) & (ahead > -1.5)
        narrowest = 2.0 * float(radius[near].min()) if near.any() else math.inf
        necks.append(min(narrowest, g.width_px))
    return necks


def is_crossed(gateway: Gateway, way_px: Array | Sequence[tuple[float, float]]) -> bool:
    """Tell whether a way (n, 2), in pixels, passes through a gateway."""
    points = np.asarray(way_px, float).reshape(-1, 2)
    one, other = np.array(gateway.ends_px, float)
    along = other - one
    side = _cross(along, points - one)
    steps = np.diff(points, axis=0)
    start, end = _cross(steps, one - points[:-1]), _cross(steps, other - points[:-1])
    return bool(((side[:-1] * side[1:] <= 0) & (start * end <= 0) & (side[:-1] != side[1:])).any())


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
