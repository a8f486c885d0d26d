"""Place detection along a drive: which places the robot visited, with which stars.

The robot keeps its scrolling LPM, reads the local topology every half metre, and is *on-path* while
that topology is two gateways on one local-path; otherwise it suspects a place. A place is
committed only when several readings of the LPM agree on where it is. Once the robot has left, the
scans of the whole passage are drawn into one map about the place; its star is voted for by all
readings, those of that map above all, and the runner-ups are kept as alternative readings.

A place goes through four states. *Suspected*: the first reading that is no bare path. *Confirmed*:
enough readings speak of it, also those that look back at it, and most of those taken here. *Left*:
the robot is farther off than its gateways. *Committed*: passages of which one is part of the other,
or between which the robot merely turned round, are one visit; those beside each other are two, with
a travel of no length between them. What is left without being confirmed is dropped, and so is a
place of which walls have parted the robot. At the end of the drive the robot also reads what lies
just ahead of it: a place before whose mouth it stands has been reached.

A visit keeps its local map, and readings relative to the centre of the place: the place's own frame
has its origin there and the axes of the drive.

Source: Beeson 2008, section 5.3.2 (on-path test, confirmation before a place is committed) and 5.4
(travels between adjacent places). Grouping by base point, the map of the passage, voting and the
runner-ups are ours.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from perception.geometry import Array
from perception.grid import Frame, Image
from perception.lpm import LocalMap
from perception.revisit import find_walled_off, look_again, map_passage, touches_wall
from perception.scanlog import ScanLog
from perception.sightings import (
    LOOKED_AROUND_RAD,
    PlaceSettings,
    Sighting,
    look_ahead,
    read_sightings,
    read_topology,
)
from perception.voting import PlaceReading, vote_star

__all__ = ["PlaceReading", "PlaceSettings", "PlaceVisit", "detect_places"]

REVIEW_STEP_M, REVIEW_MAX_M = 1.0, 4.5
"""A place is looked back at once a metre, until one is so far from its centre."""

REVIEW_SAME_M = 2.0
"""What is seen further than this from its centre then is another place."""

NESTED_M, NESTED_SHARE = 3.0, 0.7
"""A place passed mostly within the passage of another, not farther from it, is a part of it."""

ADJACENT_M = 0.3
"""Gateways of neighbouring places may overlap by so much."""


@dataclass(frozen=True)
class PlaceVisit:
    """One passage through a place.

    Attributes
    ----------
    scan : index of the scan nearest to the centre; the displacement is measured there.
    first_scan, last_scan : the passage.
    centre_m : (2,) place centre in the drive frame. radius_m : how far it reaches.
    readings : best first.
    tile, tile_frame : the LPM stored for the place; the frame is that of the drive.
    """

    scan: int
    first_scan: int
    last_scan: int
    centre_m: Array
    radius_m: float
    readings: tuple[PlaceReading, ...]
    tile: Image
    tile_frame: Frame


@dataclass
class _Candidate:
    """A place not yet committed: the sightings that speak of it."""

    sightings: list[Sighting] = field(default_factory=list)
    reviews: list[Sighting] = field(default_factory=list)
    denials: int = 0
    denials_back: int = 0
    reviewed_m: float = 0.0

    def review(
        self, scan: int, poses: Array, local: LocalMap, settings: PlaceSettings, others: Array
    ) -> None:
        """Look back at the place from a little beyond, when both of its sides have been seen.

        What is nearer to the centre of one of the others (n, 2) speaks of that, not of this.
        """
        away = float(np.hypot(*(poses[scan, :2] - self.centre_m)))
        if away < self.reviewed_m + REVIEW_STEP_M or away > REVIEW_MAX_M:
            return
        self.reviewed_m = away
        sighting = read_topology(scan, poses, local, settings, at_m=self.centre_m)
        if sighting is None:
            self.denials_back += 1
            return
        apart = float(np.hypot(*(sighting.centre_m - self.centre_m)))
        if np.hypot(*(others - sighting.centre_m).T).min(initial=np.inf) < apart:
            self.denials_back += 1
        elif apart < REVIEW_SAME_M:
            self.reviews.append(sighting)

    def is_confirmed(self, settings: PlaceSettings) -> bool:
        """Tell whether enough readings speak of a place here, most of all and most taken here."""
        here, back = ([s.share for s in group] for group in (self.sightings, self.reviews))
        for_here, for_all = sum(here), sum(here) + sum(back)
        against_here = self.denials + len(here) - for_here
        against_all = against_here + self.denials_back + len(back) - sum(back)
        enough = len(here) + len(back) >= settings.confirmations
        return enough and for_here > against_here and for_all > against_all

    @property
    def centre_m(self) -> Array:
        return np.asarray(np.mean([s.centre_m for s in self.sightings], axis=0))

    @property
    def radius_m(self) -> float:
        return float(np.median([s.radius_m for s in self.sightings]))


def detect_places(
    log: ScanLog,
    poses: Array,
    settings: PlaceSettings | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[PlaceVisit, ...]:
    """Return the visits to places along a drive, in order.

    Parameters
    ----------
    log : the scans. poses : (n, 3) locally consistent poses of the laser; global drift is fine.
    progress : called with (scans done, scans in all).

    Source
    ------
    Beeson 2008, section 5.3.2; see the head of this module for what is ours.
    """
    settings = settings or PlaceSettings()
    open_, done, local = list[_Candidate](), list[_Candidate](), None
    for sighting, scan, local in read_sightings(log, poses, settings, progress):
        _take(sighting, poses[scan, :2], open_, settings)
        for candidate in list(open_):
            others = [c.centre_m for c in open_ if c is not candidate]
            candidate.review(scan, poses, local, settings, np.array(others).reshape(-1, 2))
            away = float(np.hypot(*(poses[scan, :2] - candidate.centre_m)))
            if away > candidate.radius_m + 2.0 + settings.same_place_m:
                open_.remove(candidate)
                done.append(candidate)
    if local is not None:
        for sighting, point in look_ahead(poses, local, settings):
            _take(sighting, point, open_, settings)
    done += open_
    confirmed = (_passage(c, poses, settings) for c in done if c.is_confirmed(settings))
    passages = _drop_glimpses([p for p in confirmed if p is not None], poses)
    passages = _merge_returns(passages, poses, settings)
    passages = _separate(passages, poses)
    visits = (_commit(p, log, poses, settings) for p in passages)
    return tuple(visit for visit in visits if visit is not None)


def _take(
    sighting: Sighting | None, point: Array, open_: list[_Candidate], settings: PlaceSettings
) -> None:
    """Give the sighting to the nearest open candidate, or open a new one.

    If there is none at the point (2,), the candidates there are denied.
    """
    if sighting is None:
        for candidate in open_:
            away = float(np.hypot(*(point - candidate.centre_m)))
            candidate.denials += away < max(candidate.radius_m, 1.0)
        return
    near = min(
        open_, key=lambda c: float(np.hypot(*(c.centre_m - sighting.centre_m))), default=None
    )
    limit = max(settings.same_place_m, 0.5 * sighting.radius_m)
    if near is None or np.hypot(*(near.centre_m - sighting.centre_m)) > limit:
        near = _Candidate()
        open_.append(near)
    near.sightings.append(sighting)


@dataclass
class _Passage:
    candidate: _Candidate
    centre_m: Array
    radius_m: float
    first: int
    last: int
    nearest: int


def _passage(candidate: _Candidate, poses: Array, settings: PlaceSettings) -> _Passage | None:
    """Find the span of scans during which the robot was in the place; None if it never was.

    A place that is seen from afar only, such as the end of a corridor, is not visited.
    """
    centre, radius = candidate.centre_m, candidate.radius_m
    distance = np.hypot(*(poses[:, :2] - centre).T)
    scans = [s.scan for s in candidate.sightings]
    reach, end = max(radius, 1.0) + 0.5, scans[-1]
    nearest = scans[0] + int(np.argmin(distance[scans[0] : end + 1]))
    if distance[nearest] > reach:  # perhaps the robot comes there later
        while end < len(poses) - 1 and distance[end + 1] < radius + 2.0 + settings.same_place_m:
            end += 1
        nearest = scans[0] + int(np.argmin(distance[scans[0] : end + 1]))
    if distance[nearest] > reach + 0.5:
        return None
    first = last = nearest
    while first > 0 and distance[first - 1] < reach:
        first -= 1
    while last < len(poses) - 1 and (distance[last + 1] < reach or last + 1 < scans[-1]):
        last += 1
    return _Passage(candidate, centre, radius, first, last, nearest)


def _drop_glimpses(passages: list[_Passage], poses: Array) -> list[_Passage]:
    """Leave out places read once only in passing, close to one that was just read more often.

    Looking back at such a place, one sees the same bend of the same skeleton again.
    """
    return [
        p
        for p in passages
        if len(p.candidate.sightings) > 1
        or not any(
            len(o.candidate.sightings) > 1
            and np.hypot(*(o.centre_m - p.centre_m)) < NESTED_M
            and _drive_between(o, p, poses) < 2 * NESTED_M
            for o in passages
        )
    ]


def _merge_returns(
    passages: list[_Passage], poses: Array, settings: PlaceSettings
) -> list[_Passage]:
    """Join a passage with the one before if the robot merely turned round on a path and came back.

    A travel that ends at the place it began at is no travel (a path is not circular).
    """
    out = list[_Passage]()
    for passage in sorted(passages, key=lambda p: p.nearest):
        before = out[-1] if out else None
        if before is None or not _is_return(before, passage, poses, settings):
            out.append(passage)
            continue
        both = _Candidate(
            before.candidate.sightings + passage.candidate.sightings,
            before.candidate.reviews + passage.candidate.reviews,
        )
        main = max(before, passage, key=lambda p: len(p.candidate.sightings))
        out[-1] = _Passage(
            both,
            main.centre_m,
            main.radius_m,
            min(before.first, passage.first),
            max(before.last, passage.last),
            main.nearest,
        )
    return out


def _is_return(a: _Passage, b: _Passage, poses: Array, settings: PlaceSettings) -> bool:
    driven = _drive_between(a, b, poses)
    apart = float(np.hypot(*(a.centre_m - b.centre_m)))
    shared = min(a.last, b.last) - max(a.first, b.first) + 1
    shorter = min(a.last - a.first, b.last - b.first) + 1
    if shared > NESTED_SHARE * shorter and apart < NESTED_M:
        return not _are_adjacent(a, b)
    return apart < settings.same_place_m + 0.02 * driven and driven < 60.0


def _drive_between(a: _Passage, b: _Passage, poses: Array) -> float:
    """Return how far the robot drove from one place to the other, metres."""
    first, last = sorted((a.nearest, b.nearest))
    return float(np.hypot(*np.diff(poses[first : last + 1, :2], axis=0).T).sum())


def _are_adjacent(a: _Passage, b: _Passage) -> bool:
    """Tell whether two places lie beside each other: none reaches beyond the gateway between.

    Source
    ------
    Beeson 2008, 5.4: a dummy travel leads from one place to another that is adjacent to it; the
    test by the gateways is ours.
    """
    ahead = b.centre_m - a.centre_m
    apart = float(np.hypot(*ahead))
    reach = _reach_towards(a, ahead), _reach_towards(b, -ahead)
    return sum(reach) <= apart + ADJACENT_M


def _reach_towards(passage: _Passage, ahead: Array) -> float:
    """Return how far off the gateway of a place lies that faces a direction; infinite if none."""
    unit = ahead / max(float(np.hypot(*ahead)), 1e-9)
    found = []
    for sighting in passage.candidate.sightings:
        along = (sighting.gateways_m - sighting.centre_m) @ unit
        across = (sighting.gateways_m - sighting.centre_m) @ np.array([-unit[1], unit[0]])
        facing = (along > 0) & (np.abs(across) < 0.5 * along)
        found.append(float(along[facing].max()) if facing.any() else np.inf)
    return float(np.median(found))


def _separate(passages: list[_Passage], poses: Array) -> list[_Passage]:
    """Let each passage end where the next begins, at the gateway that they share.

    The travel between them then has no length: a dummy travel.
    """
    for a, b in itertools.pairwise(passages):
        if a.last < b.first or b.nearest <= a.nearest:
            continue
        scans = np.arange(a.nearest, b.nearest + 1)
        nearness = [
            np.hypot(*(poses[scans, :2] - p.centre_m).T) / max(p.radius_m, 0.5) for p in (a, b)
        ]
        a.last = b.first = int(scans[np.argmin(np.abs(nearness[0] - nearness[1]))])
    return passages


def _commit(
    passage: _Passage, log: ScanLog, poses: Array, settings: PlaceSettings
) -> PlaceVisit | None:
    """Vote for the star, find how the robot came and went, and build the visit."""
    candidate, centre = passage.candidate, passage.centre_m
    leave = _bearing(poses, passage.last, 1, centre) if passage.last < len(poses) - 1 else None
    entry: float | None
    if passage.first > 0:
        entry = _bearing(poses, passage.first, -1, centre)
    else:
        entry = _guess_entry(poses[: passage.last + 1, 2], float(np.ptp(log.angles_rad)))
    local = map_passage(log, poses, centre, passage.nearest, settings)
    if _is_walled_off(candidate, local, poses[passage.nearest], settings):
        return None
    span = passage.first, passage.nearest, passage.last
    again = look_again(local, poses, centre, span, settings)
    reviews = again or candidate.reviews
    readings = vote_star(candidate.sightings, reviews, centre, entry, leave, settings)
    if not readings:
        return None
    return PlaceVisit(
        passage.nearest,
        passage.first,
        passage.last,
        centre,
        passage.radius_m,
        readings,
        local.image(),
        local.frame,
    )


def _is_walled_off(
    candidate: _Candidate, local: LocalMap, pose: Array, settings: PlaceSettings
) -> bool:
    """Tell whether walls part a pose from a place, most sightings where its centre is in a wall.

    Of a sighting all base points have to be parted from the pose.
    """
    width_m, centre = 2 * settings.robot_radius_m, candidate.centre_m
    if not find_walled_off(local, pose, centre, width_m)[0]:
        return False
    if not touches_wall(local, centre, settings.robot_radius_m):
        return True
    bases = [s.frame.to_metres(s.topology.base_px) for s in candidate.sightings]
    parted = find_walled_off(local, pose, np.vstack(bases), width_m)
    ends = np.cumsum([len(base) for base in bases])[:-1]
    return bool(np.mean([part.all() for part in np.split(parted, ends)]) > 0.5)


def _guess_entry(headings: Array, field_rad: float) -> float | None:
    """Return where a drive that begins in a place may have come from; None if nobody can say.

    A robot that has not looked behind itself knows of no way there, but was driven here: the first
    action of the tree of maps brings it along a path (Beeson 2008, Algorithm 8.1, step 0).
    """
    looked = float(np.ptp(np.unwrap(headings))) + field_rad
    return None if looked > LOOKED_AROUND_RAD else float(headings[0] + np.pi)


def _bearing(poses: Array, start: int, step: int, centre: Array) -> float:
    """Direction from the centre to where the robot was a little outside the place."""
    i = min(max(start + step, 0), len(poses) - 1)
    dx, dy = poses[i, :2] - centre
    return float(np.arctan2(dy, dx))
