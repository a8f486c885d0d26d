"""The metrical level of a drive: places, trajectory and global map of one hypothesis.

Each visit has its own estimate of the frame of its place. Where the hypothesis says that two visits
saw one place, their scans are matched, the pose graph over all visits is laid out, and the
trajectory is bent to it.

Source: Beeson 2008, sections 9.3.1 (aligning the maps of a revisited place, first by gateways, then
by obstacles) to 9.3.4. One node a visit instead of one a place is ours: a place centre is found
again to a quarter of a metre only, a matched scan to centimetres.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.layout import lay_out
from hssh_kb.perceive import CENTRE_SIGMA_M
from hssh_kb.records import PlaceLayout
from perception.geometry import Array, between, compose, invert, wrap_angle
from perception.mapping import bend_trajectory
from perception.matching import match_scan
from perception.places import PlaceVisit
from perception.scanlog import ScanLog
from perception.surfaces import Reference, Surface, fit_normals

HEADING_SIGMA_RAD = 0.08
"""How well the directions of gateways turn two visits into one frame, one standard deviation."""

_MATCH_SCORE = 0.7
_SUBMAP_M = 4.0


def place_rotation(experience: Experience, hypothesis: Hypothesis, visit: int) -> float:
    """Return the heading of the frame of a visit in the frame of its place, radians.

    It is what lines up the dlps that the hypothesis identifies; 0 if no directions are known.
    """
    first = hypothesis.visits[visit]
    mine = hypothesis.reading(experience, visit)
    theirs = hypothesis.reading(experience, first)
    if first == visit or not mine.headings or not theirs.headings:
        return 0.0
    size = len(mine.star)
    alpha = np.array(mine.star.alpha, bool)
    order = (np.arange(size) + hypothesis.offsets[visit]) % size
    turn = np.asarray(theirs.headings)[order] - np.asarray(mine.headings)
    turn = turn[alpha] if alpha.any() else turn
    return float(np.arctan2(np.sin(turn).sum(), np.cos(turn).sum()))


def settle_drive(
    experience: Experience,
    hypothesis: Hypothesis,
    log: ScanLog,
    poses: Array,
    visits: Sequence[PlaceVisit],
) -> tuple[Array, PlaceLayout]:
    """Lay out a drive on one hypothesis.

    Parameters
    ----------
    log : the scans. poses : (n, 3) of the laser, drive frame. visits : as detected, one for each
        visit of the experience.

    Returns
    -------
    trajectory : (n, 3) in the map frame, whose origin is the frame of the first visit.
    layout : the poses of the places of the hypothesis, in its order.
    """
    count = len(hypothesis.visits)
    frames = [np.array([*visit.centre_m, 0.0]) for visit in visits[:count]]
    i, j, z, information = _travel_edges(experience, count)
    for v in range(count):
        first = hypothesis.visits[v]
        if first == v:
            continue
        pose, covariance = _close(experience, hypothesis, log, poses, visits, v)
        i.append(first)
        j.append(v)
        z.append(pose)
        information.append(np.asarray(np.linalg.inv(covariance), float))
    layout = lay_out(count, i, j, np.array(z).reshape(-1, 3), np.array(information))
    anchors, targets = _anchor(visits[:count], frames, poses, layout.poses)
    trajectory = bend_trajectory(poses, anchors, targets)
    firsts = list(hypothesis.places)
    places = PlaceLayout(layout.poses[firsts], layout.covariances[firsts], layout.chi2)
    return trajectory, places


def _travel_edges(
    experience: Experience, count: int
) -> tuple[list[int], list[int], list[Array], list[Array]]:
    i, j, z, information = list[int](), list[int](), list[Array](), list[Array]()
    for v in range(1, count):
        lam = experience.visits[v].displacement
        if lam is None:
            continue
        i.append(v - 1)
        j.append(v)
        z.append(np.array([lam.x, lam.y, lam.theta]))
        information.append(np.asarray(np.linalg.inv(np.array(lam.cov)), float))
    return i, j, z, information


def _close(
    experience: Experience,
    hypothesis: Hypothesis,
    log: ScanLog,
    poses: Array,
    visits: Sequence[PlaceVisit],
    v: int,
) -> tuple[Array, Array]:
    """Return the frame of visit v in the frame of the first visit of its place, with covariance."""
    first = hypothesis.visits[v]
    turn = place_rotation(experience, hypothesis, v)
    guess = np.array([0.0, 0.0, turn])
    spread = np.diag([2 * CENTRE_SIGMA_M**2, 2 * CENTRE_SIGMA_M**2, HEADING_SIGMA_RAD**2])
    here, there = visits[v], visits[first]
    frame_here = np.array([*here.centre_m, 0.0])
    frame_there = np.array([*there.centre_m, 0.0])
    reference = _submap(log, poses, there, frame_there)
    scan = fit_normals(log.beam_points(here.scan, 12.0))
    if reference is None:
        return guess, spread
    laser = between(frame_here, poses[here.scan])
    match = match_scan(scan, reference, compose(guess, laser), spread, window=(1.2, 0.3))
    if not match.ok or match.score < _MATCH_SCORE:
        return guess, spread
    found = compose(match.pose, invert(laser))
    found[2] = wrap_angle(found[2])
    return found, match.covariance + np.diag([0.02, 0.02, 0.005]) ** 2


def _submap(log: ScanLog, poses: Array, visit: PlaceVisit, frame: Array) -> Reference | None:
    """Gather the scans taken around a visit, in the frame of the visit."""
    distance = np.hypot(*(poses[:, :2] - visit.centre_m).T)
    low = high = visit.scan
    while low > 0 and distance[low - 1] < _SUBMAP_M:
        low -= 1
    while high < len(log) - 1 and distance[high + 1] < _SUBMAP_M:
        high += 1
    every = max(1, (high - low + 1) // 12)
    chosen = sorted({*range(low, high + 1, every), visit.scan})
    parts = list[Surface]()
    for k in chosen:
        surface = fit_normals(log.beam_points(k, 12.0))
        if len(surface):
            parts.append(_carried(surface, between(frame, poses[k])))
    if not parts:
        return None
    return Reference(
        Surface(
            np.concatenate([p.points for p in parts]),
            np.concatenate([p.normals for p in parts]),
            np.concatenate([p.spacing_m for p in parts]),
        )
    )


def _carried(surface: Surface, pose: Array) -> Surface:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    rotation = np.array([[c, -s], [s, c]])
    return Surface(
        surface.points @ rotation.T + pose[:2], surface.normals @ rotation.T, surface.spacing_m
    )


def _anchor(
    visits: Sequence[PlaceVisit], frames: Sequence[Array], poses: Array, laid: Array
) -> tuple[list[int], Array]:
    """Return the scans at which the drive is pinned down, and their poses in the map frame."""
    anchors, targets = list[int](), list[Array]()
    for visit, frame, target in zip(visits, frames, laid, strict=True):
        if anchors and visit.scan <= anchors[-1]:
            continue
        anchors.append(visit.scan)
        targets.append(compose(target, between(frame, poses[visit.scan])))
    return anchors, np.array(targets)
