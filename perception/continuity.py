"""Path continuity: which gateways lie on one path, and the stars that follow.

Source: Beeson 2008, 5.2.2. The published test asks two rays to hit; the default asks for the
best mutual alignment by angle and lateral offset, with a margin over the second best, and says
how likely the other readings are. Two gateways on either side of a path that goes through are
most likely one path that crosses it: they may fit each other less well (ours).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from perception.errors import InputError
from perception.gateways import Gateway
from perception.star import Dlp, Star

Continuity = Literal["angle", "ray"]
MAX_BEND_RAD = math.radians(40.0)
SURE = 0.95
"""Gateways less confident than this may be absent in a runner-up reading."""
_SOFTNESS_RAD = math.radians(4.0)
_MARGIN = 0.15
_TILT = 0.12
"""How far aside of each other, a cell of distance, gateways of one path may seem to lie: their
directions are uncertain by some degrees."""
_LEAST_WEIGHT = 0.03
_ACROSS_BEND, _ACROSS_OFFSET = 1.25, 1.5
"""How much more bend, and lateral offset, a path may have that crosses another one."""
_MOST_READINGS = 4


@dataclass(frozen=True)
class StarReading:
    """One way to read the star of a place.

    Attributes
    ----------
    star : its dlps, clockwise as seen in the image.
    gateway_out : per dlp, the index of the gateway it leaves through; None where alpha is 0.
    headings_px : per dlp, its direction in pixel axes, radians, atan2(dy, dx).
    weight : probability of this reading; those of one place sum to 1.
    types : per dlp, its path type, or "" where it is not told; see :mod:`perception.path_types`.
    """

    star: Star
    gateway_out: tuple[int | None, ...]
    headings_px: tuple[float, ...]
    weight: float
    types: tuple[str, ...] = ()


def read_stars(
    gateways: Sequence[Gateway],
    centre_px: tuple[float, float],
    *,
    continuity: Continuity = "angle",
) -> tuple[StarReading, ...]:
    """Read the star from gateways, with runner-ups where a path continuity is in doubt.

    Parameters
    ----------
    gateways : those of one place, in circular order.
    centre_px : its middle; the circular order is taken about it.
    continuity : ``"angle"`` (default) or ``"ray"``, the test as published.

    Returns
    -------
    The readings, most probable first.

    Raises
    ------
    InputError : there is no such continuity.
    """
    if continuity not in ("angle", "ray"):
        raise InputError(f"there is no path continuity {continuity!r}; choose 'angle' or 'ray'")
    choices: list[tuple[float, list[int], Pairs]] = []
    for kept, sure in _doubt_gateways(gateways):
        chosen = [gateways[k] for k in kept]
        matchings = (
            [(_match_by_rays(chosen), 1.0)] if continuity == "ray" else _match_by_angle(chosen)
        )
        choices += [(weight * sure, kept, pairs) for pairs, weight in matchings]
    choices.sort(key=lambda choice: -choice[0])
    best = choices[0][0]
    choices = [c for c in choices[:_MOST_READINGS] if c[0] >= _LEAST_WEIGHT * best]
    total = sum(weight for weight, _, _ in choices)
    readings = []
    for weight, kept, pairs in choices:
        reading = _read([gateways[k] for k in kept], centre_px, pairs, weight / total)
        out = tuple(None if k is None else kept[k] for k in reading.gateway_out)
        readings.append(replace(reading, gateway_out=out))
    return tuple(readings)


def _doubt_gateways(gateways: Sequence[Gateway]) -> list[tuple[list[int], float]]:
    """Return which gateways there are, and how likely: all of them, or without doubtful ones.

    At most the two most doubtful are left out, and never all that there are.
    """
    every = range(len(gateways))
    doubtful = sorted(
        (k for k in every if gateways[k].confidence < SURE), key=lambda k: gateways[k].confidence
    )[:2]
    out: list[tuple[list[int], float]] = []
    for size in range(len(doubtful) + 1):
        for dropped in itertools.combinations(doubtful, size):
            kept = [k for k in every if k not in dropped]
            weight = 1.0
            for k in doubtful:
                sure = gateways[k].confidence
                weight *= 1.0 - sure if k in dropped else sure
            if kept or not gateways:
                out.append((kept, weight))
    return out


@dataclass(frozen=True)
class Alignment:
    """How sure it is that two gateways lie on one path, over all readings of a star.

    Attributes
    ----------
    gateways : indices of the two gateways, or of one that is the end of its path.
    confidence : total probability of the readings that say so.
    """

    gateways: tuple[int, ...]
    confidence: float


def rate_alignments(readings: Sequence[StarReading]) -> tuple[Alignment, ...]:
    """Return the alignments that any reading holds, surest first.

    Source
    ------
    Ours.
    """
    shares: dict[tuple[int, ...], float] = {}
    for reading in readings:
        for k, j in enumerate(reading.star.opposites):
            one, other = reading.gateway_out[k], reading.gateway_out[j]
            if one is None or (other is not None and j < k):
                continue
            pair = (one,) if other is None else (min(one, other), max(one, other))
            shares[pair] = shares.get(pair, 0.0) + reading.weight
    found = sorted(shares.items(), key=lambda item: (-item[1], item[0]))
    return tuple(Alignment(pair, min(share, 1.0)) for pair, share in found)


def read_star(
    gateways: Sequence[Gateway],
    centre_px: tuple[float, float],
    paths: Sequence[tuple[int, int]],
    *,
    weight: float = 1.0,
) -> StarReading:
    """Return the star in which given pairs of gateways are one path each.

    Parameters
    ----------
    gateways, centre_px : as for :func:`read_stars`.
    paths : indices of two gateways each; a gateway in none of them is the end of its path.
    weight : what the reading shall carry.
    """
    return _read(gateways, centre_px, tuple(paths), weight)


def tell_ends(readings: Sequence[StarReading], end_types: Sequence[str]) -> tuple[StarReading, ...]:
    """Return the readings with the types of the dlps that cannot be travelled filled in.

    Parameters
    ----------
    end_types : per gateway, the type of the dlp opposite to the one that leaves through it.
    """
    told = []
    for reading in readings:
        types = list(reading.types)
        for k, j in enumerate(reading.star.opposites):
            gateway = reading.gateway_out[j]
            if reading.gateway_out[k] is None and gateway is not None:
                types[k] = end_types[gateway]
        told.append(replace(reading, types=tuple(types)))
    return tuple(told)


def _bend(g: Gateway, h: Gateway) -> float:
    """Return the angle between passing in through g and out through h, radians, >= 0."""
    turn = h.outward_rad - g.outward_rad - math.pi
    return abs((turn + math.pi) % (2 * math.pi) - math.pi)


def _offset(g: Gateway, h: Gateway) -> float:
    """Return the lateral offset of h from g across their mean direction, in pixels."""
    dx = math.cos(h.outward_rad) - math.cos(g.outward_rad)
    dy = math.sin(h.outward_rad) - math.sin(g.outward_rad)
    length = math.hypot(dx, dy)
    if length < 1e-9:
        return math.inf
    ex, ey = h.centre_px[0] - g.centre_px[0], h.centre_px[1] - g.centre_px[1]
    return abs(ex * dy - ey * dx) / length


def _misfit(g: Gateway, h: Gateway, bend: float = 1.0, offset: float = 1.0) -> float:
    """Return how badly two gateways continue each other: 0 perfect, 1 at the limit of the bend.

    So many times as much bend and lateral offset as on a lone path are as good.
    """
    apart = math.dist(g.centre_px, h.centre_px)
    reach = offset * max(g.width_px, h.width_px) / 2 + _TILT * apart
    aside = _offset(g, h) / reach if reach > 0 else math.inf
    if aside > 1.5:
        return math.inf
    return _bend(g, h) / (bend * MAX_BEND_RAD) + 0.5 * max(aside - 0.5, 0.0)


Pairs = tuple[tuple[int, int], ...]


def _match_by_angle(gateways: Sequence[Gateway]) -> list[tuple[Pairs, float]]:
    """Return matchings of gateways to paths and their probabilities."""
    size = len(gateways)
    misfit = {
        (i, j): _misfit(gateways[i], gateways[j]) for i, j in itertools.combinations(range(size), 2)
    }
    candidates = []
    for (i, j), value in misfit.items():
        rival = min(
            (
                misfit[min(a, b), max(a, b)]
                for a, b in [*((i, k) for k in range(size)), *((j, k) for k in range(size))]
                if a != b and {a, b} != {i, j}
            ),
            default=math.inf,
        )
        sure = _share(value, rival)
        loose = _misfit(gateways[i], gateways[j], _ACROSS_BEND, _ACROSS_OFFSET)
        if (across := max(_share(loose, rival), sure)) >= _LEAST_WEIGHT:
            candidates.append(((i, j), sure, across))
    matchings: list[tuple[Pairs, float]] = [((), 1.0)]
    for pair, alone, across in sorted(candidates, key=lambda item: -item[1]):
        grown: list[tuple[Pairs, float]] = []
        for pairs, weight in matchings:
            sure = across if any(_is_between(pair, other) for other in pairs) else alone
            if any(set(pair) & set(other) for other in pairs) or sure < _LEAST_WEIGHT:
                grown.append((pairs, weight * (1.0 - sure)))
                continue
            grown.append(((*pairs, pair), weight * sure))
            if sure < 1.0 - _LEAST_WEIGHT:
                grown.append((pairs, weight * (1.0 - sure)))
        matchings = sorted(grown, key=lambda item: -item[1])[:32]
    return matchings


def _is_between(pair: tuple[int, int], other: tuple[int, int]) -> bool:
    """Tell whether the two of a pair lie on either side of another, in circular order."""
    (a, b), (c, d) = sorted(pair), sorted(other)
    return a < c < b < d or c < a < d < b


def _share(value: float, rival: float) -> float:
    """Return the probability that a pair is one path: within the bend, and ahead of its rivals."""
    if not math.isfinite(value):
        return 0.0
    bend = 1.0 / (1.0 + math.exp((value - 1.0) * MAX_BEND_RAD / _SOFTNESS_RAD))
    if not math.isfinite(rival):
        return bend
    lead = (rival - value - _MARGIN) / (_MARGIN / 2)
    return bend / (1.0 + math.exp(min(max(-lead, -60.0), 60.0)))


def _match_by_rays(gateways: Sequence[Gateway]) -> Pairs:
    """Return the pairs whose inward normals hit each other's segment, as published."""
    hits = [
        (i, j)
        for i, j in itertools.combinations(range(len(gateways)), 2)
        if _hits(gateways[i], gateways[j]) and _hits(gateways[j], gateways[i])
    ]
    hits.sort(key=lambda pair: _bend(gateways[pair[0]], gateways[pair[1]]))
    pairs: list[tuple[int, int]] = []
    for pair in hits:
        if not any(set(pair) & set(other) for other in pairs):
            pairs.append(pair)
    return tuple(pairs)


