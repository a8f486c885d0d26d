"""Random corridor worlds: crossings of all kinds, drawn from a graph of ways, with dirt.

A world is a graph of straight ways of different widths. Their union is drawn on a fine grid, rooms,
recesses, pillars and furniture are added, and the outline becomes wall segments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

CELL_M = 0.02
MARGIN_M = 2.0
WALL_M = 0.15

RADIAL = {
    "+": (0, 90, 180, 270),
    "X": (0, 70, 180, 250),
    "T": (0, 90, 180),
    "slanted T": (0, 65, 180),
    "L": (0, 90),
    "sharp L": (0, 65),
    "Y": (0, 120, 240),
    "K": (0, 60, 120, 180),
    "psi": (30, 90, 150, 270),
    "five arms": (0, 60, 120, 180, 240),
    "dead end": (0,),
}
"""Directions of the arms of a crossing, degrees."""


@dataclass(frozen=True)
class Way:
    """A straight way between two nodes."""

    start: int
    end: int
    width_m: float


@dataclass(frozen=True, eq=False)
class CorridorWorld:
    """Walls (n, 4), nodes (k, 2) in metres, ways, and what kind of crossing was meant at node 0."""

    segments: np.ndarray
    nodes: np.ndarray
    ways: tuple[Way, ...]
    kind: str

    def arms(self, node: int) -> list[tuple[float, Way, int]]:
        """Return heading (radians), way and far end of the arms of a node, anticlockwise."""
        out = []
        for way in self.ways:
            for a, b in ((way.start, way.end), (way.end, way.start)):
                if a == node:
                    dx, dy = self.nodes[b] - self.nodes[a]
                    out.append((math.atan2(dy, dx) % (2 * math.pi), way, b))
        return sorted(out, key=lambda arm: arm[0])

    def is_place(self, node: int) -> bool:
        """Tell whether a node is a dead end, a crossing, or a bend sharp enough to be a corner."""
        headings = [heading for heading, _, _ in self.arms(node)]
        if len(headings) != 2:
            return True
        bend = abs(math.remainder(headings[1] - headings[0] - math.pi, 2 * math.pi))
        return bend > math.radians(55)


class Sketch:
    """A floor being drawn: free where one can be, on a grid of 2 cm."""

    def __init__(self, nodes: np.ndarray, ways: Sequence[Way], rng: np.random.Generator) -> None:
        self.low = nodes.min(0) - 6.0 - MARGIN_M
        size = np.ceil((nodes.max(0) + 6.0 + MARGIN_M - self.low) / CELL_M).astype(int)
        self.free = np.zeros((size[1], size[0]), np.uint8)
        self.nodes, self.ways, self.rng = nodes, tuple(ways), rng
        for way in ways:
            self.fill(self.strip(way, 0.0, 1.0, -0.5 * way.width_m, 0.5 * way.width_m))
        for k in range(len(nodes)):
            self._mitre(k)
        self.corridors = self.free.copy()

    def fill(self, corners_m: np.ndarray, value: int = 1) -> None:
        """Fill a polygon (n, 2)."""
        points = (np.asarray(corners_m) - self.low) / CELL_M
        cv2.fillPoly(self.free, [np.round(points * 16).astype(np.int32)], value, shift=4)

    def strip(self, way: Way, first: float, last: float, right: float, left: float) -> np.ndarray:
        """Return the corners of a box beside a way: shares of its length, metres to the left."""
        a, b = self.nodes[way.start], self.nodes[way.end]
        along, normal = b - a, self.normal(way)
        return np.array(
            [
                a + first * along + right * normal,
                a + last * along + right * normal,
                a + last * along + left * normal,
                a + first * along + left * normal,
            ]
        )

    def normal(self, way: Way) -> np.ndarray:
        dx, dy = self.nodes[way.end] - self.nodes[way.start]
        return np.array([-dy, dx]) / math.hypot(dx, dy)

    def length(self, way: Way) -> float:
        return float(np.hypot(*(self.nodes[way.end] - self.nodes[way.start])))

    def _mitre(self, k: int) -> None:
        """Fill the outer corners between neighbouring ways of a node."""
        arms = []
        for way in self.ways:
            for a, b in ((way.start, way.end), (way.end, way.start)):
                if a == k:
                    step = self.nodes[b] - self.nodes[a]
                    arms.append((math.atan2(step[1], step[0]), way.width_m / 2))
        arms.sort()
        for (one, half), (other, other_half) in zip(arms, arms[1:] + arms[:1], strict=True):
            gap = (other - one) % (2 * math.pi)
            if len(arms) < 2 or gap < math.pi + 0.02:
                continue
            p = self.nodes[k] + half * np.array([-math.sin(one), math.cos(one)])
            q = self.nodes[k] + other_half * np.array([math.sin(other), -math.cos(other)])
            d, e = (np.array([math.cos(t), math.sin(t)]) for t in (one, other))
            s = np.linalg.solve(np.column_stack([d, -e]), q - p)
            s = np.maximum(s, -2.5 * max(half, other_half))
            self.fill(np.array([self.nodes[k], p, p + s[0] * d, q + s[1] * e, q]))

    def add_recesses(self, share: float) -> None:
        """Add closed doors, a hand's breadth behind the wall, along the ways."""
        for way, at, side in self._stations(2.0, share):
            half = 0.45 / self.length(way)
            depth = self.rng.uniform(0.05, 0.15)
            edge = side * way.width_m / 2
            self.fill(self.strip(way, at - half, at + half, edge, edge + side * depth))

    def add_pillars(self, share: float) -> None:
        """Let pillars stand out from the walls, where a robot can still pass."""
        for way, at, side in self._stations(4.0, share):
            depth = min(self.rng.uniform(0.1, 0.3), way.width_m - 1.1)
            if depth > 0:
                half = self.rng.uniform(0.1, 0.25) / self.length(way)
                edge = side * way.width_m / 2
                self.fill(self.strip(way, at - half, at + half, edge - side * depth, edge), 0)

    def add_alcoves(self, share: float) -> None:
        """Add bays too shallow to be a way."""
        for way, at, side in self._stations(4.0, share):
            half = self.rng.uniform(0.2, 0.6) / self.length(way)
            edge = side * way.width_m / 2
            depth = self.rng.uniform(0.2, 0.5)
            self.fill(self.strip(way, at - half, at + half, edge, edge + side * depth))

    def add_furniture(self, share: float) -> None:
        """Put boxes along the walls of wide ways."""
        for way, at, side in self._stations(5.0, share):
            depth = min(self.rng.uniform(0.3, 0.5), way.width_m - 1.4)
            if depth > 0.15:
                half = self.rng.uniform(0.2, 0.6) / self.length(way)
                edge = side * (way.width_m / 2 - 0.02)
                self.fill(self.strip(way, at - half, at + half, edge - side * depth, edge), 0)

    def add_rooms(self, share: float, door_m: float = 0.9) -> int:
        """Add small rooms behind doors; return how many there was space for."""
        count = 0
        for way, at, side in self._stations(4.0, share):
            wide, deep = self.rng.uniform(2.5, 4.5), self.rng.uniform(2.0, 4.0)
            length = self.length(way)
            half = wide / 2 / length
            edge = side * way.width_m / 2
            near, far = edge + side * WALL_M, edge + side * (WALL_M + deep)
            room = self.strip(way, at - half, at + half, near, far)
            rim = 0.12
            outer = self.strip(
                way, at - half - rim / length, at + half + rim / length, near - side * 0.02, far
            )
            if self._is_taken(outer):
                continue
            self.fill(room)
            shift = self.rng.uniform(-0.3, 0.3) * wide / length
            door = door_m / 2 / length
            self.fill(self.strip(way, at + shift - door, at + shift + door, edge, near))
            count += 1
        return count

    def roughen(self) -> None:
        """Let the walls waver by a grid cell or two."""
        noise = self.rng.normal(size=(self.free.shape[0] // 16 + 1, self.free.shape[1] // 16 + 1))
        noise = cv2.resize(noise.astype(np.float32), self.free.shape[::-1])
        self.free[(cv2.dilate(self.free, np.ones((3, 3), np.uint8)) > 0) & (noise > 0.5)] = 1

    def outline(self) -> np.ndarray:
        """Return the walls (n, 4), metres."""
        found, _ = cv2.findContours(self.free, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        out = []
        for contour in found:
            corners = cv2.approxPolyDP(contour, 0.8, closed=True).reshape(-1, 2)
            if len(corners) >= 3:
                points = corners * CELL_M + self.low
                out.append(np.hstack([points, np.roll(points, -1, axis=0)]))
        return np.concatenate(out)

    def _stations(self, every_m: float, share: float) -> list[tuple[Way, float, float]]:
        """Return places (way, share of its length, side) off the crossings, about so far apart."""
        out = []
        for way in self.ways:
            length, clear = self.length(way), 1.6 + way.width_m / 2
            for side in (-1.0, 1.0):
                for s in np.arange(clear, length - clear, every_m):
                    s += self.rng.uniform(-0.3, 0.3) * every_m
                    if clear < s < length - clear and self.rng.random() < share:
                        out.append((way, float(s / length), side))
        return out

    def _is_taken(self, corners_m: np.ndarray) -> bool:
        mask = np.zeros_like(self.free)
        points = (corners_m - self.low) / CELL_M
        cv2.fillPoly(mask, [np.round(points * 16).astype(np.int32)], 1, shift=4)
        return bool((mask & self.free).any())


def dress(sketch: Sketch, rng: np.random.Generator, *, rooms: bool) -> None:
    """Add the dirt of a real floor, some of it in each world."""
    if rooms:
        sketch.add_rooms(0.5)
    sketch.add_recesses(rng.choice([0.0, 0.5]))
    sketch.add_pillars(rng.choice([0.0, 0.3]))
    sketch.add_furniture(rng.choice([0.0, 0.0, 0.4]))
    if rng.random() < 0.5:
        sketch.roughen()


def draw_radial(kind: str, seed: int, *, rooms: bool = False) -> CorridorWorld:
    """Draw one crossing whose arms end blindly, each of its own width."""
    rng = np.random.default_rng([seed, 1])
    turn = rng.uniform(0, 360)
    angles = np.deg2rad(np.array(RADIAL[kind]) + turn + rng.uniform(-6, 6, len(RADIAL[kind])))
    reach = rng.uniform(9.0, 13.0, len(angles))
    ends = reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    nodes = np.vstack([[0.0, 0.0], ends])
    usual = rng.uniform(1.2, 3.0)
    widths = np.clip(usual * rng.uniform(0.75, 1.25, len(angles)), 1.2, 3.0)
    if kind in ("K", "psi", "five arms"):  # many broad arms are a hall, not a crossing
        widths = np.minimum(widths, 2.0)
    ways = [Way(0, k + 1, float(w)) for k, w in enumerate(widths)]
    sketch = Sketch(nodes, ways, rng)
    dress(sketch, rng, rooms=rooms)
    return CorridorWorld(sketch.outline(), nodes, tuple(ways), kind)


def draw_grid(
    seed: int, columns: int = 4, rows: int = 3, *, rooms: bool = False, spacing_m: float = 11.0
) -> CorridorWorld:
    """Draw a grid of corridors with holes; crossings are shifted, so that corridors slant."""
    rng = np.random.default_rng([seed, 2])
    at = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    nodes = at * spacing_m + rng.uniform(-0.12, 0.12, at.shape) * spacing_m
    pairs = [
        (a, b)
        for a in range(len(at))
        for b in range(a + 1, len(at))
        if np.abs(at[a] - at[b]).sum() == 1
    ]
    order = rng.permutation(len(pairs))
    parent = list(range(len(at)))

    def root(k: int) -> int:
        while parent[k] != k:
            k = parent[k]
        return k

    ways = []
    for k in order:
        a, b = pairs[k]
        apart = root(a) != root(b)
        if apart or rng.random() < 0.55:
            parent[root(a)] = root(b)
            ways.append(Way(a, b, float(rng.uniform(1.4, 2.8))))
    sketch = Sketch(nodes, ways, rng)
    dress(sketch, rng, rooms=rooms)
    return CorridorWorld(sketch.outline(), nodes, tuple(ways), "grid")


def draw_corridor(seed: int, length_m: float = 100.0) -> CorridorWorld:
    """Draw one long corridor: gentle bends, changes of width, doors closed, pillars, alcoves."""
    rng = np.random.default_rng([seed, 3])
    nodes, heading = [np.zeros(2)], rng.uniform(-np.pi, np.pi)
    width = float(rng.uniform(1.3, 2.8))
    bend = rng.uniform(-1, 1) * math.radians(18)
    ways: list[Way] = []
    way_m = 0.0
    while way_m < length_m:
        step = float(rng.uniform(4.0, 12.0))
        nodes.append(nodes[-1] + step * np.array([math.cos(heading), math.sin(heading)]))
        ways.append(Way(len(nodes) - 2, len(nodes) - 1, width))
        way_m += step
        if rng.random() < 0.3:
            width = float(np.clip(width + rng.uniform(-0.35, 0.35), 1.2, 3.0))
        # Bend one way and then the other, so that the corridor does not meet itself.
        heading += bend * rng.uniform(0.3, 1.0)
        if rng.random() < 0.35:
            bend = -bend
    array = np.array(nodes)
    sketch = Sketch(array, ways, rng)
    sketch.add_recesses(0.6)
    sketch.add_pillars(rng.choice([0.0, 0.3]))
    sketch.add_alcoves(rng.choice([0.0, 0.2]))
    sketch.add_furniture(rng.choice([0.0, 0.3]))
    if rng.random() < 0.5:
        sketch.roughen()
    return CorridorWorld(sketch.outline(), array, tuple(ways), "corridor")
