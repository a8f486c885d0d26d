"""How exactly the headings of dlps are told, learned from visits that soon come back.

Where a short stretch of the walk leads back to its beginning, round a block or out of a dead end,
both visits are to one place in whatever map. The angles between their dlps should then agree; by
how much they do not tells the noise. Exact headings tell crossings apart that differ by little,
and keep the layout of a large town straight; headings that are taken for more exact than they are
refuse the right map.

Source: ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from hssh_kb.experience import Experience, Reading
from perception.geometry import compose, compose_covariance, wrap_angle

_MOST_TRAVELS = 12  # in a stretch
_SURE_NATS = math.log(10.0)  # by which coming back must explain its displacements better
_LEAST_PAIRS = 20
_CAUTION = 2.0  # standard errors that the noise is taken to be larger
_LEAST_RAD = math.radians(0.5)  # headings are never taken to be more exact
_NORMAL = 1.4826  # standard deviation of a normal distribution by its median absolute value


def estimate_heading_noise(experience: Experience, area_m2: float) -> float | None:
    """Return the standard deviation [rad] of the heading of a dlp as told at a visit.

    Parameters
    ----------
    experience : the visits; their best readings are looked at.
    area_m2 : area per place, which a place that is come back to competes with.

    Returns
    -------
    noise : on the safe side; None if too few visits come back to tell.
    """
    found = list[float]()
    pairs = 0
    for v, later, theta in _find_returns(experience, area_m2):
        readings = experience.visits[v].readings[0], experience.visits[later].readings[0]
        misfits = _compare_headings(*readings, theta)
        pairs += bool(misfits)
        found += misfits
    if pairs < _LEAST_PAIRS:
        return None
    noise = _NORMAL * float(np.median(np.abs(found))) / math.sqrt(2)
    return max(noise * (1 + _CAUTION / math.sqrt(pairs)), _LEAST_RAD)


def _find_returns(experience: Experience, area_m2: float) -> Iterator[tuple[int, int, float]]:
    """Yield visits v and later ones to the same place, with the turn [rad] in between."""
    moves = [visit.displacement for visit in experience.visits]
    steps = np.array([[m.x, m.y, m.theta] if m else [0.0, 0.0, 0.0] for m in moves])
    covs = np.array([m.cov if m else np.full((3, 3), np.nan) for m in moves])
    pose, cov = np.zeros((len(moves), 3)), np.zeros((len(moves), 3, 3))
    for travels in range(1, min(_MOST_TRAVELS, len(moves) - 1) + 1):
        pose, cov, step = pose[:-1], cov[:-1], steps[travels:]
        cov = compose_covariance(pose, cov, step, covs[travels:])
        pose = compose(pose, step)
        if travels == 1:
            continue
        spread, off = cov[:, :2, :2], pose[:, :2]
        with np.errstate(invalid="ignore"):
            chi2 = np.einsum("na,nab,nb->n", off, np.linalg.inv(spread), off)
            worth = -0.5 * (chi2 + np.log(np.linalg.det(2 * math.pi * spread)))
        for v in np.flatnonzero(worth + math.log(area_m2) > _SURE_NATS).tolist():
            yield v, v + travels, float(pose[v, 2])


def _compare_headings(before: Reading, after: Reading, theta: float) -> list[float]:
    """Return the misfits [rad] of the angles between the dlps of two visits to one place.

    Each as far off as a single difference of two headings; none if the stars do not match.

    Parameters
    ----------
    before, after : readings of the two visits.
    theta : by how much [rad] the frame of the later visit is turned.
    """
    size = len(after.headings)
    if not size or len(before.headings) != size:
        return []
    seen = [k for k in range(size) if after.star.alpha[k]]
    best, misfits = math.inf, list[float]()
    for offset in after.star.isomorphisms(before.star):
        off = [before.headings[(k + offset) % size] - after.headings[k] - theta for k in seen]
        mean = math.atan2(sum(map(math.sin, off)), sum(map(math.cos, off)))
        if len(seen) > 1 and abs(mean) < best:
            free = math.sqrt(len(seen) / (len(seen) - 1))
            best, misfits = abs(mean), (wrap_angle(np.array(off) - mean) * free).tolist()
    return misfits