def _hits(g: Gateway, h: Gateway) -> bool:
    """Tell whether the inward normal from the middle of g meets the segment of h."""
    dx, dy = -math.cos(g.outward_rad), -math.sin(g.outward_rad)
    sides = []
    for x, y in h.ends_px:
        sides.append(dx * (y - g.centre_px[1]) - dy * (x - g.centre_px[0]))
    ahead = dx * (h.centre_px[0] - g.centre_px[0]) + dy * (h.centre_px[1] - g.centre_px[1])
    return sides[0] * sides[1] <= 0 and ahead > 0


class _Entry(NamedTuple):
    """A dlp in the making."""

    position: float
    heading: float
    gateway: int | None
    path: int
    type: str


def _read(
    gateways: Sequence[Gateway], centre_px: tuple[float, float], pairs: Pairs, weight: float
) -> StarReading:
    """Build the star in which the given pairs of gateways are one path each."""
    mate = {i: j for pair in pairs for i, j in (pair, pair[::-1])}
    reach = max(
        (math.dist(g.centre_px, centre_px) for g in gateways),
        default=1.0,
    )
    entries: list[_Entry] = []
    for k, gateway in enumerate(gateways):
        path = min(k, mate.get(k, k))
        position = math.atan2(
            gateway.centre_px[1] - centre_px[1], gateway.centre_px[0] - centre_px[0]
        )
        if math.dist(gateway.centre_px, centre_px) < 1e-6:
            position = gateway.outward_rad
        entries.append(_Entry(position, gateway.outward_rad, k, path, gateway.path_type))
        if k not in mate:
            back = gateway.outward_rad + math.pi
            position = _leave_circle(gateway, centre_px, reach, back)
            entries.append(_Entry(position, back, None, path, gateway.opposite_type))
    entries.sort(key=lambda entry: entry.position % (2 * math.pi))
    return _name(entries, weight)


