"""Labels that do not lie on top of each other: greedy choice among positions around a point."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
    inked : (n, 2) points of lines that a label had better not hide.
    """

    bounds: Box
    inked: Array = field(default_factory=lambda: np.empty((0, 2)))

    _taken: Array = field(default_factory=lambda: np.empty((64, 4)))
    _count: int = 0

    @property
    def taken(self) -> Array:
        """(n, 4) boxes of labels and marks placed so far."""
        return self._taken[: self._count]

    def take(self, box: Box) -> None:
        """Mark a box as taken."""
        if self._count == len(self._taken):
            self._taken = np.concatenate([self._taken, np.empty_like(self._taken)])
        self._taken[self._count] = box
        self._count += 1

    def place(
        self, x: float, y: float, text: str, size: float, gap: float, **style: object
    ) -> Text:
        """Return the label beside a point, where it hides least; its box is then taken."""
        options = [
            (
                distance,
                Text(
                    x + dx * distance,
                    y + dy * (distance + 0.3 * size),
                    text,
                    size,
                    anchor=anchor,  # type: ignore[arg-type]
                    **style,  # type: ignore[arg-type]
                ),
            )
            for distance in (gap, gap * 1.7, gap * 2.6)
            for dx, dy, anchor in _SIDES
        ]
        boxes = [find_box(label) for _, label in options]
        farther = np.array([distance / gap - 1 for distance, _ in options])
        chosen = int(np.argmin(self.price(boxes) + 4.0 * farther))
        self.take(boxes[chosen])
        return options[chosen][1]

    def choose(
        self, spots: Iterable[tuple[float, float]], width: float, height: float, *, must: bool
    ) -> int | None:
        """Return the index of the spot where a centred mark hides least; its box is then taken.

        None, if it need not be drawn and there is no spot where it hides nothing.
        """
        boxes = [(x - width / 2, y - height / 2, x + width / 2, y + height / 2) for x, y in spots]
        prices = self.price(boxes, ink=0.0)
        chosen = int(np.argmin(prices))
        if not must and prices[chosen] > 0:
            return None
        self.take(boxes[chosen])
        return chosen

    def price(self, boxes: Sequence[Box], *, ink: float = 0.8) -> Array:
        """Return (n,) how much each of n boxes hides or sticks out."""
        corners = np.array(boxes, float)
        left, top, right, bottom = corners.T[:, :, None]
        other = self.taken.T
        width = np.minimum(right, other[2]) - np.maximum(left, other[0])
        height = np.minimum(bottom, other[3]) - np.maximum(top, other[1])
        area = np.where((width > 0) & (height > 0), width * height, 0.0)
        price = 30.0 * (area > 0).sum(axis=1) + 0.5 * area.sum(axis=1)
        low, high = np.array(self.bounds[:2]), np.array(self.bounds[2:])
        out = np.maximum(low - corners[:, :2], 0) + np.maximum(corners[:, 2:] - high, 0)
        if len(self.inked) and ink:
            x, y = self._list_ink(corners).T
            hidden = (x > left - 2) & (x < right + 2) & (y > top - 2) & (y < bottom + 2)
            price = price + ink * hidden.sum(axis=1)
        return np.asarray(price + 20.0 * out.sum(axis=1))

    def _list_ink(self, corners: Array) -> Array:
        """Return the inked points that boxes could hide."""
        low, high = corners[:, :2].min(axis=0) - 2, corners[:, 2:].max(axis=0) + 2
        near = (self.inked > low) & (self.inked < high)
        return np.asarray(self.inked[near[:, 0] & near[:, 1]])


def find_box(label: Text) -> Box:
    """Return the box of a text, pixels."""
    width = estimate_width(label.text, label.size, bold=label.bold)
    left = label.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[label.anchor] * width
    return left, label.y - 0.58 * label.size, left + width, label.y + 0.58 * label.size
