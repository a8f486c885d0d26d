"""Synthetic intersections: shapes turned, scaled and with flipped cells, and their true stars.

The + corpus is made as described by Beeson 2008, 6.3.3: a high-resolution image turned by 0 to 45
degrees, scaled to 9..599 cells a side, cut at grey level 127, then free cells flipped to occupied.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from perception.star import Star

FINE = 1797
"""Side of the high-resolution image: three cells for each of the largest image."""


@dataclass(frozen=True)
class Shape:
    """An intersection: directions of its arms in degrees, clockwise in the image from right."""

    name: str
    arms_deg: tuple[float, ...]
    star: tuple[str, ...]
    width: float = 1 / 3

    @property
    def truth(self) -> Star:
        return Star.parse(self.star)


PLUS = Shape("+", (0, 90, 180, 270), ("a+1", "b+1", "a-1", "b-1"))
SHAPES = (
    Shape("T", (0, 90, 180), ("a+1", "b+1", "a-1", "b-0")),
    Shape("L", (0, 90), ("a+1", "b+1", "a-0", "b-0")),
    Shape("Y", (0, 120, 240), ("a+1", "b-0", "c+1", "a-0", "b+1", "c-0"), 1 / 4),
    Shape("K", (270, 315, 45, 90), ("a+1", "b+1", "c+1", "a-1", "b-0", "c-0"), 1 / 4),
    Shape("psi", (225, 270, 315, 90), ("a+1", "b+1", "c+1", "a-0", "b-1", "c-0"), 1 / 4),
    Shape("X", (0, 70, 180, 250), ("a+1", "b+1", "a-1", "b-1"), 1 / 4),
    Shape("X bent 20", (0, 90, 200, 270), ("a+1", "b+1", "a-1", "b-1"), 1 / 4),
    Shape(
        "five-armed",
        (0, 72, 144, 216, 288),
        ("a+1", "d-0", "b+1", "e-0", "c+1", "a-0", "d+1", "b-0", "e+1", "c-0"),
        1 / 4,
    ),
    Shape("dead end", (180,), ("a+1", "a-0")),
    Shape("straight", (0, 180), ("a+1", "a-1")),
)


def draw_fine(shape: Shape, turn_deg: float, side: int = FINE) -> np.ndarray:
    """Draw a shape at high resolution, 255 free, turned clockwise by turn_deg."""
    axis = (np.arange(side, dtype=np.float32) - (side - 1) / 2) / side
    x, y = axis[None, :], axis[:, None]
    half = shape.width / 2
    free = np.zeros((side, side), bool)
    for arm in shape.arms_deg:
        angle = np.radians(arm + turn_deg)
        along = x * np.cos(angle) + y * np.sin(angle)
        across = y * np.cos(angle) - x * np.sin(angle)
        # a dead end closes square behind the robot, other arms meet in the middle
        back = -half if shape.name in ("dead end", "L") else 0.0
        free |= (np.abs(across) <= half) & (along >= back)
    return np.where(free, 255, 0).astype(np.uint8)


def scale(fine: np.ndarray, side: int) -> np.ndarray:
    """Scale to side x side cells and cut at grey level 127."""
    small = cv2.resize(fine, (side, side), interpolation=cv2.INTER_AREA)
    return np.where(small > 127, 255, 0).astype(np.uint8)


def flip(image: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Flip each free cell to occupied with a probability."""
    noisy = image.copy()
    noisy[(image > 0) & (rng.random(image.shape) < share)] = 0
    return noisy


def plus_corpus(
    sides: range = range(9, 600, 10), percents: range = range(0, 100, 5)
) -> Iterator[tuple[np.ndarray, int, int, int]]:
    """Yield image, turn in degrees, side, percent of noise: 12,000 images by default."""
    return shape_corpus(PLUS, range(0, 50, 5), sides, percents, seed=())


def shape_corpus(
    shape: Shape,
    turns: Iterable[int],
    sides: Iterable[int],
    percents: Iterable[int],
    *,
    seed: tuple[int, ...] = (7,),
) -> Iterator[tuple[np.ndarray, int, int, int]]:
    """Yield image, turn in degrees, side, percent of noise of one shape."""
    for turn in turns:
        fine = draw_fine(shape, turn)
        for side in sides:
            clean = scale(fine, side)
            for percent in percents:
                rng = np.random.default_rng((turn, side, percent, *seed))
                yield flip(clean, percent / 100, rng), turn, side, percent


def direction_errors(outward_rad: list[float], shape: Shape, turn_deg: float) -> list[float]:
    """Return for each direction its signed distance in degrees to the nearest arm."""
    errors = []
    for heading in outward_rad:
        gaps = [(np.degrees(heading) - arm - turn_deg + 180) % 360 - 180 for arm in shape.arms_deg]
        errors.append(float(min(gaps, key=abs)))
    return errors
