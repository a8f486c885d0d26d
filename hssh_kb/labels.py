"""Labels that do not lie on top of each other: greedy choice among positions around a point."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from hssh_kb.scene import Text, estimate_width
from perception.geometry import Array

Box = tuple[float, float, float, float]
"""Left, top, right, bottom."""

_SIDES = (
    (1.0, 0.0, "start"),
    (-1.0, 0.0, "end"),
    (0.0, -1.0, "middle"),
    (0.0, 1.0, "middle"),
    (0.8, -0.8, "start"),
    (0.8, 0.8, "start"),
    (-0.8, -0.8, "end"),
    (-0.8, 0.8, "end"),
)


@dataclass
class LabelPlacer:
    """Remembers what is taken, and finds free spots.

    Attributes
    ----------
    bounds : where labels may lie.
    taken : boxes of labels and marks placed so far.
    inked : (n, 2) points of lines that a label had better not hide.
    """

    bounds: Box
    taken: list[Box] = field(default_factory=list)
    inked: Array = field(default_factory=lambda: np.empty((0, 2)))

    def take(self, box: Box) -> None:
        """Mark a box as taken."""
        self.taken.append(box)

    def place(
        self, x: float, y: float, text: str, size: float, gap: float, **style: object
    ) -> Text:
        """Return the label beside a point, where it hides least; its box is then taken."""
        options = list[tuple[float, Text, Box]]()
        for distance in (gap, gap * 1.7, gap * 2.6):
            for dx, dy, anchor in _SIDES:
                label = Text(
                    x + dx * distance,
                    y + dy * (distance + 0.3 * size),
                    text,
                    size,
                    anchor=anchor,  # type: ignore[arg-type]
                    **style,  # type: ignore[arg-type]
                )
                box = find_box(label)
                cost = self.price(box) + 4.0 * (distance / gap - 1)
                options.append((cost, label, box))
        _, label, box = min(options, key=lambda option: option[0])
        self.take(box)
        return label

    def choose(self, spots: Iterable[tuple[float, float]], width: float, height: float) -> int:
        """Return the index of the spot where a centred mark hides least; its box is then taken."""
        boxes = [(x - width / 2, y - height / 2, x + width / 2, y + height / 2) for x, y in spots]
        prices = [self.price(box, ink=0.0) for box in boxes]
        chosen = int(np.argmin(prices))
        self.take(boxes[chosen])
        return chosen

    def price(self, box: Box, *, ink: float = 0.8) -> float:
        """Return how much a box hides or sticks out."""
        left, top, right, bottom = box
        price = sum(30 + 0.5 * _overlap(box, other) for other in self.taken if _overlap(box, other))
        b = self.bounds
        out = (
            max(b[0] - left, 0) + max(b[1] - top, 0) + max(right - b[2], 0) + max(bottom - b[3], 0)
        )
        if len(self.inked) and ink:
            x, y = self.inked.T
            hidden = (x > left - 2) & (x < right + 2) & (y > top - 2) & (y < bottom + 2)
            price += ink * float(hidden.sum())
        return price + 20.0 * out


def find_box(label: Text) -> Box:
    """Return the box of a text, pixels."""
    width = estimate_width(label.text, label.size, bold=label.bold)
    left = label.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[label.anchor] * width
    return left, label.y - 0.58 * label.size, left + width, label.y + 0.58 * label.size


def _overlap(a: Box, b: Box) -> float:
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return width * height if width > 0 and height > 0 else 0.0
