"""Ways in which real grids differ from clean ones, and LPMs as a lidar leaves them."""

from __future__ import annotations

import cv2
import numpy as np

from perception.grid import FREE, OCCUPIED, UNKNOWN
from perception.lpm import LocalMap
from tests.perception.corpus import Shape, draw_fine


def roughen(image: np.ndarray, rms_px: float, rng: np.random.Generator) -> np.ndarray:
    """Move the walls in and out by smooth random offsets of the given size."""
    free = (image > 127).astype(np.uint8)
    signed = cv2.distanceTransform(free, cv2.DIST_L2, 5) - cv2.distanceTransform(
        1 - free, cv2.DIST_L2, 5
    )
    offset = cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), 2.0)
    offset *= rms_px / offset.std()
    return np.where(signed > offset, FREE, OCCUPIED).astype(np.uint8)


def thin_walls(image: np.ndarray, missing: float, rng: np.random.Generator) -> np.ndarray:
    """Keep of the walls only their outermost cells, drop some, and know nothing behind them."""
    free = (image > 127).astype(np.uint8)
    shell = (cv2.dilate(free, np.ones((3, 3), np.uint8)) > 0) & (free == 0)
    out = np.full(image.shape, UNKNOWN, np.uint8)
    out[free > 0] = FREE
    out[shell & (rng.random(image.shape) >= missing)] = OCCUPIED
    return out


def put_box(
    image: np.ndarray, shape: Shape, turn_deg: float, where: str, rng: np.random.Generator
) -> np.ndarray:
    """Put a box in the crossing, or against the wall of an arm; a third of the corridor wide."""
    side = len(image)
    width = shape.width * side
    size = width / 3
    if where == "crossing":
        centre = rng.uniform(-0.15, 0.15, 2) * width
        angle = rng.uniform(0, np.pi)
    else:
        arm = np.radians(shape.arms_deg[rng.integers(len(shape.arms_deg))] + turn_deg)
        along, across = rng.uniform(0.9, 1.3) * width, (width - size) / 2 * rng.choice([-1, 1])
        centre = np.array(
            [
                along * np.cos(arm) - across * np.sin(arm),
                along * np.sin(arm) + across * np.cos(arm),
            ]
        )
        angle = arm
    corners = cv2.boxPoints(
        (
            (float(centre[0] + side / 2), float(centre[1] + side / 2)),
            (size, size),
            float(np.degrees(angle)),
        )
    )
    out = image.copy()
    cv2.fillConvexPoly(out, np.round(corners).astype(np.int32), OCCUPIED)
    return out


