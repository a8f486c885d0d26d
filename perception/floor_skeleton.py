"""The extended Voronoi graph (EVG) of a whole floor, dead ends and rooms included.

The skeleton runs between neighbouring cells whose nearest walls lie far apart along the wall, or
on different walls; so it is one line wide, joined up by nature, and a rough wall bears no branch.
A corner of a room bears one; such leaves are pruned by how much wall they stand for.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.cracks import Cracks, Edges, find_nearest_walls, place_cracks
from perception.floor_pruning import prune_floor
from perception.floor_space import FloorSpace, measure_wall
from perception.skeleton import Skeleton, trace_branches
from perception.skeleton_graph import SkeletonGraph

LEAST_WALL_M = 1.0
"""The skeleton ends where the nearest walls are closer than this along the wall."""

DEEP = 1.25
"""A hall is open in its middle where a disc fits in that reaches this times M from the walls."""

LEAST_HALL_M = 4.0
"""The open middle of a hall is at least so long."""

_FREE_OF_WALLS = np.int32(-(1 << 24))


def build_floor_skeleton(space: FloorSpace, *, midline_m: float, robot_radius_m: float) -> Skeleton:
    """Build the skeleton of a floor, pruned to what leads somewhere.

    Parameters
    ----------
    midline_m : M; further than this from every wall the skeleton follows the walls at M.
    robot_radius_m : the skeleton stays at least so far from walls.

    Source
    ------
    Beeson 2008, 6.1.1 for what an EVG is; the residual along the wall after Ogniewicz and Kuebler
    1995; the construction between cells and the pruning rule are ours.
    """
    cracks = _find_cracks(space, midline_m / space.resolution_m, robot_radius_m)
    graph = SkeletonGraph(trace_branches(space.region, cracks))
    graph.keep_largest()
    graph.drop_tiny_loops()
    prune_floor(graph, space, robot_radius_m=robot_radius_m)
    return graph.to_skeleton()


def _find_cracks(space: FloorSpace, midline_px: float, robot_radius_m: float) -> Cracks:
    region, resolution = space.region, space.resolution_m
    side, nearest, distance = _find_sides(space, midline_px)
    wide = (distance >= robot_radius_m / resolution - 0.5) & region.inside
    height, width = side.shape
    least = LEAST_WALL_M / resolution
    cells, ways = [], []
    for down in (0, 1):
        a = (slice(0, height - down), slice(0, width - 1 + down))
        b = (slice(down, None), slice(1 - down, None))
        apart = cv2.absdiff(side[a], side[b]) > least
        apart &= wide[a]
        apart &= wide[b]
        cells.append(np.stack(np.nonzero(apart)))
        ways.append(np.full(cells[-1].shape[1], bool(down)))
    (y, x), is_down = np.concatenate(cells, axis=1), np.concatenate(ways)
    first, second = (y, x), (y + is_down, x + ~is_down)
    walls = [nearest[cell].astype(np.int64) for cell in (first, second)]
    open_ = [side[cell] <= _FREE_OF_WALLS for cell in (first, second)]
    keep = open_[0] | open_[1] | (measure_wall(space, *walls) > least)
    edges = Edges(*(part[keep] for part in (x, y, is_down, *walls, *open_)))
    return place_cracks(region, edges, 0.5, 0.5)


def _find_sides(
    space: FloorSpace, midline_px: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Return for each cell the position of its nearest wall cell, its index, the distance."""
    region = space.region
    distance, label, wall_of_label = find_nearest_walls(region.walls, region.inside.shape)
    nearest = np.take(wall_of_label, label)
    side = np.take(space.position, nearest)
    deep = (distance >= DEEP * midline_px - 0.5) & region.inside
    if deep.any():
        away = cv2.distanceTransform((~deep).view(np.uint8), cv2.DIST_L2, 5)
        open_ = (away <= (DEEP - 1) * midline_px) & region.inside
        _, *found = cv2.connectedComponentsWithStats(open_.view(np.uint8), connectivity=4)
        parts, stats = np.asarray(found[0], np.int32), np.asarray(found[1], np.int32)
        small = stats[:, 2:4].max(axis=1) < LEAST_HALL_M / space.resolution_m
        small[0] = True
        open_ &= ~small[parts]
        side[open_] = _FREE_OF_WALLS * parts[open_]
    return side, nearest, distance
