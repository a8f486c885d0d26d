"""What the travels of a walk have in common, and what that tells of each corridor.

Many worlds are built to a measure: neighbouring places are about equally far apart, and corridors
run straight along the dlps they leave by. Where the displacements show that, beyond their noise,
they give every corridor a prior, and the first travel through it is sharpened by what all travels
have in common. Later travels through it are taken as measured, so the prior counts once for each
corridor. Where lengths differ by much more than the noise, as in most buildings, nothing is
gained and nothing changes.

Source: empirical Bayes after Efron & Morris, "Stein's estimation rule and its competitors",
Journal of the American Statistical Association 68, 1973; its use for travels is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hssh_kb.experience import Displacement, Experience, Reading
from perception.geometry import Array

_LEAST_TRAVELS = 12
_LEAST_SHARE = 0.8  # of the travels must be of the common kind
_MOST_SPREAD = 1.5  # standard deviations of a displacement by which corridors may differ
_CAUTION = 2.0  # standard errors that the variance of the corridors is taken to be larger
_SURE = 0.9  # a travel is sharpened if it is of the common kind with that probability
_STRETCHES = (2, 4, 8)  # so many travels in a row must vary no more than independent ones
_ROUNDS = 30


class Told(NamedTuple):
    """What the first travel through a corridor tells.

    Attributes
    ----------
    move : the displacement, sharpened; as measured if it is not of the common kind.
    log_density : of such a displacement through a corridor not known yet, 1/m2.
    """

    move: Displacement
    log_density: float


@dataclass(frozen=True)
class TravelPrior:
    """The common kind of corridor: Gaussian along and across the dlp it leaves by.

    Attributes
    ----------
    length_m, along_m2 : mean and variance of the lengths.
    across_m2 : variance of how far it ends beside the line of the dlp; infinite if not known.
    share : share of the travels that are of that kind.
    reach_m : length of the longest travel; the other travels end anywhere within it.
    """

    length_m: float
    along_m2: float
    across_m2: float
    share: float
    reach_m: float

    def sharpen(self, move: Displacement, heading_rad: float | None) -> Told:
        """Return what a displacement tells if it is the first through its corridor.

        Parameters
        ----------
        move : as measured.
        heading_rad : direction of the dlp left by, in the frame of the visit left; None if
            unknown.

        Examples
        --------
        >>> prior = TravelPrior(1.0, 0.01, 0.01, 0.95, 2.0)
        >>> move = Displacement(1.2, 0.0, 0.0, ((0.01, 0, 0), (0, 0.01, 0), (0, 0, 0.01)))
        >>> told = prior.sharpen(move, 0.0)
        >>> round(told.move.x, 3), round(told.move.cov[0][0], 4)
        (1.1, 0.005)
        """
        way = math.atan2(move.y, move.x) if heading_rad is None else heading_rad
        rows = [0] if heading_rad is None or math.isinf(self.across_m2) else [0, 1]
        c, s = math.cos(way), math.sin(way)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        seen, cov = turn @ np.array([move.x, move.y, move.theta]), turn @ move.cov @ turn.T
        off = (seen - [self.length_m, 0.0, 0.0])[rows]
        spread = cov[np.ix_(rows, rows)] + np.diag([self.along_m2, self.across_m2][: len(rows)])
        gain = cov[:, rows] @ np.linalg.inv(spread)
        common = math.exp(-0.5 * float(off @ np.linalg.solve(spread, off)))
        common *= self.share / math.sqrt(float(np.linalg.det(2 * math.pi * spread)))
        if len(rows) == 1:  # any direction
            common /= 2 * math.pi * max(math.hypot(move.x, move.y), 1e-3 * self.reach_m)
        density = common + (1 - self.share) / (math.pi * self.reach_m**2)
        if common < _SURE * density:
            return Told(move, math.log(density))
        x, y, theta = (turn.T @ (seen - gain @ off)).tolist()
        tight = turn.T @ (cov - gain @ cov[rows]) @ turn
        a, b, d = ((tight + tight.T) / 2).tolist()
        return Told(Displacement(x, y, theta, (tuple(a), tuple(b), tuple(d))), math.log(density))


def estimate_travel_prior(experience: Experience) -> TravelPrior | None:
    """Return what the corridors of an experience have in common, None if that says too little.

    Nothing is said where places may go unnoticed: a travel may then be more than one corridor.

    Parameters
    ----------
    experience : whose displacements, and headings of the dlps left by, are looked at.
    """
    rows = _measure_travels(experience) if experience.slip == 0 else []
    if len(rows) < _LEAST_TRAVELS:
        return None
    length, along, aside, across = np.array(rows).T
    reach = float(length.max() + 3 * math.sqrt(along.max()))
    typical, share, part = _fit_common(length, along, reach)
    along_m2 = _bound_variance(length - typical, along, part)
    if share < _LEAST_SHARE or along_m2 > _MOST_SPREAD**2 * float(np.median(along)):
        return None
    across_m2 = math.inf
    if not np.isnan(aside).any():
        found = _bound_variance(aside, across, part)
        if found <= _MOST_SPREAD**2 * float(np.median(across)):
            across_m2 = found
    return TravelPrior(typical, along_m2, across_m2, share, reach)


def find_heading(reading: Reading) -> float | None:
    """Return the direction [rad] of the dlp left by in the frame of the visit, None if unknown."""
    if not reading.headings or reading.depart is None:
        return None
    return reading.headings[reading.depart]


def _measure_travels(experience: Experience) -> list[tuple[float, float, float, float]]:
    """Return how far each travel leads along its dlp and beside it, and the variances of both."""
    rows = []
    for before, visit in pairwise(experience.visits):
        move, way = visit.displacement, find_heading(before.readings[0])
        if move is None or not (move.x or move.y):
            continue
        known = way is not None
        way = math.atan2(move.y, move.x) if way is None else way
        c, s = math.cos(way), math.sin(way)
        (a, b, _), (_, d, _), _ = move.cov
        along, across = c * move.x + s * move.y, c * move.y - s * move.x
        both = 2 * c * s * b
        rows.append(
            (
                along,
                c * c * a + both + s * s * d,
                across if known else math.nan,
                s * s * a - both + c * c * d,
            )
        )
    return rows


def _fit_common(values: Array, noise: Array, reach: float) -> tuple[float, float, Array]:
    """Return mean and share of the common kind, and how likely each value (n,) is of it.

    Expectation maximisation, from the median on; values not of the common kind are spread evenly.
    """
    mean, share, part = float(np.median(values)), 0.9, np.ones(len(values))
    spread = 1.4826 * float(np.median(np.abs(values - mean)))
    extra = max(spread**2 - float(np.median(noise)), 0.0)
    for _ in range(_ROUNDS):
        total = extra + noise
        common = share * np.exp(-0.5 * (values - mean) ** 2 / total) / np.sqrt(2 * np.pi * total)
        part = common / (common + (1 - share) / reach)
        weight = part / total
        mean = float((weight * values).sum() / weight.sum())
        extra = max(float((part * ((values - mean) ** 2 - noise)).sum() / part.sum()), 0.0)
        share = min(float(part.mean()), 1 - 1 / (len(values) + 1))
    return mean, share, part


def _bound_variance(values: Array, noise: Array, part: Array) -> float:
    """Return the variance of values (n,) about 0 beyond their noise, rather too large.

    Where values in a row depart from 0 together (one wing of a building is of another measure),
    their sum varies more than that of independent ones: then so much for each.
    """
    values, noise = part * values, part**2 * noise
    weight = float((part**2).sum())
    extra = max(float((values**2 - noise).sum()) / weight, 0.0)
    bound = extra + _CAUTION * (extra + float(noise.sum()) / weight) * math.sqrt(2 / weight)
    for length in _STRETCHES:
        if len(values) >= 8 * length:
            sums, noises, weights = (
                np.convolve(one, np.ones(length), mode="valid") for one in (values, noise, part**2)
            )
            bound = max(bound, float((sums**2 - noises).sum()) / float(weights.sum()))
    return bound
