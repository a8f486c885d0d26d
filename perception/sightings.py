"""What the robot sees of places as it drives: the local topology, read at every step.

Source: Beeson 2008, section 5.3.2 (the on-path test); the steps are ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from perception.errors import InputError
from perception.evidence import weigh_gateways
from perception.geometry import Array, wrap_angle
from perception.grid import OCCUPIED, Frame, Image
from perception.level import Level, close_gateways
from perception.lpm import LocalMap
from perception.scanlog import ScanLog
from perception.star import Star
from perception.topology import LocalTopology, local_topology

LEAST_SHARE = 0.25
"""Readings that say "place" with less probability than this are readings of a path."""

START_M = 1.0
"""A robot that has gone so far has left the place where it knew nothing behind itself."""

LOOKED_AROUND_RAD = 5.5
"""A robot that has seen so much of its surroundings has looked around."""

AHEAD_M = (0.5, 1.0, 1.5, 2.0)
"""Where a drive ends, the local topology is read so far ahead of the robot too."""

MOUTH_M = 1.0
"""A robot so far outside the gateways of a place stands at its mouth."""

_MOST_SHUT = 4
"""Behind a door that is shut another may turn up, but not without end."""


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
    min_frontier_m, min_depth_m : a gateway narrower at its frontier, or leading less far, is not
        looked for (corridors, or doors too).
    min_gateway_m : a narrower gateway, once found, does not count, unless the robot drives through
        it (the *level*; see :mod:`perception.level`).
    door_share : nor does one narrower than this share of the path, which is a door.
    vote_m : a reading taken this far from the centre has its vote lowered to 61 %.
    runner_up : readings of the star with a smaller share of the votes are dropped.
    max_readings : how many readings of one star are kept.
    by_sight : the drive is over: a way need not let the robot pass for ``min_depth_m``, if it is
        seen to go on so far; where nobody looked, how far it leads says nothing.
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
    min_gateway_m: float = 0.0
    door_share: float = 0.56
    vote_m: float = 1.5
    runner_up: float = 0.04
    max_readings: int = 6
    by_sight: bool = False


@dataclass(frozen=True, eq=False)
class Sighting:
    """The local topology read once, carried into the drive frame.

    Attributes
    ----------
    scan : index of the scan after which it was read. pose : (3,) of the laser then.
    centre_m : (2,) centroid of the base points. radius_m : how far the place reaches.
    gateways_m : (g, 2) centres of the gateways.
    share : probability that this is a place and not a bare path.
    topology : as read, in pixels of ``frame``.
    vote : how much it counts beside others; below 1 if read otherwise than the settings say.
    """

    scan: int
    pose: Array
    centre_m: Array
    radius_m: float
    gateways_m: Array
    share: float
    topology: LocalTopology
    frame: Frame
    vote: float = 1.0


def is_path(star: Star) -> bool:
    """Tell whether a star is that of a bare path: two gateways, one local-path.

    Source
    ------
    Beeson 2008, section 5.3.2 (the on-path test).
    """
    return len(star) == 2 and all(star.alpha)


def read_sightings(
    log: ScanLog,
    poses: Array,
    settings: PlaceSettings,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[tuple[Sighting | None, int, LocalMap]]:
    """Drive through the log with a scrolling LPM and read the local topology as one goes.

    Yields
    ------
    (sighting, scan, LPM) : once a step; the sighting is None where no gateway search was possible,
        the robot is on-path, or does not know yet what lies behind it. The LPM is the live one:
        copy what you keep.
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
        sighting = None
        if knows_behind(poses[: i + 1], float(np.ptp(log.angles_rad))):
            sighting = read_topology(i, poses, local, settings)
        yield sighting, i, local


def look_ahead(
    poses: Array, local: LocalMap, settings: PlaceSettings
) -> Iterator[tuple[Sighting | None, Array]]:
    """Read the local topology ahead of a robot whose drive has ended, at places it stands before.

    A drive that ends at the mouth of a place leaves it seen but not entered, so that nothing was
    read there.

    Parameters
    ----------
    poses : (n, 3) of the laser. local : the LPM at the last of them.

    Yields
    ------
    (sighting, point) : at each point (2,), drive frame, that no wall hides; the sighting is None as
        for :func:`read_sightings`.

    Source
    ------
    Ours.
    """
    end, heading = poses[-1, :2], float(poses[-1, 2])
    occupied = local.image() == OCCUPIED
    for ahead_m in AHEAD_M:
        point = end + ahead_m * np.array([np.cos(heading), np.sin(heading)])
        column, row = np.rint(local.frame.to_pixels(point)).astype(int)
        if occupied[row - 1 : row + 2, column - 1 : column + 2].any():
            return
        sighting = read_topology(len(poses) - 1, poses, local, settings, at_m=point)
        if sighting is not None:
            away = float(np.hypot(*(sighting.centre_m - end)))
            if away > sighting.radius_m + MOUTH_M:
                continue
        yield sighting, point


