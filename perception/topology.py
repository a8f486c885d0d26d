"""From a grid to gateways and star: the local topology around the robot."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from perception.continuity import Continuity, StarReading, rate_alignments, read_stars, tell_ends
from perception.core import Base, Core, find_core
from perception.denoise import mend_walls, remove_noise
from perception.errors import InputError
from perception.gateways import (
    Direction,
    Gateway,
    Method,
    find_gateway,
    needs_virtual_walls,
)
from perception.geometry import Array
from perception.grid import Image, Mask, classify
from perception.path_types import tell_end_types
from perception.pruning import find_side_gaps, prune
from perception.region import Region, close_exits, find_region
from perception.shapes import name_shape
from perception.skeleton import OPEN, Skeleton, build_skeleton
from perception.star import Star
from perception.virtual_walls import outline_reach

Point = tuple[float, float]


@dataclass(frozen=True, eq=False)
class LocalTopology:
    """Gateways and star of the surroundings of a robot; pixels, x right, y down.

    Attributes
    ----------
    gateways : by index; clockwise about the place.
    readings : ways to read the star, most probable first, at least one.
    at_place : False on a bare path, with two gateways on one local-path and no other; and while
        the robot is on the way to the dead end it sees ahead (the star is that of the dead end).
    base_px : (k, 2) base points of the place.
    base_radius_px : (k,) their distance to the nearest obstacle.
    junctions_px : (j, 2) junctions of the pruned skeleton.
    skeleton_px : (n, 2) points of the pruned skeleton.
    core : (n,) which of them lie in the core.
    closest_px : the point of the skeleton closest to the robot; None if there is no skeleton.
    robot_px : where the robot was taken to stand.
    inside : (H, W) the passable region.
    seconds : what it took.
    is_narrow : whether the place lies in a narrowing of a path, as in a door.
    """

    gateways: tuple[Gateway, ...]
    readings: tuple[StarReading, ...]
    at_place: bool
    base_px: Array
    base_radius_px: Array
    junctions_px: Array
    skeleton_px: Array
    core: Mask
    closest_px: Point | None
    robot_px: Point
    inside: Mask
    seconds: float
    is_narrow: bool = False

    @property
    def shape(self) -> str | None:
        """The name of the intersection, if it has one; see :mod:`perception.shapes`."""
        best = self.readings[0]
        return name_shape(best.star, best.headings_px, is_narrow=self.is_narrow)

    @property
    def star(self) -> Star:
        """The most probable reading of the star."""
        return self.readings[0].star


def local_topology(
    image: Image,
    *,
    robot_px: Point | None = None,
    resolution_m: float | None = None,
    robot_radius_m: float | None = None,
    method: Method = "anchor",
    direction: Direction = "fit",
    base: Base = "settled",
    continuity: Continuity = "angle",
    min_frontier_m: float | None = None,
    min_depth_m: float | None = None,
    midline_px: float | None = None,
    island_px: float | None = None,
    denoise: bool = True,
    way_px: Array | None = None,
    by_sight: bool = False,
) -> LocalTopology:
    """Find the gateways around a robot and the star they form.

    Parameters
    ----------
    image : (H, W) uint8, dark occupied, light free, middle grey unknown; row 0 at the top.
    robot_px : (column, row) of the robot; the middle of the image by default.
    resolution_m : side of a cell in metres; None for a plain image, whose robot is a point and
        which has no limits on exits.
    robot_radius_m : half the robot's width with some safety; 0.25 by default.
    method : gateways by ``"anchor"`` or by ``"constriction"``, both as published.
    direction : of gateways, by a ``"fit"`` to walls and sub-cell skeleton (ours), or by the
        published mean ``"heading"``.
    base : base points of a place without a junction: ``"settled"`` in its bend or dead end (ours),
        or as published the point of the skeleton ``"closest"`` to the robot.
    continuity : paths by mutual ``"angle"`` and offset (ours), or by the published ``"ray"`` test.
    min_frontier_m : narrower frontiers are no exits; 0.9 by default (corridor level).
    min_depth_m : exits must lie so far beyond their junction's disc; 1.0 by default.
    midline_px : M, beyond which the skeleton follows walls; a fifth of the smaller side by default.
    island_px : islands smaller than this are ignored; M by default.
    denoise : estimate the share of flipped cells and mend them.
    way_px : (n, 2) points the robot drove by, in order; where it has been it can pass.
    by_sight : exits need not let the robot pass for ``min_depth_m``, if one sees so far through.

    Returns
    -------
    LocalTopology

    Raises
    ------
    InputError : the image is not a grey uint8 image, or the robot stands outside it or in a wall.

    Source
    ------
    Beeson 2008, chapters 5 and 6.

    Examples
    --------
    >>> image = np.zeros((90, 90), np.uint8)
    >>> image[30:60, :] = image[:, 30:60] = 255
    >>> str(local_topology(image).star)
    'a+1 b+1 a-1 b-1'
    """
    started = time.perf_counter()
    scale = _scale(resolution_m, robot_radius_m, min_frontier_m, min_depth_m)
    _check_image(image)
    height, width = image.shape
    midline = midline_px if midline_px is not None else max(min(height, width) / 5.0, 3.0)
    cells = classify(image)
    if denoise:
        mended = remove_noise(cells)
        if mended is cells and scale["radius"] == 0:  # else vote or robot close small gaps
            mended = mend_walls(cells)
        cells = mended
    region = find_region(
        cells,
        robot_px if robot_px is not None else ((width - 1) / 2, (height - 1) / 2),
        radius_px=scale["radius"],
        min_frontier_px=scale["frontier"],
        island_px=island_px if island_px is not None else midline,
        way_px=way_px,
        by_sight=by_sight,
    )
    region, skeleton = _find_skeleton(region, midline, scale["depth"])
    if not _leads_anywhere(skeleton):
        return _enclosed(region, started)
    core = find_core(skeleton, region, base=base)
    gateways = _find_gateways(core, region, skeleton, (method, direction), scale)
    middle = core.base_px.mean(axis=0)
    readings = read_stars(gateways, (float(middle[0]), float(middle[1])), continuity=continuity)
    alone = sorted({one.gateways[0] for one in rate_alignments(readings) if len(one.gateways) == 1})
    if alone:
        ends = tell_end_types(gateways, core.base_px, region, midline, alone)
        gateways = tuple(
            replace(g, opposite_type=end) for g, end in zip(gateways, ends, strict=True)
        )
        readings = tell_ends(readings, ends)
    return _assemble(region, skeleton, core, gateways, readings, started)


def _find_gateways(
    core: Core,
    region: Region,
    skeleton: Skeleton,
    how: tuple[Method, Direction],
    scale: dict[str, float],
) -> tuple[Gateway, ...]:
    """Return the gateways on the arms of a core, clockwise about it."""
    x, y = core.base_px.mean(axis=0)
    method, direction = how
    virtual = None
    if method == "anchor" and needs_virtual_walls(core.arms):
        virtual = outline_reach(skeleton.branches, region)
    gateways = [
        find_gateway(
            arm,
            region,
            method=method,
            direction=direction,
            virtual=virtual,
            min_frontier_px=scale["frontier"],
            min_depth_px=scale["depth"],
        )
        for arm in core.arms
    ]
    return tuple(sorted(gateways, key=lambda g: math.atan2(g.centre_px[1] - y, g.centre_px[0] - x)))


def _find_skeleton(
    region: Region, midline_px: float, min_depth_px: float
) -> tuple[Region, Skeleton]:
    """Return the pruned skeleton, and the region without gaps in walls that look like exits."""
    while True:
        skeleton = prune(
            build_skeleton(region, midline_px=midline_px), region, min_depth_px=min_depth_px
        )
        gaps = find_side_gaps(skeleton, region, min_depth_px=min_depth_px)
        if not gaps or len(gaps) == len(region.exits):
            return region, skeleton
        region = close_exits(region, gaps)


def _scale(
    resolution_m: float | None,
    robot_radius_m: float | None,
    min_frontier_m: float | None,
    min_depth_m: float | None,
) -> dict[str, float]:
    """Return the lengths in cells."""
    given = {
        "robot_radius_m": robot_radius_m,
        "min_frontier_m": min_frontier_m,
        "min_depth_m": min_depth_m,
    }
    for name, value in given.items():
        if value is not None and not (math.isfinite(value) and value >= 0):
            raise InputError(f"{name} is {value}; expected metres, zero or more")
        if value and resolution_m is None:
            raise InputError(
                f"{name} is {value} m, but the side of a cell is not known; give resolution_m too"
            )
    if resolution_m is None:
        return {"radius": 0.0, "frontier": 0.0, "depth": 0.0}
    if not (math.isfinite(resolution_m) and resolution_m > 0):
        raise InputError(f"resolution_m is {resolution_m}; expected metres, more than zero")
    return {
        "radius": (0.25 if robot_radius_m is None else robot_radius_m) / resolution_m,
        "frontier": (0.9 if min_frontier_m is None else min_frontier_m) / resolution_m,
        "depth": (1.0 if min_depth_m is None else min_depth_m) / resolution_m,
    }


def _check_image(image: Any) -> None:  # noqa: ANN401
    if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype != np.uint8:
        shape = getattr(image, "shape", "no shape")
        kind = getattr(image, "dtype", type(image).__name__)
        raise InputError(
            f"a grid must be a grey image of rows x columns, uint8; found {shape}, {kind}"
        )
    if min(image.shape) < 3:
        raise InputError(
            f"a grid of {image.shape[1]} x {image.shape[0]} cells is too small; "
            "expected at least 3 x 3"
        )


def _leads_anywhere(skeleton: Skeleton) -> bool:
    """Tell whether the skeleton reaches an exit, or runs around something."""
    if any(node.exit is not None for node in skeleton.nodes.values()):
        return True
    return any(((b.left != OPEN) & (b.right != OPEN)).mean() > 0.5 for b in skeleton.branches)


def _enclosed(region: Region, started: float) -> LocalTopology:
    """Return the topology of a place without a way out, the whole world of its robot."""
    nothing = np.zeros((0, 2))
    return LocalTopology(
        (),
        read_stars((), (0.0, 0.0)),
        True,
        np.array([region.start], float),
        np.zeros(1),
        nothing,
        nothing,
        np.zeros(0, bool),
        None,
        (float(region.start[0]), float(region.start[1])),
        region.inside,
        time.perf_counter() - started,
    )


def _assemble(
    region: Region,
    skeleton: Skeleton,
    core: Core,
    gateways: tuple[Gateway, ...],
    readings: tuple[StarReading, ...],
    started: float,
) -> LocalTopology:
    points = skeleton.points_px
    junctions = [skeleton.nodes[j].point_px for j in skeleton.junctions()]
    best = readings[0].star
    topology = LocalTopology(
        gateways,
        readings,
        core.is_reached and best.alpha != (1, 1),
        core.base_px,
        core.base_radius_px,
        np.array(junctions, float).reshape(-1, 2),
        points,
        core.holds(points),
        core.closest_px,
        (float(region.start[0]), float(region.start[1])),
        region.inside,
        0.0,
        _is_narrow(core),
    )
    return replace(topology, seconds=time.perf_counter() - started)


def _is_narrow(core: Core) -> bool:
    """Tell whether a path widens to one and a half on both sides of its one base point."""
    if len(core.arms) != 2 or len(core.base_radius_px) != 1:
        return False
    here = float(core.base_radius_px[0])
    return all(
        float(arm.branch.radius_px[arm.branch.steps_px <= 4.0 * here].max()) >= 1.5 * here
        for arm in core.arms
    )


def topology_to_data(topology: LocalTopology, file: str) -> dict[str, Any]:
    """Return the entry of one image in a ``hssh.star/1`` document."""
    return {
        "file": file,
        "star": [str(dlp) for dlp in topology.star.dlps],
        "types": list(topology.readings[0].types),
        "shape": topology.shape,
        "gateways": [
            {
                "centre": _rounded(g.centre_px),
                "ends": [_rounded(end) for end in g.ends_px],
                "outward": round(g.outward_rad, 4),
                "width": round(g.width_px, 2),
                "frontier": round(g.frontier_px, 2),
                "depth": round(g.depth_px, 2),
                "confidence": round(g.confidence, 3),
                "kind": g.kind,
                "anchor": None if g.anchor_px is None else _rounded(g.anchor_px),
            }
            for g in topology.gateways
        ],
        "at_place": topology.at_place,
        "junctions": [_rounded((float(x), float(y))) for x, y in topology.junctions_px],
        "readings": [
            {
                "star": [str(dlp) for dlp in reading.star.dlps],
                "types": list(reading.types),
                "gateway_out": list(reading.gateway_out),
                "weight": round(reading.weight, 4),
            }
            for reading in topology.readings
        ],
        "alignments": [
            {"gateways": list(one.gateways), "confidence": round(one.confidence, 4)}
            for one in rate_alignments(topology.readings)
        ],
        "seconds": round(topology.seconds, 6),
    }


def _rounded(point: Point) -> list[float]:
    return [round(float(point[0]), 2), round(float(point[1]), 2)]
