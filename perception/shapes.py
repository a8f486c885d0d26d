"""Names of common intersections."""

from __future__ import annotations

import math
from collections.abc import Sequence

from perception.star import Star

SHAPES: dict[str, Star] = {
    "straight": Star.parse(["a+1", "a-1"]),
    "dead end": Star.parse(["a+1", "a-0"]),
    "L": Star.parse(["a+1", "b+1", "a-0", "b-0"]),
    "T": Star.parse(["a-0", "b+1", "a+1", "b-1"]),
    "+": Star.parse(["a+1", "b+1", "a-1", "b-1"]),
    "Y": Star.parse(["a-0", "b+1", "c-0", "a+1", "b-0", "c+1"]),
    "K": Star.parse(["a+1", "b+1", "c+1", "a-1", "b-0", "c-0"]),
    "psi": Star.parse(["a+1", "b+1", "c-0", "a-1", "b-0", "c+1"]),
}
"""The intersections that have a name, as stars."""

MOST_SQUARE_RAD = math.radians(15.0)
"""Two paths that cross this much off a right angle, or more, are an X, not a +."""

_ARMED = {5: "five-armed", 6: "six-armed"}


def name_shape(
    star: Star, headings_rad: Sequence[float] = (), *, is_narrow: bool = False
) -> str | None:
    """Return the name of a star, whatever its dlps are called and wherever it starts.

    Parameters
    ----------
    headings_rad : direction of each dlp, if known; an X differs from a + in nothing else.
    is_narrow : whether the robot stands in a narrowing; a straight path is then a door.

    Source
    ------
    Beeson 2008, 5.1: the published stars of +, T, L, Y, K and psi; X, door and the names by number
    of arms are ours.

    Examples
    --------
    >>> name_shape(Star.parse(["x+1", "y+1", "x-1", "y-0"]))
    'T'
    >>> name_shape(Star.parse(["a+1", "b+1", "a-1", "b-1"]), (0.0, 0.9, 3.14, 4.04))
    'X'
    >>> name_shape(Star.parse(["x+1", "y+1", "z+1", "x-1", "y-1", "z-1"]))
    'six-armed'
    """
    name = next((name for name, shape in SHAPES.items() if shape.isomorphisms(star)), None)
    if name == "+" and len(headings_rad) == 4:
        crossing = abs(math.remainder(_axis(headings_rad, 0) - _axis(headings_rad, 1), math.pi))
        return "X" if crossing <= math.pi / 2 - MOST_SQUARE_RAD else "+"
    if name == "straight" and is_narrow:
        return "door"
    return name or _ARMED.get(sum(star.alpha))


def _axis(headings_rad: Sequence[float], k: int) -> float:
    """Return the direction of a path from that of its two opposite dlps, k and k + 2."""
    there, back = headings_rad[k], headings_rad[k + 2] + math.pi
    return there + 0.5 * math.remainder(back - there, 2 * math.pi)
