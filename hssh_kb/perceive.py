"""From a drive to an Experience: visits, stars and displacements, ready for the axioms.

This is the one place where small-scale space is handed over to large-scale space.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hssh_kb.experience import Displacement, Experience, Reading, Visit, checked_covariance
from perception.geometry import Array
from perception.places import PlaceReading, PlaceVisit

CENTRE_SIGMA_M = 0.25
"""How well the centre of a place is found again, one standard deviation (ours, recorded logs)."""

SLIP = 0.1
"""Probability that a place goes unnoticed during one travel, beforehand (ours, recorded logs: 0 to
0.4, in corridors seldom, in furnished rooms often)."""


def make_experience(
    visits: Sequence[PlaceVisit],
    poses: Array,
    covariance_between: Callable[[int, int], Array],
    *,
    source: str = "",
    times_s: Array | None = None,
    lpm_matches: Sequence[tuple[tuple[int, float], ...]] = (),
) -> Experience:
    """Turn the visits of a drive into an Experience.

    The frame of a visit has its origin at the centre of the place and the axes of the drive frame.

    Parameters
    ----------
    visits : in order of time.
    poses : (n, 3) poses of the laser, drive frame.
    covariance_between : gives the (3, 3) covariance of the pose of scan j in the frame of scan i.
    lpm_matches : for each visit, what its local map says on earlier ones; see
        :func:`perception.tile_matching.list_matches`.

    Source
    ------
    Beeson 2008, section 9.3.1: lambda composed of the place, the travel and the place again.
    """
    out = []
    for v, visit in enumerate(visits):
        displacement = None
        if v > 0:
            displacement = _displace(visits[v - 1], visit, poses, covariance_between)
        pose = (float(visit.centre_m[0]), float(visit.centre_m[1]), 0.0)
        out.append(
            Visit(
                tuple(_reading(r, first=v == 0, last=v == len(visits) - 1) for r in visit.readings),
                displacement,
                pose=pose,
                time_s=float(times_s[visit.scan]) if times_s is not None else None,
                lpm_matches=lpm_matches[v] if lpm_matches else (),
            )
        )
    return Experience(tuple(out), source, SLIP)


def _reading(reading: PlaceReading, *, first: bool, last: bool) -> Reading:
    return Reading(
        reading.star,
        None if first else reading.arrive,
        None if last else reading.depart,
        reading.weight,
        reading.headings_rad,
        reading.types if any(reading.types) else (),
    )


def _displace(
    before: PlaceVisit,
    visit: PlaceVisit,
    poses: Array,
    covariance_between: Callable[[int, int], Array],
) -> Displacement:
    """Return lambda between two visits, whose frames have the axes of the drive frame."""
    dx, dy = visit.centre_m - before.centre_m
    cov = covariance_between(before.scan, visit.scan)
    heading = poses[before.scan, 2]
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    cov = turn @ cov @ turn.T
    # The end points are place centres, not robot poses: carry the heading error out to them.
    arm = visit.centre_m - poses[visit.scan, :2]
    lever = np.eye(3)
    lever[0, 2], lever[1, 2] = -arm[1], arm[0]
    cov = lever @ cov @ lever.T + np.diag([1e-4, 1e-4, 1e-6])
    return Displacement(float(dx), float(dy), 0.0, checked_covariance(0.5 * (cov + cov.T)))
