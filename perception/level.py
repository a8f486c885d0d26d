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
from perception.grid import OCCUPIED, Image
from perception.topology import LocalTopology

Doors = Literal["keep", "ignore"]


@dataclass(frozen=True)
class Level:
    """What a gateway must be like to count.

    Attributes
    ----------
    doors : ``"ignore"`` leaves out what is known to be a door, however wide.
    min_width_m : narrower gateways do not count.
    min_frontier_m : nor those that lead only to narrower frontiers.
    min_depth_m : nor those that lead less far.
    door_share, door_m : nor those narrower than both ``door_m`` and this share of the path that
        the robot came and went by: a door is narrower than the corridor it opens from.

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
    >>> half = Level(door_share=0.5)
    >>> half.admits(0.9, path_m=2.0), half.admits(0.9, path_m=1.6), half.admits(1.4, path_m=5.0)
    (False, True, True)
    """

    doors: Doors = "ignore"
    min_width_m: float = 0.0
    min_frontier_m: float = 0.0
    min_depth_m: float = 0.0
    door_share: float = 0.0
    door_m: float = 1.3

    def __post_init__(self) -> None:
        if self.doors not in ("keep", "ignore"):
            raise InputError(f"doors={self.doors!r}: expected 'keep' or 'ignore'")
        for name in ("min_width_m", "min_frontier_m", "min_depth_m", "door_share", "door_m"):
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
        path_m: float = 0.0,
    ) -> bool:
        """Tell whether a gateway counts.

        Parameters
        ----------
        width_m, frontier_m, depth_m : of the gateway; infinite where not known.
        is_door : whether it is known to be a door.
        path_m : width of the path it opens from; 0 where not known.
        """
        if is_door and self.doors == "ignore":
            return False
        return (
            width_m >= max(self.min_width_m, min(self.door_share * path_m, self.door_m))
            and frontier_m >= self.min_frontier_m
            and depth_m >= self.min_depth_m
        )

    @property
    def admits_all(self) -> bool:
        """Whether no limit is set."""
        limits = self.min_width_m, self.min_frontier_m, self.min_depth_m, self.door_share
        return max(limits) <= 0


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
    driven = [g for g in topology.gateways if way_px is not None and is_crossed(g, way_px)]
    path_m = min((g.neck_px for g in driven), default=0.0) * resolution_m
    shut = [
        g
        for g in topology.gateways
        if g not in driven
        and not level.admits(
            g.neck_px * resolution_m,
            g.frontier_px * resolution_m if g.frontier_px > 0 else math.inf,  # a loop
            g.depth_px * resolution_m if g.frontier_px > 0 else math.inf,
            path_m=path_m,
        )
    ]
    if not shut:
        return None
    closed = image.copy()
    for gateway in shut:
        one, other = (tuple(round(v) for v in end) for end in gateway.ends_px)
        cv2.line(closed, one, other, OCCUPIED, 1)
    return closed


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