def cut_wedge(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Forget a wedge of space that starts a little away from the robot, as a shadow does."""
    side = len(image)
    heading = rng.uniform(-np.pi, np.pi)
    spread = rng.uniform(0.04, 0.12)
    start = rng.uniform(0.32, 0.4) * side
    middle = np.full(2, side / 2)
    edge = [
        middle + r * np.array([np.cos(heading + a), np.sin(heading + a)])
        for r, a in ((start, -spread), (2 * side, -spread), (2 * side, spread), (start, spread))
    ]
    out = image.copy()
    cv2.fillConvexPoly(out, np.round(edge).astype(np.int32), UNKNOWN)
    return out


class LidarWorld:
    """A shape as a building of 40 m, and a robot with a 180 degree lidar in it."""

    def __init__(self, shape: Shape, turn_deg: float, width_m: float) -> None:
        self.size_m, self.cell_m = 40.0, 0.05
        narrow = Shape(shape.name, shape.arms_deg, shape.star, width_m / self.size_m)
        self.free = draw_fine(narrow, turn_deg, round(self.size_m / self.cell_m)) > 0

    def cast(self, pose: np.ndarray, angles: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return noisy ranges up to 20 m, NaN beyond; x right, y up, origin in the middle."""
        reach = np.arange(0.0, 20.0, 0.02)
        heading = pose[2] + angles
        x = pose[0] + np.cos(heading)[:, None] * reach
        y = pose[1] + np.sin(heading)[:, None] * reach
        half = self.size_m / 2
        column = np.clip(((x + half) / self.cell_m).astype(int), 0, len(self.free) - 1)
        row = np.clip(((half - y) / self.cell_m).astype(int), 0, len(self.free) - 1)
        hit = ~self.free[row, column]
        first = hit.argmax(axis=1)
        ranges = reach[first] + rng.normal(0, 0.015, len(first))
        ranges[~hit.any(axis=1)] = np.nan
        return ranges.astype(np.float32)

    def drive(
        self, heading_rad: float, start_m: float, stop_m: float, rng: np.random.Generator
    ) -> tuple[np.ndarray, tuple[float, float]]:
        """Drive through the middle from start_m (negative: before it); return LPM and robot."""
        angles = np.radians(np.arange(-90.0, 91.0))
        local = LocalMap(15.0, 0.1)
        way = np.arange(start_m, stop_m + 1e-6, 0.2)
        for s in way:
            wobble = rng.normal(0, 0.02, 2)
            pose = np.array(
                [
                    s * np.cos(heading_rad) + wobble[0],
                    s * np.sin(heading_rad) + wobble[1],
                    heading_rad + rng.normal(0, 0.02),
                ]
            )
            local.update(pose, self.cast(pose, angles, rng), angles)
        column, row = local.frame.to_pixels(pose[:2])
        return local.image(), (float(column), float(row))


def round_corners(image: np.ndarray, width_px: float) -> np.ndarray:
    """Round all corners of the walls, the more the wider the corridor."""
    free = (image > 127).astype(np.float32)
    smooth = cv2.GaussianBlur(free, (0, 0), 0.2 * width_px, borderType=cv2.BORDER_REPLICATE)
    return np.where(smooth > 0.5, FREE, OCCUPIED).astype(np.uint8)


def draw_uneven(
    shape: Shape,
    turn_deg: float,
    side: int,
    widths: tuple[float, ...],
    centre: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    """Draw a shape whose arms differ in width, the crossing off the middle; shares of the side."""
    fine = 3 * side
    axis = (np.arange(fine, dtype=np.float32) - (fine - 1) / 2) / fine
    x, y = axis[None, :] - centre[0], axis[:, None] - centre[1]
    free = np.zeros((fine, fine), bool)
    for arm, width in zip(shape.arms_deg, widths, strict=True):
        angle = np.radians(arm + turn_deg)
        along = x * np.cos(angle) + y * np.sin(angle)
        across = y * np.cos(angle) - x * np.sin(angle)
        back = -min(widths) / 2 if shape.name in ("L", "dead end") else 0.0
        free |= (np.abs(across) <= width / 2) & (along >= back)
    small = cv2.resize(np.where(free, 255, 0).astype(np.uint8), (side, side), None, 0, 0, 3)
    return np.where(small > 127, FREE, OCCUPIED).astype(np.uint8)


def put_glass(
    image: np.ndarray, width_px: tuple[float, float], depth_px: float, rng: np.random.Generator
) -> np.ndarray:
    """Take pieces out of thin walls, as glass does, with some free space seen behind them."""
    free = (image > 127).astype(np.uint8)
    out = thin_walls(image, 0.0, rng)
    rows, columns = np.nonzero(out == OCCUPIED)
    for _ in range(3):
        k = rng.integers(len(rows))
        radius = rng.uniform(*width_px) / 2
        near = np.hypot(columns - columns[k], rows - rows[k]) <= radius
        seen = np.zeros_like(free)
        cv2.circle(seen, (int(columns[k]), int(rows[k])), round(min(radius, depth_px)), 1, -1)
        out[(seen > 0) & (out == UNKNOWN)] = FREE
        out[rows[near], columns[near]] = FREE
    return out
