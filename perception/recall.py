"""What other visits saw of a place, where this one could not look.

A lidar that sees half a circle leaves a way beside it in doubt, and so does a drive that ends at
the mouth of a place. The stored LPM of another visit nearby may show it. Where the two LPMs fit so
well that they surely show one place, the cells that this visit left unknown are filled from the
other, the star is read in what comes out, and those of the visit's own readings that it repeats
gain weight. Nothing is added that one of the visits did not think of itself: a reading gains only
if all of them have it among theirs; and since unknown cells can hide a way but show none, it must
keep every way of the best one.

Source: Beeson 2008, 9.3: on coming back, the stored LPM of the place is that of the visit too;
filling the unknown alone, and weighing readings by it, is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array, invert, transform_points, wrap_angle
from perception.grid import FREE, OCCUPIED, UNKNOWN, Image
from perception.lpm import CALLED_AT, LocalMap
from perception.places import PlaceVisit
from perception.revisit import look_again
from perception.sightings import PlaceSettings, Sighting
from perception.tile_matching import Match, Tile, refine_pose
from perception.voting import PlaceReading, are_lined_up, list_ways

SURE_NATS = 4.0
"""LPMs that fit so well show one place."""

MOST_VISITS = 3
"""The unknown is filled from so many other visits, those that fit best first."""

RECALLED = 0.8
"""How much what is read in the filled map counts beside what the visit read itself, where all that
is read there is among the visit's own readings; where little is, so much less."""

SAME_RAD = 0.7
"""Gateways whose directions differ by less are one."""


def recall_readings(
    visits: Sequence[PlaceVisit],
    poses: Array,
    tiles: Sequence[Tile],
    matches: Sequence[Match],
    settings: PlaceSettings,
) -> tuple[PlaceVisit, ...]:
    """Return the visits, their readings weighed anew by what other visits saw of the place.

    Parameters
    ----------
    visits : in order of time. poses : (n, 3) of the laser, drive frame.
    tiles, matches : of the visits; see :func:`perception.tile_matching.match_visits`.
    settings : those the visits were found with.

    Source
    ------
    See the head of this module.
    """
    links = _link(visits, tiles, matches)
    out = []
    for v, visit in enumerate(visits):
        best = sorted(links[v], key=lambda link: -link[0])[:MOST_VISITS]
        if not best or len(visit.readings) < 2:
            out.append(visit)
            continue
        local = _open_map(visit, settings)
        for _, u, pose in best:
            _fill_unknown(local, visit, tiles[u], pose)
        passage = visit.first_scan, visit.scan, visit.last_scan
        # Maps laid over each other are known to a cell: the robot is slimmer by one.
        sightings = look_again(local, poses, visit.centre_m, passage, settings, (1,))
        out.append(_weigh(visit, sightings, [(visits[u], pose[2]) for _, u, pose in best]))
    return tuple(out)


def _link(
    visits: Sequence[PlaceVisit], tiles: Sequence[Tile], matches: Sequence[Match]
) -> list[list[tuple[float, int, Array]]]:
    """Return for each visit (nats, other visit, its pose (3,) in the frame of this) that fit."""
    links: list[list[tuple[float, int, Array]]] = [[] for _ in visits]
    for one in matches:
        u, v = one.earlier, one.later
        in_doubt = len(visits[u].readings) + len(visits[v].readings) > 2
        if in_doubt and one.nats >= SURE_NATS:
            pose = refine_pose(tiles[u], tiles[v], one.pose)
            links[u].append((one.nats, v, pose))
            links[v].append((one.nats, u, invert(pose)))
    return links


def _open_map(visit: PlaceVisit, settings: PlaceSettings) -> LocalMap:
    """Return the stored LPM of a visit as a map again."""
    local = LocalMap(settings.lpm_m, settings.cell_m, settings.range_cap_m)
    local.frame = visit.tile_frame
    local.log_odds = _as_log_odds(visit.tile)
    return local


def _as_log_odds(image: Image) -> NDArray[np.float32]:
    """Return cells of a grey image of an LPM as log-odds just large enough to be called so."""
    log_odds: NDArray[np.float32] = np.zeros(image.shape, np.float32)
    log_odds[image == FREE] = -2.0 * CALLED_AT
    log_odds[image == OCCUPIED] = 2.0 * CALLED_AT
    return log_odds


def _fill_unknown(local: LocalMap, visit: PlaceVisit, tile: Tile, pose: Array) -> None:
    """Fill the unknown cells of a visit's map from the tile of another, at a pose (3,) in its."""
    unknown = np.column_stack(np.nonzero(local.log_odds == 0.0))
    here = local.frame.to_metres(unknown[:, ::-1].astype(float)) - visit.centre_m
    there = transform_points(invert(pose), here)
    column, row = np.rint(tile.frame.to_pixels(there)).astype(int).T
    height, width = tile.image.shape
    on = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    seen = np.full(len(unknown), UNKNOWN, np.uint8)
    seen[on] = tile.image[row[on], column[on]]
    local.log_odds[unknown[:, 0], unknown[:, 1]] = _as_log_odds(seen)


def _weigh(
    visit: PlaceVisit, sightings: Sequence[Sighting], others: Sequence[tuple[PlaceVisit, float]]
) -> PlaceVisit:
    """Return the visit, its readings weighed by how many sightings repeat them, best first.

    Parameters
    ----------
    others : the visits that the map was filled from, and how far each is turned, radians.
    """
    least = list_ways(visit.readings[0].star, visit.readings[0].headings_rad)
    shared = [all(_has(other, own, turn) for other, turn in others) for own in visit.readings]
    repeated, total = np.zeros(len(visit.readings)), 0.0
    for sighting in sightings:
        for read in sighting.topology.readings:
            total += read.weight
            headings = -np.asarray(read.headings_px, float)
            if not _keeps(list_ways(read.star, headings), least):
                continue
            for k, own in enumerate(visit.readings):
                if are_lined_up(read.star, headings, own.star, own.headings_rad, SAME_RAD):
                    repeated[k] += read.weight * shared[k]
                    break
    if not repeated.any():
        return visit
    before = np.array([reading.weight for reading in visit.readings])
    trust = RECALLED * float(repeated.sum()) / total
    weights = (1.0 - trust) * before / before.sum() + trust * repeated / repeated.sum()
    told = [replace(r, weight=float(w)) for r, w in zip(visit.readings, weights, strict=True)]
    return replace(visit, readings=tuple(sorted(told, key=lambda r: -r.weight)))


def _has(visit: PlaceVisit, reading: PlaceReading, turn_rad: float) -> bool:
    """Tell whether a visit, turned so far, has a reading of another among its own."""
    return any(
        are_lined_up(
            r.star,
            np.asarray(r.headings_rad) + turn_rad,
            reading.star,
            reading.headings_rad,
            SAME_RAD,
        )
        for r in visit.readings
    )


def _keeps(ways_rad: Array, least_rad: Array) -> bool:
    """Tell whether there is a way in each of some directions, and no fewer ways than those."""
    if len(ways_rad) < len(least_rad):
        return False
    off = np.abs(wrap_angle(ways_rad[:, None] - least_rad[None, :]))
    return bool((off.min(axis=0, initial=np.inf) < SAME_RAD).all())
