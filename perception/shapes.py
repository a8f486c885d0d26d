"""Names of common intersections."""

from __future__ import annotations

from perception.star import Star

SHAPES: dict[str, Star] = {
    "path": Star.parse(["a+1", "a-1"]),
    "dead end": Star.parse(["a+1", "a-0"]),
    "L": Star.parse(["a+1", "b+1", "a-0", "b-0"]),
    "T": Star.parse(["a-0", "b+1", "a+1", "b-1"]),
    "+": Star.parse(["a+1", "b+1", "a-1", "b-1"]),
    "Y": Star.parse(["a-0", "b+1", "c-0", "a+1", "b-0", "c+1"]),
    "K": Star.parse(["a+1", "b+1", "c+1", "a-1", "b-0", "c-0"]),
    "psi": Star.parse(["a+1", "b+1", "c-0", "a-1", "b-0", "c+1"]),
}
"""The intersections that have a name, as stars."""


def name_shape(star: Star) -> str | None:
    """Return the name of a star, whatever its dlps are called and wherever it starts.

    Source
    ------
    Beeson 2008, 5.1: the published stars of +, T, L, Y, K and psi.

    Examples
    --------
    >>> name_shape(Star.parse(["x+1", "y+1", "x-1", "y-0"]))
    'T'
    >>> name_shape(Star.parse(["x+1", "y+1", "z+1", "x-1", "y-1", "z-1"])) is None
    True
    """
    return next((name for name, shape in SHAPES.items() if shape.isomorphisms(star)), None)
