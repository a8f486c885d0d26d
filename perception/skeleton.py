"""The extended Voronoi graph (EVG) of a region, as a graph of branches.

Each cell belongs to the wall arc nearest to it; cells at least M from every wall form an open
face. Where two faces meet runs the skeleton: along the edges between cells, so it is one line
wide without thinning, a junction is a corner where three faces meet, and no branch is born of a
rough wall, since both sides of such a branch are the same arc. What is left joins the exits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array
from perception.region import Index, Region

OPEN = -1
"""Stands for the index of a wall cell on the side of a branch where there is no wall within M."""


@dataclass(frozen=True, eq=False)
class Branch:
    """A stretch of skeleton between two nodes.

    Attributes
    ----------
    tail, head : the nodes it runs from and to; equal for a loop.
    points_px : (n, 2) x, y in cells, sub-cell, in order.
    radius_px : (n,) distance from the nearest obstacle (the Voronoi radius).
    left, right : (n,) index into ``Region.walls`` of the nearest wall cell on the left and on the
        right, looking along the branch in the image; OPEN where no wall is within M.
    """

    tail: int
    head: int
    points_px: Array
    radius_px: Array
    left: Index
    right: Index

    def reversed(self) -> Branch:
        """Return the branch from head to tail."""
        return Branch(
            self.head,
            self.tail,
            self.points_px[::-1],
            self.radius_px[::-1],
            self.right[::-1],
            self.left[::-1],
        )

    def joined(self, other: Branch) -> Branch:
        """Return this branch and another, which goes on where this one ends, as one."""
        return Branch(
            self.tail,
            other.head,
            np.concatenate([self.points_px, other.points_px]),
            np.concatenate([self.radius_px, other.radius_px]),
            np.concatenate([self.left, other.left]),
            np.concatenate([self.right, other.right]),
        )

    def part(self, first: int, last: int, tail: int, head: int) -> Branch:
        """Return the points [first, last) as a branch of their own."""
        return Branch(
            tail,
            head,
            self.points_px[first:last],
            self.radius_px[first:last],
            self.left[first:last],
            self.right[first:last],
        )

    @property
    def steps_px(self) -> Array:
        """(n,) arc length from the tail to each point."""
        step = np.hypot(*np.diff(self.points_px, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(step)])


@dataclass(frozen=True, eq=False)
class Node:
    """An end of branches: a junction, an exit (index >= 0) or a dead end (index None)."""

    point_px: tuple[float, float]
    radius_px: float
    exit: int | None = None


@dataclass(eq=False)
class Skeleton:
    """The graph: nodes by number, and branches."""

    nodes: dict[int, Node] = field(default_factory=dict)
    branches: list[Branch] = field(default_factory=list)

    def degree(self) -> dict[int, int]:
        """Return how many branch ends each node has (a loop has two)."""
        count = dict.fromkeys(self.nodes, 0)
        for branch in self.branches:
            count[branch.tail] += 1
            count[branch.head] += 1
        return count

    def junctions(self) -> list[int]:
        """Return the nodes where three or more branches end."""
        return [node for node, count in self.degree().items() if count >= 3]

    @property
    def points_px(self) -> Array:
        """(n, 2) all points of all branches."""
        if not self.branches:
            return np.zeros((0, 2))
        return np.concatenate([branch.points_px for branch in self.branches])


@dataclass(frozen=True)
class _Cracks:
    """Edges between two cells of different faces: corners they join, and what lies beside them."""

    corners: Index  # (n, 2) corner numbers
    points: Array  # (n, 2)
    radius: Array  # (n,)
    walls: Index  # (n, 2) nearest wall cell of the first and of the second cell
    second_on_left: NDArray[np.bool_]  # looking from corner 0 to corner 1


def build_skeleton(region: Region, *, midline_px: float) -> Skeleton:
    """Build the EVG of a region, joining its exits.

    Parameters
    ----------
    region : see :func:`perception.region.find_region`.
    midline_px : M; further than this from every obstacle the skeleton follows the walls at M.

    Returns
    -------
    The graph before pruning: it may hold branches to dead ends, and parts not joined together.

    Source
    ------
    Beeson 2008, 6.1.1 and 6.3.1 for what it is; the construction by arcs and cracks is ours.
    """
    if not len(region.walls):
        return Skeleton()
    faces, nearest, distance = _faces(region, midline_px)
    cracks = _find_cracks(region, faces, nearest, distance, midline_px)
    return _trace(region, cracks)


def _faces(
    region: Region, midline_px: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """Return the face of each cell (0 outside), its nearest wall cell and the distance to it."""
    source = np.ones(region.inside.shape, np.uint8)
    source[region.walls[:, 1], region.walls[:, 0]] = 0
    found = cv2.distanceTransformWithLabels(source, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    distance, labels = np.asarray(found[0], np.float32), np.asarray(found[1], np.int32)
    own = labels[region.walls[:, 1], region.walls[:, 0]]
    to_wall = np.zeros(int(own.max()) + 1, np.int32)
    to_wall[own] = np.arange(len(own))
    nearest = to_wall[labels]
    faces = (region.arc.astype(np.int32) + 1)[nearest]
    faces[~region.inside] = 0
    midline = midline_px - region.radius_px - 0.5
    wide = (distance >= midline) & region.inside
    if wide.any():
        count, components = cv2.connectedComponents(wide.view(np.uint8), connectivity=4)
        open_faces = np.asarray(components, np.int32)
        deepest = np.zeros(count, np.float32)
        np.maximum.at(deepest, open_faces[wide], distance[wide])
        keep = deepest >= 1.3 * midline
        keep[0] = False
        chosen = keep[open_faces]
        faces[chosen] = open_faces[chosen] + int(region.arc.max()) + 1
    return faces, nearest, distance


def _find_cracks(
    region: Region,
    faces: NDArray[np.int32],
    nearest: NDArray[np.int32],
    distance: NDArray[np.float32],
    midline_px: float,
) -> _Cracks:
    """Find the edges between neighbouring cells of two faces, and the sub-cell crossing there."""
    height, width = faces.shape
    first_face_open = int(region.arc.max()) + 2
    parts = []
    for down in (0, 1):
        a = faces[: height - down, : width - 1 + down]
        b = faces[down:, 1 - down :]
        y, x = np.nonzero((a != b) & (a > 0) & (b > 0))
        cell_a, cell_b = np.stack([x, y], 1), np.stack([x + 1 - down, y + down], 1)
        corner = np.stack([x + 1 - down, y + down], 1)
        other = corner + np.array([down, 1 - down])
        corners = np.stack([c[:, 1] * (width + 1) + c[:, 0] for c in (corner, other)], 1)
        parts.append((corners, cell_a, cell_b, np.full(len(x), bool(1 - down))))
    corners, cell_a, cell_b, second_left = (
        np.concatenate([part[k] for part in parts]) for k in range(4)
    )
    wall_a = nearest[cell_a[:, 1], cell_a[:, 0]].astype(np.int64)
    wall_b = nearest[cell_b[:, 1], cell_b[:, 0]].astype(np.int64)
    open_a = faces[cell_a[:, 1], cell_a[:, 0]] >= first_face_open
    open_b = faces[cell_b[:, 1], cell_b[:, 0]] >= first_face_open
    step = (cell_b - cell_a).astype(float)
    to_a = (cell_a - region.walls[wall_a]).astype(float)
    to_b = (cell_a - region.walls[wall_b]).astype(float)
    slope = 2 * np.sum(step * (to_a - to_b), axis=1)
    gap = np.sum(to_b**2, axis=1) - np.sum(to_a**2, axis=1)
    share = np.where(np.abs(slope) > 1e-9, gap / np.where(slope == 0, 1, slope), 0.5)
    level = midline_px - region.radius_px - 0.5
    far_a = distance[cell_a[:, 1], cell_a[:, 0]].astype(float)
    far_b = distance[cell_b[:, 1], cell_b[:, 0]].astype(float)
    span = np.where(far_b == far_a, 1.0, far_b - far_a)
    share = np.where(open_a | open_b, (level - far_a) / span, share)
    points = cell_a + np.clip(share, 0.0, 1.0)[:, None] * step
    wall = np.where(open_a, wall_b, wall_a)
    radius = np.hypot(*(points - region.walls[wall]).T) + region.radius_px + 0.5
    walls = np.stack([np.where(open_a, OPEN, wall_a), np.where(open_b, OPEN, wall_b)], 1)
    return _Cracks(corners, points, radius, walls, second_left)


def walk_chains(following: list[int], nodes: list[int]) -> Iterator[tuple[Index, int, int]]:
    """Follow cracks from node to node, then round what is left over.

    Parameters
    ----------
    following : for each end of a crack (2 k and 2 k + 1), the end of another crack it meets; -1 at
        a node.
    nodes : for each end, its node; -1 if it is not at one.

    Yields
    ------
    (ends at which the cracks are entered, first end, last end) of each chain; a ring has no nodes.
    """
    seen = bytearray(len(nodes) // 2)
    starts = [k for k, node in enumerate(nodes) if node >= 0]
    for start in [*starts, *range(0, len(nodes), 2)]:
        if seen[start >> 1]:
            continue
        path, end = list[int](), start
        while True:
            path.append(end)
            seen[end >> 1] = 1
            last = end ^ 1
            end = following[last]
            if end < 0 or end >> 1 == start >> 1:
                break
        yield np.array(path), start, last


def _trace(region: Region, cracks: _Cracks) -> Skeleton:
    """Join cracks into branches between nodes."""
    ends = cracks.corners.ravel()
    order = np.argsort(ends, kind="stable")
    corner, first, count = np.unique(ends[order], return_index=True, return_counts=True)
    beyond = np.full(len(ends), -1, np.int64)
    pairs = first[count == 2]
    one, two = order[pairs], order[pairs + 1]
    beyond[one], beyond[two] = two, one
    node_of_end = np.full(len(ends), -1, np.int64)
    for k in np.flatnonzero(count != 2):
        node_of_end[order[first[k] : first[k] + count[k]]] = corner[k]
    following, nodes = beyond.tolist(), node_of_end.tolist()
    skeleton = Skeleton()
    for path, start, last in walk_chains(following, nodes):
        tail, head = nodes[start], nodes[last]
        if tail < 0:
            tail = head = int(ends[start])
        _add_branch(skeleton, region, cracks, path, (tail, head))
    return skeleton


def _add_branch(
    skeleton: Skeleton, region: Region, cracks: _Cracks, path: Index, ends: tuple[int, int]
) -> None:
    """Add the branch that a list of crack ends (2 x crack + end entered by) describes."""
    crack, entered = path >> 1, path & 1
    swap = cracks.second_on_left[crack] == (entered == 0)
    walls = cracks.walls[crack]
    left = np.where(swap, walls[:, 1], walls[:, 0])
    right = np.where(swap, walls[:, 0], walls[:, 1])
    branch = Branch(*ends, cracks.points[crack], cracks.radius[crack], left, right)
    skeleton.branches.append(branch)
    for node, k in ((ends[0], 0), (ends[1], -1)):
        if node not in skeleton.nodes:
            skeleton.nodes[node] = _as_node(region, node, float(branch.radius_px[k]))


def _as_node(region: Region, corner: int, radius_px: float) -> Node:
    """Return the node at a corner: at an exit if one of its cells is frontier."""
    width = region.inside.shape[1]
    y, x = divmod(corner, width + 1)
    around = region.exit_of_cell[max(y - 1, 0) : y + 1, max(x - 1, 0) : x + 1]
    found = int(around.max(initial=0))
    return Node((x - 0.5, y - 0.5), radius_px, found - 1 if found else None)