def _leave_circle(
    gateway: Gateway, centre_px: tuple[float, float], reach: float, heading: float
) -> float:
    """Return at which angle about the centre a ray from the gateway leaves the circle."""
    x, y = gateway.centre_px[0] - centre_px[0], gateway.centre_px[1] - centre_px[1]
    dx, dy = math.cos(heading), math.sin(heading)
    along = x * dx + y * dy
    root = math.sqrt(max(along**2 - (x * x + y * y) + (reach * 1.001 + 1e-6) ** 2, 0.0))
    way = -along + root
    return math.atan2(y + way * dy, x + way * dx)


def _name(entries: list[_Entry], weight: float) -> StarReading:
    """Name the local-paths in clockwise order from a canonical start."""
    size = len(entries)
    if not size:
        return StarReading(Star(()), (), (), weight)
    shape = []
    for k, entry in enumerate(entries):
        opposite = next(i for i, e in enumerate(entries) if i != k and e.path == entry.path)
        shape.append((-int(entry.gateway is not None), (opposite - k) % size))

    def key(start: int) -> tuple[list[tuple[int, int]], float]:
        turned = shape[start:] + shape[:start]
        up = (entries[start].heading + math.pi / 2 + 1e-6) % (2 * math.pi)
        return turned, round(up, 3)

    start = min(range(size), key=key)
    turned = entries[start:] + entries[:start]
    names: dict[int, str] = {}
    for entry in turned:
        names.setdefault(entry.path, _letters(len(names)))
    dlps, plus = [], set()
    both = {
        path for path in names if sum(e.path == path and e.gateway is not None for e in turned) == 2
    }
    for entry in turned:
        alpha = int(entry.gateway is not None)
        first = (entry.path not in plus) if entry.path in both else bool(alpha)
        if first:
            plus.add(entry.path)
        dlps.append(Dlp(names[entry.path], "+" if first else "-", alpha))
    return StarReading(
        Star(tuple(dlps)),
        tuple(entry.gateway for entry in turned),
        tuple(math.remainder(entry.heading, 2 * math.pi) for entry in turned),
        weight,
        tuple(entry.type for entry in turned),
    )


def _letters(k: int) -> str:
    """Return a, b, ..., z, aa, ab, ..."""
    text = ""
    k += 1
    while k:
        k, rest = divmod(k - 1, 26)
        text = chr(ord("a") + rest) + text
    return text
