"""Small floors drawn with rectangles, for tests of floor maps."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import yaml

from perception.grid import FREE, OCCUPIED, UNKNOWN

RESOLUTION = 0.05
CELL = 1 / RESOLUTION


class Plan:
    """A floor in metres, x right, y down from the top, carved out of unknown space."""

    def __init__(self, width_m: float, height_m: float) -> None:
        shape = (round(height_m * CELL), round(width_m * CELL))
        self.free = np.zeros(shape, bool)
        self.wall = np.zeros(shape, bool)

    def carve(self, x: float, y: float, w: float, h: float) -> Plan:
        """Make a rectangle free."""
        self.free[self._window(x, y, w, h)] = True
        return self

    def block(self, x: float, y: float, w: float, h: float) -> Plan:
        """Make a rectangle occupied: furniture, or a thin wall."""
        self.wall[self._window(x, y, w, h)] = True
        return self

    def _window(self, x: float, y: float, w: float, h: float) -> tuple[slice, slice]:
        x0, y0, x1, y1 = (round(v * CELL) for v in (x, y, x + w, y + h))
        return slice(y0, y1), slice(x0, x1)

    def image(self) -> np.ndarray:
        """Return the grid: walls 15 cm thick around what is free, beyond them unknown."""
        image = np.full(self.free.shape, UNKNOWN, np.uint8)
        shell = cv2.dilate(self.free.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        image[shell] = OCCUPIED
        image[self.free] = FREE
        image[self.wall] = OCCUPIED
        return image


def draw_office() -> Plan:
    """Draw a corridor 24 m x 2 m with three rooms behind doors above, a bend and a hall."""
    plan = Plan(32, 18).carve(2, 8, 24, 2)
    for k in range(3):
        plan.carve(3 + 6 * k, 3.7, 5, 4.1).carve(5 + 6 * k, 7.7, 0.9, 0.4)
    plan.carve(24, 8, 2, 8).carve(14, 14, 12, 2)
    return plan


def write_ros_map(folder: Path, levels: np.ndarray, **changes: object) -> Path:
    """Write a ROS map; changes are to keys of the yaml, None leaves one out."""
    cv2.imwrite(str(folder / "floor.png"), levels)
    data: dict[str, object] = {
        "image": "floor.png",
        "resolution": RESOLUTION,
        "origin": [0.0, 0.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    data = {key: value for key, value in (data | changes).items() if value is not None}
    path = folder / "floor.yaml"
    path.write_text(yaml.safe_dump(data))
    return path
