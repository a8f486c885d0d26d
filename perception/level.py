"""The level of a map: which gateways count, corridors only or doors too.

Doors are *conditional* gateways: somebody who looks for an office minds them, somebody who follows
a corridor does not. So they are found like all others, and left out afterwards where they do not
count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from perception.continuity import read_stars
from perception.errors import InputError
from perception.gateways import Gateway
from perception.geometry import Array
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


def filter_gateways(
    topology: LocalTopology,
    level: Level,
    resolution_m: float,
    way_px: Array | None = None,
) -> LocalTopology:
    """Leave out the gateways that do not count at a level, and read the star anew.

    Parameters
    ----------
    topology : as found. resolution_m : side of its pixels.
    way_px : (n, 2) points that the robot drove by, pixels, in order; a gateway that it went
        through counts whatever it is like.

    Returns
    -------
    The same object if all of them count.

    Source
    ------
    Ours.
    """
    if level.admits_all:
        return topology
    kept = tuple(
        g
        for g in topology.gateways
        if level.admits(
            g.width_px * resolution_m,
            g.frontier_px * resolution_m if g.frontier_px > 0 else math.inf,  # a loop
            g.depth_px * resolution_m if g.frontier_px > 0 else math.inf,
        )
        or (way_px is not None and is_crossed(g, way_px))
    )
    if len(kept) == len(topology.gateways):
        return topology
    x, y = topology.base_px.mean(axis=0).tolist()
    readings = read_stars(kept, (x, y))
    at_place = readings[0].star.alpha != (1, 1)
    return replace(topology, gateways=kept, readings=readings, at_place=at_place)


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
