"""Place detection along a drive: which places the robot visited, with which stars.

The robot keeps its scrolling LPM, reads the local topology every half metre, and is *on-path* while
that topology is two gateways on one local-path; otherwise it suspects a place. A place is
committed only when several readings of the LPM agree on where it is; its star is then voted for by
all of them, and the runner-ups are kept as alternative readings.

Source: Beeson 2008, section 5.3.2 (on-path test, confirmation before a place is committed).
Grouping by base point, voting and the runner-ups are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from perception.continuity import StarReading
from perception.errors import InputError
from perception.geometry import Array, wrap_angle
from perception.grid import Frame, Image
from perception.lpm import LocalMap
from perception.scanlog import ScanLog
from perception.star import Star
from perception.topology import LocalTopology, local_topology

REVIEW_STEP_M, REVIEW_MAX_M, REVIEW_VOTE = 1.0, 4.5, 1.0


@dataclass(frozen=True)
class PlaceSettings:
    """How places are detected.

    Attributes
    ----------
    lpm_m, cell_m, range_cap_m : the LPM: side, cell, and how far a return may be to count.
    robot_radius_m : obstacles are grown by it.
    step_m, step_rad : the local topology is read after this much travel or turning.
    same_place_m : readings whose centres lie closer than this speak of one place.
    confirmations : how many readings commit a place.
    min_frontier_m, min_depth_m : a gateway narrower at its frontier, or leading less far, does not
        count (the *level*: corridors, or doors too).
    vote_m : a reading taken this far from the centre has its vote lowered to 61 %.
    runner_up : readings of the star with a smaller share of the votes are dropped.
    max_readings : how many readings of one star are kept.
    """

    lpm_m: float = 15.0
    cell_m: float = 0.1
    range_cap_m: float = 12.0
    robot_radius_m: float = 0.4
    step_m: float = 0.5
    step_rad: float = 0.6
    same_place_m: float = 1.8
    confirmations: int = 2
    min_frontier_m: float = 0.9
    min_depth_m: float = 1.0
    vote_m: float = 1.5
    runner_up: float = 0.04
    max_readings: int = 6


@dataclass(frozen=True, eq=False)
class Sighting:
    """The local topology read once, carried into the drive frame.

    Attributes
    ----------
    scan : index of the scan after which it was read. pose : (3,) of the laser then.
    centre_m : (2,) centroid of the base points. radius_m : how far the place reaches.
    gateways_m : (g, 2) centres of the gateways. topology : as read, in pixels of ``frame``.
    """

    scan: int
    pose: Array
    centre_m: Array
    radius_m: float
    gateways_m: Array
    topology: LocalTopology
    frame: Frame


@dataclass(frozen=True)
class PlaceReading:
    """One reading of the star of a visit: the dlps, how the robot came and went, how likely.

    Attributes
    ----------
    headings_rad : direction of each dlp, counter-clockwise, drive frame.
    gateways_m : centre of the gateway through which each dlp leaves, relative to the place, drive
        axes; NaN where there is none.
    weight : probability; those of one visit sum to 1.
    """

    star: Star
    arrive: int | None
    depart: int | None
    headings_rad: tuple[float, ...]
    gateways_m: tuple[tuple[float, float], ...]
    weight: float


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
    tile: Image | None = None
    tile_frame: Frame | None = None
    tile_distance_m: float = np.inf

    reviewed_m: float = 0.0

    def review(
        self, scan: int, away: float, poses: Array, local: LocalMap, settings: PlaceSettings
    ) -> None:
        """Look back at the place from a little beyond, when both of its sides have been seen."""
        if away < self.reviewed_m + REVIEW_STEP_M or away > REVIEW_MAX_M:
            return
        self.reviewed_m = away
        pose = poses[scan].copy()
        sighting = _sight(scan, pose, local, settings, at_m=self.centre_m)
        if sighting is not None and np.hypot(*(sighting.centre_m - self.centre_m)) < 2.0:
            self.reviews.append(sighting)

    @property
    def confirmations(self) -> int:
        return len(self.sightings) + len(self.reviews)

    @property
    def centre_m(self) -> Array:
        return np.asarray(np.mean([s.centre_m for s in self.sightings], axis=0))

    @property
    def radius_m(self) -> float:
        return float(np.median([s.radius_m for s in self.sightings]))


def read_sightings(
    log: ScanLog,
    poses: Array,
    settings: PlaceSettings,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[tuple[Sighting | None, int, LocalMap]]:
    """Drive through the log with a scrolling LPM and read the local topology as one goes.

    Yields
    ------
    (sighting, scan, LPM) : once a step; the sighting is None where no gateway search was possible
        or the robot is on-path. The LPM is the live one: copy what you keep.
    """
    local = LocalMap(settings.lpm_m, settings.cell_m, settings.range_cap_m)
    last = None
    for i in range(len(log)):
        local.update(poses[i], log.ranges_m[i], log.angles_rad)
        if progress is not None:
            progress(i + 1, len(log))
        if last is not None and _moved_little(poses[last], poses[i], settings):
            continue
        last = i
        yield _sight(i, poses[i], local, settings), i, local


def _moved_little(a: Array, b: Array, settings: PlaceSettings) -> bool:
    near = float(np.hypot(*(b - a)[:2])) < settings.step_m
    return near and bool(abs(wrap_angle(b[2] - a[2])) < settings.step_rad)


def _sight(
    scan: int, pose: Array, local: LocalMap, settings: PlaceSettings, at_m: Array | None = None
) -> Sighting | None:
    """Read the local topology around the robot, or around another point of the LPM."""
    image, frame = local.image(), local.frame
    column, row = frame.to_pixels(pose[:2] if at_m is None else at_m)
    try:
        topology = local_topology(
            image,
            robot_px=(float(column), float(row)),
            resolution_m=settings.cell_m,
            robot_radius_m=settings.robot_radius_m,
            min_frontier_m=settings.min_frontier_m,
            min_depth_m=settings.min_depth_m,
            denoise=False,
        )
    except InputError:  # the LPM shows the robot in a wall: somebody stands close by
        return None
    if not topology.at_place or not topology.gateways:
        return None
    base = frame.to_metres(topology.base_px)
    centre = base.mean(axis=0)
    gates = frame.to_metres(np.array([g.centre_px for g in topology.gateways], float))
    radius = float(np.median(np.hypot(*(gates - centre).T)))
    return Sighting(scan, pose.copy(), centre, radius, gates, topology, frame)


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
    open_, done = list[_Candidate](), list[_Candidate]()
    for sighting, scan, local in read_sightings(log, poses, settings, progress):
        if sighting is not None:
            candidate = _assign(sighting, open_, settings)
            distance = float(np.hypot(*(sighting.pose[:2] - sighting.centre_m)))
            if distance <= candidate.tile_distance_m:
                candidate.tile, candidate.tile_frame = local.image(), local.frame
                candidate.tile_distance_m = distance
        for candidate in list(open_):
            away = float(np.hypot(*(poses[scan, :2] - candidate.centre_m)))
            candidate.review(scan, away, poses, local, settings)
            if away > candidate.radius_m + 2.0 + settings.same_place_m:
                open_.remove(candidate)
                done.append(candidate)
    done += open_
    confirmed = [c for c in done if c.confirmations >= settings.confirmations]
    passages = _merge_returns([_passage(c, poses) for c in confirmed], poses, settings)
    visits = (_commit(p, poses, settings, len(log)) for p in passages)
    return tuple(visit for visit in visits if visit is not None)


def _assign(sighting: Sighting, open_: list[_Candidate], settings: PlaceSettings) -> _Candidate:
    """Give the sighting to the nearest open candidate, or open a new one."""
    near = min(
        open_, key=lambda c: float(np.hypot(*(c.centre_m - sighting.centre_m))), default=None
    )
    limit = max(settings.same_place_m, 0.5 * sighting.radius_m)
    if near is None or np.hypot(*(near.centre_m - sighting.centre_m)) > limit:
        near = _Candidate()
        open_.append(near)
    near.sightings.append(sighting)
    return near


@dataclass
class _Passage:
    candidate: _Candidate
    centre_m: Array
    radius_m: float
    first: int
    last: int
    nearest: int


def _passage(candidate: _Candidate, poses: Array) -> _Passage:
    """Find the span of scans during which the robot was in the place."""
    centre, radius = candidate.centre_m, candidate.radius_m
    distance = np.hypot(*(poses[:, :2] - centre).T)
    scans = [s.scan for s in candidate.sightings]
    nearest = scans[0] + int(np.argmin(distance[scans[0] : scans[-1] + 1]))
    reach = max(radius, 1.0) + 0.5
    first = last = nearest
    while first > 0 and distance[first - 1] < reach:
        first -= 1
    while last < len(poses) - 1 and (distance[last + 1] < reach or last + 1 < scans[-1]):
        last += 1
    return _Passage(candidate, centre, radius, first, last, nearest)


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
        best = min((before.candidate, passage.candidate), key=lambda c: c.tile_distance_m)
        both.tile, both.tile_frame = best.tile, best.tile_frame
        out[-1] = _Passage(
            both,
            before.centre_m,
            before.radius_m,
            before.first,
            max(before.last, passage.last),
            before.nearest,
        )
    return out


def _is_return(a: _Passage, b: _Passage, poses: Array, settings: PlaceSettings) -> bool:
    between = poses[a.nearest : b.nearest + 1, :2]
    driven = float(np.hypot(*np.diff(between, axis=0).T).sum()) if len(between) > 1 else 0.0
    apart = float(np.hypot(*(a.centre_m - b.centre_m)))
    return apart < settings.same_place_m + 0.02 * driven and driven < 60.0


def _commit(
    passage: _Passage, poses: Array, settings: PlaceSettings, scans: int
) -> PlaceVisit | None:
    """Vote for the star, find how the robot came and went, and build the visit."""
    candidate, centre = passage.candidate, passage.centre_m
    entry = _bearing(poses, passage.first, -1, centre) if passage.first > 0 else None
    leave = _bearing(poses, passage.last, 1, centre) if passage.last < scans - 1 else None
    groups = _vote(candidate, centre, settings)
    oriented = [_oriented(group, share, entry, leave) for group, share in groups]
    readings = sorted((r for r in oriented if r is not None), key=lambda r: -r.weight)
    if not readings or candidate.tile is None or candidate.tile_frame is None:
        return None
    best = readings[0].weight
    kept = [r for r in readings if r.weight >= settings.runner_up * best][: settings.max_readings]
    total = sum(r.weight for r in kept)
    return PlaceVisit(
        passage.nearest,
        passage.first,
        passage.last,
        centre,
        passage.radius_m,
        tuple(
            PlaceReading(r.star, r.arrive, r.depart, r.headings_rad, r.gateways_m, r.weight / total)
            for r in kept
        ),
        candidate.tile,
        candidate.tile_frame,
    )


def _bearing(poses: Array, start: int, step: int, centre: Array) -> float:
    """Direction from the centre to where the robot was a little outside the place."""
    i = min(max(start + step, 0), len(poses) - 1)
    dx, dy = poses[i, :2] - centre
    return float(np.arctan2(dy, dx))


@dataclass
class _Group:
    """Equal readings of the star, seen from several poses."""

    reading: StarReading
    headings_rad: Array
    gateways_m: Array
    votes: float
    best_vote: float


def _vote(
    candidate: _Candidate, centre: Array, settings: PlaceSettings
) -> list[tuple[_Group, float]]:
    """Add up the votes of all sightings for each different star; return the shares."""
    groups = list[_Group]()
    for sighting in candidate.sightings + candidate.reviews:
        distance = float(np.hypot(*(sighting.pose[:2] - centre)))
        weight = float(np.exp(-0.5 * (distance / settings.vote_m) ** 2))
        if sighting in candidate.reviews:
            weight = REVIEW_VOTE
        for reading in sighting.topology.readings:
            vote = weight * reading.weight
            headings = -np.asarray(reading.headings_px, float)
            gates = _dlp_gateways(reading, sighting) - sighting.centre_m
            for group in groups:
                if _same_star(group, reading, headings):
                    break
            else:
                group = _Group(reading, headings, gates, 0.0, 0.0)
                groups.append(group)
            group.votes += vote
            if vote > group.best_vote:
                group.reading, group.headings_rad, group.gateways_m = reading, headings, gates
                group.best_vote = vote
    total = sum(group.votes for group in groups)
    return [(g, g.votes / total) for g in groups if not _is_path(g.reading.star)]


def _is_path(star: Star) -> bool:
    """Tell whether a star is that of a bare path: two gateways, one local-path."""
    return len(star) == 2 and all(star.alpha)


def _dlp_gateways(reading: StarReading, sighting: Sighting) -> Array:
    """Return the (m, 2) gateway centre of each dlp, drive frame; NaN where alpha is 0."""
    out = np.full((len(reading.star), 2), np.nan)
    for k, gateway in enumerate(reading.gateway_out):
        if gateway is not None:
            out[k] = sighting.gateways_m[gateway]
    return out


def _same_star(group: _Group, reading: StarReading, headings: Array) -> bool:
    """Tell whether two readings are one star: isomorphic with their directions lined up."""
    size = len(reading.star)
    alpha = np.array(reading.star.alpha, bool)
    for r in reading.star.isomorphisms(group.reading.star):
        turned = group.headings_rad[(np.arange(size) + r) % size]
        if np.all(np.abs(wrap_angle(turned - headings))[alpha] < 0.7):
            return True
    return False


def _oriented(
    group: _Group, share: float, entry: float | None, leave: float | None
) -> PlaceReading | None:
    """Find the dlps the robot came and went by; None if the star has no gateway there."""
    star = group.reading.star
    outward = np.arctan2(group.gateways_m[:, 1], group.gateways_m[:, 0])
    penalty = 1.0

    def gateway_at(bearing: float) -> int | None:
        nonlocal penalty
        off = np.abs(wrap_angle(outward - bearing))
        off = np.where(np.isnan(off), np.inf, off)
        k = int(np.argmin(off))
        if off[k] > 1.0:
            return None
        penalty *= float(np.exp(-0.5 * (off[k] / 0.5) ** 2))
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
    )
