"""Matching of stored LPMs: how well the local maps of two visits fit if they show one place."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array, measure_along
from perception.grid import Cells, Frame, Image, classify
from perception.places import PlaceVisit

NEAR_M = 0.15
"""A wall that lies so near to a wall of the other map is the same wall."""
SHIFT_M, COARSE_M, FINE_M = 0.9, 0.3, 0.15
"""How far two visits to one place may find its centre apart, and the two steps of the search."""
TURN_RAD, COARSE_RAD, FINE_RAD = 0.24, 0.08, 0.04
"""How far drift may have turned one map against the other, and the two steps of the search."""
POINTS = (120, 400)
"""Walls looked up in the first and in the second search."""
REFINE = ((0.1, 0.02), (0.05, 0.01), (0.025, 0.005))
"""Steps, metres and radians, in which the place of one tile on the other is made out at last."""
REFINE_POINTS = 600
"""Walls looked up for that."""
FAR_M = 0.3
"""Walls farther off than this are simply missing."""
LEAST_SHARE = 0.25
"""Nothing is said unless so many of the walls lie where the other map knows the space."""

EVEN_SHARE = 0.82
"""At this share one place is as likely as two (recorded logs)."""
NATS_FOR, NATS_AGAINST = 40.0, 15.0
"""How fast that changes above and below, nats a share."""
ALIAS_M = (1.6, 2.4, 3.2)
"""A place that fits itself when moved so far fits its neighbours, too."""
LEAST_NATS, MOST_NATS = -2.5, 6.0
"""Bounds of what one match says: one place may look changed, two may look alike. Of 362 pairs of
visits to two places none fits as well as the upper bound asks; of 173 to one place half do."""

NEAR_VISIT_M, DRIFT = 4.0, 0.02
"""Visits nearer than this, and this share of the way driven between them, are compared."""


@dataclass(frozen=True, eq=False)
class Tile:
    """The stored LPM of a visit, made ready for matching.

    Attributes
    ----------
    image : grey image of the LPM. frame : of the visit, its origin at the centre of the place.
    """

    image: Image
    frame: Frame

    @cached_property
    def walls_m(self) -> Array:
        """(n, 2) occupied cells, frame of the visit, metres."""
        rows, columns = np.nonzero(classify(self.image).occupied)
        return self.frame.to_metres(np.column_stack([columns, rows]))

    @cached_property
    def fine(self) -> NDArray[np.int8]:
        """(H, W) 1 near a wall, 0 where it is free, -1 where unknown."""
        return self._draw(NEAR_M)

    @cached_property
    def coarse(self) -> NDArray[np.int8]:
        """As :attr:`fine`, with a wider idea of near."""
        return self._draw(NEAR_M + COARSE_M / 2)

    @cached_property
    def alias(self) -> float:
        """How well the tile fits itself when moved: near 1 on a bare corridor."""
        angles = np.arange(0.0, 2 * np.pi, np.pi / 8)
        ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
        moves = np.concatenate([r * ring for r in ALIAS_M])
        return float(_rate_poses(self, self, moves, 1).max()) if len(self.walls_m) else 1.0

    @cached_property
    def gaps_m(self) -> Array:
        """(H, W) how far the nearest wall is, at most ``FAR_M``; NaN where it is unknown."""
        cells, far_m = self._measure()
        return np.where(cells.unknown, np.nan, np.minimum(far_m, FAR_M))

    def _draw(self, near_m: float) -> NDArray[np.int8]:
        cells, far_m = self._measure()
        return np.where(far_m <= near_m, 1, np.where(cells.free, 0, -1)).astype(np.int8)

    def _measure(self) -> tuple[Cells, Array]:
        """Return the kinds of cells, and (H, W) how far the nearest wall is, metres."""
        cells = classify(self.image)
        far = cv2.distanceTransform((~cells.occupied).view(np.uint8), cv2.DIST_L2, 5)
        return cells, np.asarray(far * self.frame.resolution_m)


def rate_match(first: Tile, second: Tile, turn_rad: float = 0.0) -> tuple[float, Array] | None:
    """Rate how well two tiles fit if they show one place.

    Parameters
    ----------
    first, second : the tiles. turn_rad : heading of the second frame in the first, about.

    Returns
    -------
    None where too little is common, else

    share : of the walls of each that lie where the other knows the space, the share that lies near
        a wall of the other, under the best small shift and turn, 0 to 1.
    pose : (3,) of the frame of the second in that of the first, about, for that.

    Source
    ------
    Ours; after the alignment of the LPMs of a revisited place by obstacles, Beeson 2008, 9.3.1.
    """
    if not len(first.walls_m) or not len(second.walls_m):
        return None
    steps = _list_steps(SHIFT_M, COARSE_M)
    poses = [
        (x, y, turn_rad + t)
        for t in _list_steps(TURN_RAD, COARSE_RAD)
        for x in steps
        for y in steps
    ]
    rough = _rate_poses(first, second, np.array(poses), 0)
    x, y, turn = poses[int(np.argmax(rough))]
    near, turns = _list_steps(FINE_M, FINE_M), _list_steps(FINE_RAD, FINE_RAD)
    local = np.array([(x + a, y + b, turn + t) for t in turns for a in near for b in near])
    rated = _rate_poses(first, second, local, 1)
    best = int(np.argmax(rated))
    return (float(rated[best]), local[best]) if rated[best] >= 0 else None


def refine_pose(first: Tile, second: Tile, pose: Array) -> Array:
    """Return the pose (3,) of the second tile's frame in that of the first to a quarter of a cell.

    Parameters
    ----------
    pose : (3,) about where they fit; see :func:`rate_match`.

    Source
    ------
    Ours.
    """
    moves = np.array(list(itertools.product((0, -1, 1), repeat=3)))
    for step_m, step_rad in REFINE:
        for _ in range(3):
            poses = pose + moves * [step_m, step_m, step_rad]
            best = int(np.argmin(_measure_gaps(first, second, poses)))
            pose = poses[best]
            if best == 0:
                break
    return pose


def _measure_gaps(first: Tile, second: Tile, poses: Array) -> Array:
    """Return for poses (k, 3) of the second the mean gap between common walls, metres."""
    there, back = _lay_over(first, second, poses, REFINE_POINTS)
    both = (first, there), (second, back)
    gaps = np.concatenate([_sample(t, t.gaps_m, points, np.nan) for t, points in both], axis=1)
    known = np.maximum(np.isfinite(gaps).sum(axis=1), 1)
    return np.asarray(np.nansum(gaps, axis=1) / known)


def _list_steps(half: float, step: float) -> list[float]:
    count = round(half / step)
    return [step * k for k in range(-count, count + 1)]


def _rate_poses(first: Tile, second: Tile, poses: Array, stage: int) -> Array:
    """Return the share of common walls for each pose (k, 3) of the second; -1 for too few."""
    there, back = _lay_over(first, second, poses, POINTS[stage])
    hits, known = _look_up(first, there, stage)
    more, also = _look_up(second, back, stage)
    hits, known = hits + more, known + also
    enough = known >= LEAST_SHARE * (there.shape[1] + back.shape[1])
    return np.asarray(np.where(enough, hits / np.maximum(known, 1), -1.0), float)


def _lay_over(first: Tile, second: Tile, poses: Array, most: int) -> tuple[Array, Array]:
    """Return walls of the second in the frame of the first, and the other way, each (k, n, 2)."""
    ours, theirs = _thin(first.walls_m, most), _thin(second.walls_m, most)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([c, -s], 1), np.stack([s, c], 1)], 1)
    shift = poses[:, None, :2]
    there = np.einsum("nj,kij->kni", theirs, turn) + shift
    back = np.einsum("knj,kji->kni", ours[None] - shift, turn)
    return there, back


def _thin(points: Array, count: int) -> Array:
    if len(points) <= count:
        return points
    return np.asarray(points[np.linspace(0, len(points) - 1, count).astype(int)], float)


def _look_up(tile: Tile, points_m: Array, stage: int) -> tuple[Array, Array]:
    """Return for sets of points (k, n, 2) how many lie near a wall, and how many in known space."""
    found = _sample(tile, tile.fine if stage else tile.coarse, points_m, -1)
    return (found > 0).sum(axis=1), (found >= 0).sum(axis=1)


def _sample(tile: Tile, field: NDArray[Any], points_m: Array, outside: float) -> NDArray[Any]:
    """Return the values of a field (H, W) of a tile at points (k, n, 2)."""
    padded = np.pad(field, 1, constant_values=outside)
    cells = np.rint(tile.frame.to_pixels(points_m)).astype(np.int32) + 1
    column = np.clip(cells[..., 0], 0, padded.shape[1] - 1)
    row = np.clip(cells[..., 1], 0, padded.shape[0] - 1)
    return np.asarray(padded[row, column])


def weigh_match(share: float, alias: float = 0.0) -> float:
    """Return how much a match speaks for one place: a log-likelihood ratio, nats.

    Parameters
    ----------
    share : of walls that fit. alias : share that would fit though the places were two.

    Examples
    --------
    >>> [round(weigh_match(share), 1) for share in (0.95, 0.72, 0.4)], weigh_match(0.9, alias=0.95)
    ([5.2, -1.5, -2.5], 0.0)
    """
    over = share - max(EVEN_SHARE, alias)
    nats = NATS_FOR * over if over > 0 else NATS_AGAINST * min(share - EVEN_SHARE, 0.0)
    return float(np.clip(nats, LEAST_NATS, MOST_NATS))


@dataclass(frozen=True, eq=False)
class Match:
    """How well the LPMs of two visits fit.

    Attributes
    ----------
    earlier, later : the visits. nats : what it says; see :func:`weigh_match`.
    pose : (3,) of the later in the frame of the earlier, about; see :func:`rate_match`.
    """

    earlier: int
    later: int
    nats: float
    pose: Array


def match_visits(
    visits: Sequence[PlaceVisit], poses: Array
) -> tuple[tuple[Tile, ...], tuple[Match, ...]]:
    """Match the LPM of each visit with those of earlier visits that may have been to its place.

    Parameters
    ----------
    visits : in order of time. poses : (n, 3) of the laser, drive frame.

    Returns
    -------
    tiles : of the visits.
    matches : of visits near enough to each other to be compared, that have enough in common.
    """
    driven = measure_along(poses[:, :2])
    tiles = tuple(_make_tile(visit) for visit in visits)
    found = []
    for v, visit in enumerate(visits):
        for u, other in enumerate(visits[:v]):
            way = float(driven[visit.scan] - driven[other.scan])
            apart = float(np.hypot(*(other.centre_m - visit.centre_m)))
            if apart > NEAR_VISIT_M + DRIFT * way:
                continue
            fit = rate_match(tiles[u], tiles[v])
            if fit is not None:
                share, pose = fit
                alias = min(tiles[u].alias, tiles[v].alias)
                found.append(Match(u, v, weigh_match(share, alias), pose))
    return tiles, tuple(found)


def list_matches(
    matches: Sequence[Match], visits: int
) -> tuple[tuple[tuple[int, float], ...], ...]:
    """Return for each of so many visits pairs of an earlier visit and what the match says, nats.

    Two visits that both fit a third one fit each other; see :func:`join_matches`.
    """
    pairs: list[list[tuple[int, float]]] = [[] for _ in range(visits)]
    for one in matches:
        pairs[one.later].append((one.earlier, one.nats))
    return join_matches([tuple(found) for found in pairs])


def join_matches(
    matches: Sequence[tuple[tuple[int, float], ...]],
) -> tuple[tuple[tuple[int, float], ...], ...]:
    """Let two visits that both fit a third one fit each other as well as the worse of the two.

    The first visit to a place may have seen another half of it than the latest one.

    Examples
    --------
    >>> join_matches([(), ((0, 2.0),), ((0, -1.0), (1, 3.0))])[2]
    ((0, 2.0), (1, 3.0))
    """
    count = len(matches)
    if not count:
        return ()
    said = np.full((count, count), -np.inf)
    for v, pairs in enumerate(matches):
        for u, nats in pairs:
            said[u, v] = said[v, u] = nats
    by_third = np.array([np.minimum(row[:, None], said).max(axis=0) for row in said])
    joined = np.where(by_third > 0, np.maximum(said, by_third), said)
    return tuple(
        tuple((u, float(joined[u, v])) for u in range(v) if np.isfinite(joined[u, v]))
        for v in range(count)
    )


def _make_tile(visit: PlaceVisit) -> Tile:
    """Return the stored LPM of a visit, made ready for matching, the place at its origin."""
    frame, (x, y) = visit.tile_frame, visit.centre_m
    return Tile(
        visit.tile, Frame(frame.left_m - float(x), frame.top_m - float(y), frame.resolution_m)
    )