def knows_behind(poses: Array, field_rad: float) -> bool:
    """Tell whether a robot that began its drive has seen what lies behind it.

    Before it has gone on a little, or looked around, the end of what it knows lies at its back and
    looks like a gateway.

    Parameters
    ----------
    poses : (n, 3) of the laser so far. field_rad : the angle that the laser sees.

    Source
    ------
    Ours.
    """
    if float(np.hypot(*(poses[:, :2] - poses[0, :2]).T).max()) >= START_M:
        return True
    return float(np.ptp(np.unwrap(poses[:, 2]))) + field_rad > LOOKED_AROUND_RAD


def _moved_little(a: Array, b: Array, settings: PlaceSettings) -> bool:
    near = float(np.hypot(*(b - a)[:2])) < settings.step_m
    return near and bool(abs(wrap_angle(b[2] - a[2])) < settings.step_rad)


def read_topology(
    scan: int, poses: Array, local: LocalMap, settings: PlaceSettings, at_m: Array | None = None
) -> Sighting | None:
    """Read the local topology around the robot, or around another point of the LPM.

    Parameters
    ----------
    scan : index of the last scan in the LPM.
    poses : (n, 3) of the laser, drive frame, of all scans so far or of the whole drive.
    at_m : (2,) the other point, drive frame.

    Returns
    -------
    None on what is most likely a bare path, and where no gateway search is possible.
    """
    frame, pose = local.frame, poses[scan].copy()
    column, row = frame.to_pixels(pose[:2] if at_m is None else at_m)
    way_px = frame.to_pixels(_list_nearby(poses, scan, settings.lpm_m))
    try:
        topology = _read(local.image(), (float(column), float(row)), way_px, settings)
    except InputError:  # the LPM shows the robot in a wall: somebody stands close by
        return None
    share = sum(r.weight for r in topology.readings if not is_path(r.star))
    if share < LEAST_SHARE or not topology.gateways:
        return None
    base = frame.to_metres(topology.base_px)
    centre = base.mean(axis=0)
    gates = frame.to_metres(np.array([g.centre_px for g in topology.gateways], float))
    radius = float(np.median(np.hypot(*(gates - centre).T)))
    return Sighting(scan, pose, centre, radius, gates, share, topology, frame)


def _read(
    image: Image, robot_px: tuple[float, float], way_px: Array, settings: PlaceSettings
) -> LocalTopology:
    """Return the local topology at the level of the settings."""
    level = Level(min_width_m=settings.min_gateway_m, door_share=settings.door_share)
    for _ in range(_MOST_SHUT):
        topology = local_topology(
            image,
            robot_px=robot_px,
            resolution_m=settings.cell_m,
            robot_radius_m=settings.robot_radius_m,
            min_frontier_m=settings.min_frontier_m,
            min_depth_m=settings.min_depth_m,
            denoise=False,
            way_px=way_px,
            by_sight=settings.by_sight,
        )
        closed = None
        if not level.admits_all:
            closed = close_gateways(image, topology, level, settings.cell_m, way_px)
        if closed is None:
            break
        image = closed
    return weigh_gateways(
        topology,
        image,
        way_px,
        min_frontier_px=settings.min_frontier_m / settings.cell_m,
        min_depth_px=settings.min_depth_m / settings.cell_m,
        is_over=settings.by_sight,
    )


def _list_nearby(poses: Array, scan: int, reach_m: float) -> Array:
    """Return where the robot was (k, 2) just before and after a scan, as long as it was near."""
    far = np.flatnonzero(np.hypot(*(poses[:, :2] - poses[scan, :2]).T) > reach_m)
    k = int(np.searchsorted(far, scan))
    first = int(far[k - 1]) + 1 if k > 0 else 0
    last = int(far[k]) if k < len(far) else len(poses)
    return np.asarray(poses[first:last, :2])
