"""The extended Voronoi graph (EVG) of a region, as a graph of branches.

Each cell belongs to the wall arc nearest to it; cells at least M from every wall form an open
face. Where two faces meet runs the skeleton: along the edges between cells, so it is one line
wide without thinning, a junction is a corner where three faces meet, and no branch is born of a
rough wall, since both sides of such a branch are the same arc. What is left joins the exits.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from perception.cracks import OPEN, Cracks, find_cracks, link_cracks, measure_field, walk_chains
from perception.geometry import Array
from perception.kernels import Kernels, get_kernels
from perception.region import Index, Region

__all__ = ["OPEN", "Branch", "Node", "Skeleton", "build_skeleton", "trace_branches"]


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

    def within(self, k: int, distance_px: float) -> tuple[int, int]:
        """Return [first, last) of the points about point k up to where it gets further off it."""
        x, y = self.points_px.T
        dx, dy = x - x[k], y - y[k]
        far = dx * dx + dy * dy > distance_px * distance_px
        before, after = int(far[k::-1].argmax()), int(far[k:].argmax())
        return k - before + 1 if before else 0, k + after if after else len(far)

    def measure_bends(self, points: Index, reach_px: Array) -> Array:
        """Return how far a branch turns at some of its points.

        Parameters
        ----------
        points : (n,) indices. reach_px : (n,) the turn is that from the stretch of this length
            before the point to that behind it; beyond its ends the branch stands still.

        Returns
        -------
        (n,) radians, 0 to pi.
        """
        steps, (x, y), here = self.steps_px, self.points_px.T, self.points_px[points]
        before, after = steps[points] - reach_px, steps[points] + reach_px
        back = here - np.stack([np.interp(before, steps, x), np.interp(before, steps, y)], 1)
        ahead = np.stack([np.interp(after, steps, x), np.interp(after, steps, y)], 1) - here
        cross = back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0]
        return np.asarray(np.abs(np.arctan2(cross, np.sum(back * ahead, axis=1))))

    @cached_property
    def steps_px(self) -> Array:
        """(n,) arc length from the tail to each point."""
        step = self.points_px[1:] - self.points_px[:-1]
        way = np.zeros(len(self.points_px))
        np.cumsum(np.sqrt(np.einsum("ij,ij->i", step, step)), out=way[1:])
        return way


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
    kernels = get_kernels()
    cracks = find_cracks(region, measure_field(region, midline_px, kernels), kernels)
    return trace_branches(region, cracks, kernels)


def trace_branches(region: Region, cracks: Cracks, kernels: Kernels | None = None) -> Skeleton:
    """Join the cracks of a region into branches between nodes.

    Parameters
    ----------
    kernels : compiled loops to do it with, if any.

    Source
    ------
    Ours.
    """
    beyond, node_of_end = link_cracks(cracks.corners)
    ends, nodes = cracks.corners.ravel(), node_of_end.tolist()
    skeleton = Skeleton()
    if kernels is None:
        chains = walk_chains(beyond.tolist(), nodes)
    else:
        chains = _split_chains(*kernels.follow_chains(beyond, node_of_end))
    for path, start, last in chains:
        tail, head = nodes[start], nodes[last]
        if tail < 0:
            tail = head = int(ends[start])
        _add_branch(skeleton, region, cracks, path, (tail, head))
    return skeleton


def _split_chains(path: Index, first: Index) -> Iterator[tuple[Index, int, int]]:
    """Yield each chain with its first and its last end."""
    for start, stop in itertools.pairwise(first.tolist()):
        yield path[start:stop], int(path[start]), int(path[stop - 1]) ^ 1


def _add_branch(
    skeleton: Skeleton, region: Region, cracks: Cracks, path: Index, ends: tuple[int, int]
) -> None:
    """Add the branch that a list of crack ends (2 x crack + end entered by) describes."""
    crack, backwards = path >> 1, (path & 1).astype(bool)
    left, right = cracks.left[crack], cracks.right[crack]
    left, right = np.where(backwards, right, left), np.where(backwards, left, right)
    branch = Branch(*ends, cracks.points_px[crack], cracks.radius_px[crack], left, right)
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
