"""The Experience: what the robot went through, at the seam of small-scale and large-scale space.

Below this seam everything is arrays; above it everything is symbols with metrical annotations.
The file format ``hssh.trace/1`` is the contract for symbolic users.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from perception.star import Star

PATH_TYPES = {"MIDLINE": 1, "LEFTWALL": 1, "RIGHTWALL": 1, "DEADEND": 0, "NONE": 0}
"""The path types that alpha may tell, and what each says about travel (Beeson 2008, 5.1)."""


@dataclass(frozen=True)
class Displacement:
    """Lambda: the place frame of a visit in the place frame of the visit before it.

    Attributes
    ----------
    x, y : metres. theta : radians, counter-clockwise.
    cov : (3, 3) covariance of (x, y, theta), as nested tuples; symmetric positive definite.

    Source
    ------
    Beeson 2008, section 9.1.
    """

    x: float
    y: float
    theta: float
    cov: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Reading:
    """One reading of the local map at a visit: a star, and where the robot came in and went out.

    Attributes
    ----------
    star : the small-scale star.
    arrive : index of the dlp the robot faced on arrival (it came in through the gateway of its
        opposite); None at the first visit.
    depart : index of the dlp the robot left along; None at the last visit.
    weight : probability of this reading.
    headings : direction of each dlp in the frame of the visit, radians; empty if unknown.
    types : path type of each dlp, one of :data:`PATH_TYPES` or "" if not known; empty if none is.
    """

    star: Star
    arrive: int | None
    depart: int | None
    weight: float = 1.0
    headings: tuple[float, ...] = ()
    types: tuple[str, ...] = ()

    def isomorphisms(self, other: Reading) -> tuple[int, ...]:
        """Return the isomorphisms of the stars under which no path types contradict each other.

        Source
        ------
        Beeson 2008, section 5.1, with its footnote on the range of alpha.
        """
        turns = self.star.isomorphisms(other.star)
        if not (self.types and other.types):
            return turns
        size = len(self.types)
        return tuple(
            r
            for r in turns
            if all(
                "" in (mine, theirs) or mine == theirs
                for mine, theirs in (
                    (self.types[k], other.types[(k + r) % size]) for k in range(size)
                )
            )
        )


@dataclass(frozen=True)
class Visit:
    """One visit to a place.

    Attributes
    ----------
    readings : the readings of the star; the first is the best one, the weights sum to 1.
    displacement : lambda from the previous visit; None if unknown.
    name : what the user calls the place, if anything.
    pose : pose (x, y, theta) of the visit in the frame of the drive, metres and radians; an
        annotation for pictures, never evidence.
    time_s : time of the visit in the log, seconds.
    lpm_matches : earlier visits whose local maps were compared with that of this one, and what
        that says for one place, nats (log-likelihood ratio).
    """

    readings: tuple[Reading, ...]
    displacement: Displacement | None = None
    name: str | None = None
    pose: tuple[float, float, float] | None = None
    time_s: float | None = None
    lpm_matches: tuple[tuple[int, float], ...] = ()

    @property
    def star(self) -> Star:
        """The best star."""
        return self.readings[0].star

    @property
    def arrive(self) -> int | None:
        """Where the robot came in, in the best star."""
        return self.readings[0].arrive

    @property
    def depart(self) -> int | None:
        """Where the robot went out, in the best star."""
        return self.readings[0].depart


@dataclass(frozen=True)
class Experience:
    """Visits 0..n, the travels between them understood.

    Attributes
    ----------
    visits : in order of time.
    source : where it came from (a file name), for messages.
    slip : probability that a place goes unnoticed during one travel; 0 for symbolic traces,
        whose word is taken.
    notices : remarks of the reader that the user should see.
    """

    visits: tuple[Visit, ...]
    source: str = ""
    slip: float = 0.0
    notices: tuple[str, ...] = field(default=(), compare=False)

    def __len__(self) -> int:
        return len(self.visits)

    @property
    def has_displacements(self) -> bool:
        """True if at least one travel has a displacement."""
        return any(visit.displacement is not None for visit in self.visits)

    def visit_label(self, v: int) -> str:
        """Return the user's name of a visit with its number, such as ``v3 (lift lobby)``."""
        name = self.visits[v].name
        return f"v{v} ({name})" if name else f"v{v}"


def has_types(experience: Experience) -> bool:
    """Return whether the type of some dlp is told."""
    return any(reading.types for visit in experience.visits for reading in visit.readings)


def has_partial_types(experience: Experience) -> bool:
    """Return whether some types are told and some are not: agreement is then not transitive."""
    readings = [reading for visit in experience.visits for reading in visit.readings]
    return has_types(experience) and any(not r.types or "" in r.types for r in readings)


def forget_types(experience: Experience) -> Experience:
    """Return the experience without path types: axiom 18 then has nothing to say."""
    visits = tuple(
        replace(visit, readings=tuple(replace(r, types=()) for r in visit.readings))
        for visit in experience.visits
    )
    return replace(experience, visits=visits)


def hold_types(experience: Experience) -> Experience:
    """Return the experience with the path types that axiom 18 is held to.

    Where displacements were measured, types were perceived too, and perception errs: one wrong
    type would refute a true closure that everything measured speaks for. So they are left aside
    there, as they are in the search for the most probable maps; else all are held.
    """
    if experience.has_displacements and has_types(experience):
        return forget_types(experience)
    return experience


def read_matches(value: object, v: int) -> tuple[tuple[int, float], ...] | None:
    """Return ``lpm_matches`` of visit v as read from JSON; None if they are no such thing.

    Examples
    --------
    >>> read_matches([[0, 2.5]], 3), read_matches([[3, 2.5]], 3)
    (((0, 2.5),), None)
    """
    if not isinstance(value, list):
        return None
    out = []
    for pair in value:
        if not (isinstance(pair, list) and len(pair) == 2):
            return None
        visit, nats = pair
        if type(visit) is not int or type(nats) not in (int, float):
            return None
        if not (0 <= visit < v and math.isfinite(nats)):
            return None
        out.append((visit, float(nats)))
    return tuple(out)


def default_covariance(x: float, y: float) -> list[list[float]]:
    """Return the covariance assumed where a trace gives none: 10 % of the length, 0.05 rad."""
    var = max(0.1 * math.hypot(x, y), 0.05) ** 2
    return [[var, 0.0, 0.0], [0.0, var, 0.0], [0.0, 0.0, 0.05**2]]


def checked_covariance(
    cov: Any,  # noqa: ANN401
) -> tuple[tuple[float, float, float], ...]:
    """Return ``cov`` as nested tuples.

    Raises
    ------
    ValueError : not a symmetric positive definite 3 x 3 matrix of finite numbers.
    """
    try:
        array = np.array(cov, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (3, 3):
        raise ValueError("'cov' must be a 3 x 3 matrix of numbers over x, y, theta")
    if not np.isfinite(array).all():
        raise ValueError("'cov' has an entry that is not finite (NaN or infinity)")
    if not np.allclose(array, array.T, rtol=1e-6, atol=1e-12):
        raise ValueError("'cov' is not symmetric")
    if np.linalg.eigvalsh(array)[0] <= 0:
        raise ValueError("'cov' is not positive definite; every variance must be above 0")
    return tuple((float(row[0]), float(row[1]), float(row[2])) for row in array)
