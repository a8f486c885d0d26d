"""What a place looked like on another visit, as one more reading of this one.

One passage sees a crossing incompletely: a half-circle lidar misses what lies behind, a shadow
looks like an opening. Two visits close to each other in the drive may have been at one place; so
the star that one of them saw is offered to the other as a reading, at the price of the gateways
that were then missed or imagined. Whether it *was* one place is for axioms and layout to say.

Source: ours; it stands for the exploration of a suspected place that Beeson 2008, section 5.3.2,
asks of a robot, where the drive is over and cannot be changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.geometry import Array, measure_along, wrap_angle
from perception.places import PlaceReading, PlaceVisit
from perception.voting import are_lined_up, list_ways


@dataclass(frozen=True)
class ExpectationSettings:
    """How readings are carried over between visits.

    Attributes
    ----------
    near_m, drift : two visits are compared if their centres lie closer than ``near_m`` plus
        ``drift`` times the way driven between them.
    max_turn_rad : by how much heading drift may have turned one against the other.
    same_rad : gateways whose directions differ by less are one.
    missed, imagined : probability that a gateway is not seen, or seen where there is none.
    least : readings with a smaller share of the best one's weight are not added.
    most : how many are added to one visit.
    """

    near_m: float = 4.0
    drift: float = 0.03
    max_turn_rad: float = 0.35
    same_rad: float = 0.6
    missed: float = 0.10
    imagined: float = 0.07
    least: float = 0.002
    most: int = 4


def expect_readings(
    visits: Sequence[PlaceVisit], poses: Array, settings: ExpectationSettings | None = None
) -> tuple[PlaceVisit, ...]:
    """Return the visits, each with the readings that other visits nearby suggest.

    Parameters
    ----------
    visits : in order of time. poses : (n, 3) of the laser, drive frame.
    """
    settings = settings or ExpectationSettings()
    driven = measure_along(poses[:, :2])
    return tuple(_with_expected(v, visits, driven, settings) for v in range(len(visits)))


def _with_expected(
    v: int, visits: Sequence[PlaceVisit], driven: Array, settings: ExpectationSettings
) -> PlaceVisit:
    visit = visits[v]
    found = list[PlaceReading]()
    for u, other in enumerate(visits):
        way = abs(float(driven[visit.scan] - driven[other.scan]))
        apart = float(np.hypot(*(other.centre_m - visit.centre_m)))
        if u == v or apart > settings.near_m + settings.drift * way:
            continue
        reading = _carry_over(other.readings[0], visit, settings)
        if reading is not None and not _is_known(reading, [*visit.readings, *found], settings):
            found.append(reading)
    best = visit.readings[0].weight
    found = [r for r in found if r.weight >= settings.least * best]
    found = sorted(found, key=lambda r: -r.weight)[: settings.most]
    total = sum(r.weight for r in visit.readings) + sum(r.weight for r in found)
    readings = [replace(r, weight=r.weight / total) for r in [*visit.readings, *found]]
    readings.sort(key=lambda r: -r.weight)
    return replace(visit, readings=tuple(readings))


def _carry_over(
    seen: PlaceReading, visit: PlaceVisit, settings: ExpectationSettings
) -> PlaceReading | None:
    """Return the star that was seen elsewhere as a reading of this visit, None if it cannot be."""
    own = visit.readings[0]
    turn = _best_turn(
        list_ways(seen.star, seen.headings_rad), list_ways(own.star, own.headings_rad), settings
    )
    headings = np.asarray(seen.headings_rad) + turn
    came = None if own.arrive is None else own.headings_rad[own.star.opposite(own.arrive)]
    went = None if own.depart is None else own.headings_rad[own.depart]
    alpha = np.array(seen.star.alpha, bool)
    arrive = depart = None
    if came is not None:
        entry = _nearest(headings, alpha, came, settings)
        if entry is None:
            return None
        arrive = seen.star.opposite(entry)
    if went is not None:
        depart = _nearest(headings, alpha, went, settings)
        if depart is None:
            return None
    weight = own.weight * _likelihood(headings[alpha], visit, settings)
    return PlaceReading(
        seen.star,
        arrive,
        depart,
        tuple(float(wrap_angle(h)) for h in headings),
        seen.gateways_m,
        weight,
        seen.types,
    )


def _best_turn(seen: Array, own: Array, settings: ExpectationSettings) -> float:
    """Return the small turn that lines up most gateways of the one star with the other's."""
    best, best_cost = 0.0, np.inf
    for turn in np.linspace(-settings.max_turn_rad, settings.max_turn_rad, 15):
        off = np.abs(wrap_angle(seen[:, None] + turn - own[None, :]))
        cost = float(np.minimum(off.min(axis=1), settings.same_rad).sum()) + 0.1 * abs(turn)
        if cost < best_cost:
            best, best_cost = float(turn), cost
    return best


def _nearest(
    headings: Array, alpha: Array, direction: float, settings: ExpectationSettings
) -> int | None:
    off = np.where(alpha, np.abs(wrap_angle(headings - direction)), np.inf)
    k = int(np.argmin(off))
    return k if off[k] < settings.same_rad else None


def _likelihood(headings: Array, visit: PlaceVisit, settings: ExpectationSettings) -> float:
    """Return how well gateways in these directions explain what was read at the visit."""
    total = 0.0
    for reading in visit.readings:
        own = list_ways(reading.star, reading.headings_rad)
        off = np.abs(wrap_angle(headings[:, None] - own[None, :])) < settings.same_rad
        missed = int((~off.any(axis=1)).sum())
        imagined = int((~off.any(axis=0)).sum())
        total += reading.weight * settings.missed**missed * settings.imagined**imagined
    return total


def _is_known(
    reading: PlaceReading, known: Sequence[PlaceReading], settings: ExpectationSettings
) -> bool:
    """Tell whether an equal reading is there already: same star, same directions, same way."""
    return any(
        are_lined_up(
            reading.star, reading.headings_rad, other.star, other.headings_rad, settings.same_rad
        )
        for other in known
    )
