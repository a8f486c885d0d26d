"""A picture as a list of shapes in pixels, before it becomes SVG or PNG."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array

Colour = str
"""``#rrggbb``."""


@dataclass(frozen=True)
class Bitmap:
    """An image (H, W, 3) uint8 in RGB, stretched over a rectangle."""

    pixels: NDArray[np.uint8]
    x: float
    y: float
    width: float
    height: float
    group: str = ""


@dataclass(frozen=True)
class Line:
    """A polyline through (n, 2) points; ``dash`` is the length of dashes and gaps."""

    points: Array
    colour: Colour
    width: float
    opacity: float = 1.0
    dash: float | None = None
    group: str = ""


@dataclass(frozen=True)
class Shape:
    """A filled polygon (n, 2)."""

    points: Array
    fill: Colour
    opacity: float = 1.0
    group: str = ""


@dataclass(frozen=True)
class Disc:
    """A circle."""

    x: float
    y: float
    radius: float
    fill: Colour
    stroke: Colour = "#000000"
    stroke_width: float = 0.0
    title: str = ""
    group: str = ""


@dataclass(frozen=True)
class Text:
    """One line of text; (x, y) is the middle of its height, at its start, middle or end."""

    x: float
    y: float
    text: str
    size: float
    colour: Colour = "#1b1f24"
    anchor: Literal["start", "middle", "end"] = "start"
    bold: bool = False
    halo: Colour | None = None
    group: str = ""

    @property
    def width(self) -> float:
        """Estimated width, pixels."""
        return estimate_width(self.text, self.size, bold=self.bold)


Item = Bitmap | Line | Shape | Disc | Text


@dataclass
class Scene:
    """A canvas and what is on it, in the order of drawing.

    Attributes
    ----------
    width, height : pixels.
    title : for those who cannot see it.
    items : shapes; those of one ``group`` stay together.
    """

    width: float
    height: float
    title: str
    items: list[Item] = field(default_factory=list)

    def add(self, *items: Item) -> None:
        """Put shapes on top of what is there."""
        self.items.extend(items)


_NARROW, _WIDE = set("fijlrt.,:;'|!()[] I-"), set("mwMW@%")


def estimate_width(text: str, size: float, *, bold: bool = False) -> float:
    """Estimate the width of a text in a sans-serif type, pixels.

    Examples
    --------
    >>> estimate_width("iii", 10) < estimate_width("mmm", 10)
    True
    """
    units = sum(0.34 if c in _NARROW else 0.86 if c in _WIDE else 0.6 for c in text)
    return units * size * (1.07 if bold else 1.0)
