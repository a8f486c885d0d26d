"""Voting for the star of a visit: all sightings of a place speak, the runner-ups are kept.

Source: ours; on recorded logs a single reading of the star repeats itself in two visits out of
three only, the vote of all sightings in most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.continuity import StarReading
from perception.geometry import Array, wrap_angle
from perception.sightings import PlaceSettings, Sighting, is_path
from perception.star import Star

REVIEW_VOTE = 1.0
"""Vote of a look back at a place, beside at most 1 for what is seen inside it."""

_SAME_HEADING_RAD = 0.7
_OFF_GATEWAY_RAD = (0.5, 1.0)  # one standard deviation, and the most a robot passes beside one


@dataclass(frozen=True)
class PlaceReading:
    """One reading of the star of a visit: the dlps, how the robot came and went, how likely.

    Attributes
    ----------
    headings_rad : direction of each dlp, counter-clockwise, drive frame.
    gateways_m : centre of the gateway through which each dlp leaves, relative to the place, drive
        axes; NaN where there is none.
    weight : probability; those of one visit sum to 1.
    types : path type of each dlp, "" where it is not told; see :mod:`perception.path_types`.
    """

    star: Star
    arrive: int | None
    depart: int | None
    headings_rad: tuple[float, ...]
    gateways_m: tuple[tuple[float, float], ...]
    weight: float
    types: tuple[str, ...] = ()


def vote_star(
    sightings: Sequence[Sighting],
    reviews: Sequence[Sighting],
    centre: Array,
    entry: float | None,
    leave: float | None,
    settings: PlaceSettings,
) -> tuple[PlaceReading, ...]:
    """Return the readings of the star of a visit, best first; empty if none fits the drive.

    Parameters
    ----------
    sightings : taken inside the place. reviews : taken from beyond, looking back.
    centre : (2,) of the place, drive frame.
    entry, leave : direction from the centre to where the robot came from and went to; None at the
        ends of the drive. A star without a gateway there is no reading of this visit.
    """
    shares = _vote(sightings, reviews, centre, settings)
    found = [_oriented(group, share, entry, leave) for group, share in shares]
    fits = (g.is_plain for (g, _), r in zip(shares, found, strict=True) if r is not None)
    if not any(fits):
        return ()
    readings = sorted((r for r in found if r is not None), key=lambda r: -r.weight)
    best = readings[0].weight
    kept = [r for r in readings if r.weight >= settings.runner_up * best][: settings.max_readings]
    total = sum(r.weight for r in kept)
    return tuple(replace(r, weight=r.weight / total) for r in kept)


@dataclass
class _Group:
    """Equal readings of the star, seen from several poses; plain if one of them votes in full."""

    reading: StarReading
    headings_rad: Array
    ends_m: Array
    votes: float
    best_vote: float
    is_plain: bool = False

    @property
    def gateways_m(self) -> Array:
        """(m, 2) middle of the gateway of each dlp; NaN where alpha is 0."""
        return np.asarray(self.ends_m.mean(axis=1))


def _vote(
    sightings: Sequence[Sighting],
    reviews: Sequence[Sighting],
    centre: Array,
    settings: PlaceSettings,
) -> list[tuple[_Group, float]]:
    """Add up the votes of all sightings for each different star; return the shares."""
    groups = list[_Group]()
    for sighting in [*sightings, *reviews]:
        distance = float(np.hypot(*(sighting.pose[:2] - centre)))
        weight = float(np.exp(-0.5 * (distance / settings.vote_m) ** 2))
        if sighting in reviews:
            weight = REVIEW_VOTE * sighting.vote
        for reading in sighting.topology.readings:
            vote = weight * reading.weight
            headings = -np.asarray(reading.headings_px, float)
            ends = _dlp_ends(reading, sighting) - sighting.centre_m
            for group in groups:
                theirs = group.reading.star, group.headings_rad
                if are_lined_up(reading.star, headings, *theirs, _SAME_HEADING_RAD):
                    break
            else:
                group = _Group(reading, headings, ends, 0.0, 0.0)
                groups.append(group)
            group.votes += vote
            group.is_plain |= sighting.vote >= 1.0
            if vote > group.best_vote:
                group.reading, group.headings_rad = reading, headings
                group.ends_m, group.best_vote = ends, vote
    total = sum(group.votes for group in groups)
    return [(g, g.votes / total) for g in groups if not is_path(g.reading.star)]


def _dlp_ends(reading: StarReading, sighting: Sighting) -> Array:
    """Return the (m, 2, 2) ends of the gateway of each dlp, drive frame; NaN where alpha is 0."""
    out = np.full((len(reading.star), 2, 2), np.nan)
    for k, gateway in enumerate(reading.gateway_out):
        if gateway is not None:
            ends_px = np.array(sighting.topology.gateways[gateway].ends_px, float)
            out[k] = sighting.frame.to_metres(ends_px)
    return out


def list_ways(star: Star, headings_rad: Sequence[float] | Array) -> Array:
    """Return the directions (k,) in which a star can be left, of those of its dlps (m,)."""
    return np.asarray(np.asarray(headings_rad, float)[np.array(star.alpha, bool)])


def are_lined_up(
    star: Star,
    headings_rad: Sequence[float] | Array,
    other: Star,
    other_headings_rad: Sequence[float] | Array,
    within_rad: float,
) -> bool:
    """Tell whether two stars are isomorphic with their gateways in the same directions.

    Parameters
    ----------
    headings_rad, other_headings_rad : (m,) of the dlps of each, in one frame.
    within_rad : directions that differ by less are the same.

    Source
    ------
    Ours.
    """
    alpha, own = np.array(star.alpha, bool), np.asarray(headings_rad, float)
    theirs = np.asarray(other_headings_rad, float)
    for r in star.isomorphisms(other):
        turned = theirs[(np.arange(len(star)) + r) % len(star)]
        if np.all(np.abs(wrap_angle(turned - own))[alpha] < within_rad):
            return True
    return False


def _oriented(
    group: _Group, share: float, entry: float | None, leave: float | None
) -> PlaceReading | None:
    """Find the dlps the robot came and went by; None if the star has no gateway there."""
    star = group.reading.star
    outward = np.arctan2(group.gateways_m[:, 1], group.gateways_m[:, 0])
    at_ends = np.arctan2(group.ends_m[..., 1], group.ends_m[..., 0])
    spread = np.abs(wrap_angle(at_ends - outward[:, None])).min(axis=1)
    penalty = 1.0

    def gateway_at(bearing: float) -> int | None:
        nonlocal penalty
        off = np.abs(wrap_angle(outward - bearing))
        off = np.where(np.isnan(off), np.inf, off)
        if off.min() > _OFF_GATEWAY_RAD[1]:  # a wide gateway, passed near one of its ends?
            off = np.maximum(off - np.nan_to_num(spread), 0.0)
        k = int(np.argmin(off))
        if off[k] > _OFF_GATEWAY_RAD[1]:
            return None
        penalty *= float(np.exp(-0.5 * (off[k] / _OFF_GATEWAY_RAD[0]) ** 2))
        return k

    came = gateway_at(entry) if entry is not None else None
    went = gateway_at(leave) if leave is not None else None
    if (entry is not None and came is None) or (leave is not None and went is None):
        return None
    return PlaceReading(
        star,
        star.opposite(came) if came is not None else None,
        went,
        tuple(float(h) for h in group.headings_rad),
        tuple((float(x), float(y)) for x, y in group.gateways_m),
        share * penalty,
        group.reading.types,
    )
