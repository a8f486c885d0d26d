"""Worlds in general position, for tests: places anywhere in the plane, joined by straight ways.

Four kinds: arrangements of a few lines, with pieces taken out; the same where several lines meet in
one point; triangulations of scattered places, thinned; and triangulations with a hole. The stars
come from the headings of the ways alone: two ways that lead on into each other are one local-path,
any other way ends here.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise

import numpy as np
from scipy.spatial import Delaunay

from hssh_kb.experience import Experience
from hssh_kb.trace import make_experience

MOST_ARMS = 5
SHAPES = ("dead end", "straight", "L", "T", "Y", "+", "X", "K", "psi", "4-armed", "5-armed")


class PlaneWorld:
    """Points joined by straight edges; ways within ``tolerance_rad`` of one line are one path."""

    def __init__(
        self,
        points: Sequence[tuple[float, float]],
        edges: Iterable[tuple[int, int]],
        tolerance_rad: float = 1e-6,
    ):
        self.points, self.tolerance_rad = points, tolerance_rad
        self.edges = {frozenset(edge) for edge in edges}
        self.cells = sorted({i for edge in self.edges for i in edge})

    def neighbours(self, i: int) -> list[int]:
        return sorted(next(iter(edge - {i})) for edge in self.edges if i in edge)

    def heading(self, i: int, j: int) -> float:
        (x, y), (x1, y1) = self.points[i], self.points[j]
        return math.atan2(y1 - y, x1 - x)

    def through(self, i: int) -> dict[int, int]:
        """Which ways at a place lead on into which, the straightest pairs first."""
        bends = []
        for a, b in combinations(self.neighbours(i), 2):
            turn = (self.heading(i, a) - self.heading(i, b)) % (2 * math.pi)
            if abs(turn - math.pi) <= self.tolerance_rad:
                bends.append((abs(turn - math.pi), a, b))
        pairs: dict[int, int] = {}
        for _, a, b in sorted(bends):
            if a not in pairs and b not in pairs:
                pairs[a], pairs[b] = b, a
        return pairs

    def star(self, i: int, rotation: int = 0) -> tuple[list[str], dict[int, int]]:
        """Texts of the dlps, clockwise from some way, and where each neighbour's stands."""
        pairs, dlps = self.through(i), []
        for j in self.neighbours(i):
            on = pairs.get(j)
            if on is None:
                dlps.append((self.heading(i, j), f"p{j}+1", j))
                dlps.append((self.heading(i, j) + math.pi, f"p{j}-0", None))
            else:
                name = f"p{min(j, on)}" + ("+1" if j < on else "-1")
                dlps.append((self.heading(i, j), name, j))
        dlps.sort(key=lambda dlp: -(dlp[0] % (2 * math.pi)))
        rotation %= len(dlps)
        dlps = dlps[rotation:] + dlps[:rotation]
        index = {j: k for k, (_, _, j) in enumerate(dlps) if j is not None}
        return [text for _, text, _ in dlps], index

    def shape(self, i: int) -> str:
        """What a place looks like, as one would call it."""
        arms, pairs = len(self.neighbours(i)), self.through(i)
        through = len(pairs) // 2
        if arms == 4 and through == 2:
            a, b = (min(a, b) for a, b in {frozenset(pair) for pair in pairs.items()})
            turn = abs(math.sin(self.heading(i, a) - self.heading(i, b)))
            return "+" if turn > math.sin(math.radians(70)) else "X"
        if arms == 4 and through == 1:
            a = min(pairs)
            sides = {
                (self.heading(i, j) - self.heading(i, a)) % (2 * math.pi) < math.pi
                for j in self.neighbours(i)
                if j not in pairs
            }
            return "K" if len(sides) == 1 else "psi"
        few = {(1, 0): "dead end", (2, 0): "L", (2, 1): "straight", (3, 0): "Y", (3, 1): "T"}
        return few.get((arms, through), f"{arms}-armed")

    def drive(self, route: Sequence[int], rotations: Sequence[int] | None = None) -> Experience:
        """The experience of a route; ``rotations`` says where each visit's star list starts."""
        visits = []
        for v, i in enumerate(route):
            texts, index = self.star(i, rotations[v] if rotations else 0)
            came = texts[index[route[v - 1]]][:-1] if v else ""
            arrive = None
            if came:
                back = came[:-1] + ("-" if came[-1] == "+" else "+")
                arrive = next(k for k, text in enumerate(texts) if text[:-1] == back)
            depart = index[route[v + 1]] if v + 1 < len(route) else None
            visits.append((texts, arrive, depart))
        return make_experience(visits)

    def mirror(self) -> PlaneWorld:
        """The same world with left and right swapped."""
        points = [(-x, y) for x, y in self.points]
        return PlaneWorld(points, map(tuple, self.edges), self.tolerance_rad)

    def has_circular_path(self) -> bool:
        """Whether some path comes back to a place it has passed, which the theory forbids."""
        for i in self.cells:
            for j in self.neighbours(i):
                seen, before, here = {i}, i, j
                while True:
                    if here in seen:
                        return True
                    seen.add(here)
                    on = self.through(here).get(before)
                    if on is None:
                        break
                    before, here = here, on
        return False


def random_plane_world(rng: random.Random) -> PlaneWorld:
    """A world of one of the four kinds, connected, with at most five ways at a place."""
    while True:
        draw = rng.choice(
            (draw_lines, draw_pencils, draw_pencils, draw_triangles, draw_triangles_with_hole)
        )
        points, edges, tolerance_rad = draw(rng)
        edges = thin(rng, edges, extra=rng.choice((0.5, 0.8, 1.0)))
        if len(edges) >= 3:
            return PlaneWorld(points, edges, tolerance_rad)


def draw_lines(rng: random.Random, lines: Sequence[tuple[float, float]] | None = None):
    """Pieces of a few lines (angle, distance from the origin), with dead ends at some ends."""
    if lines is None:
        lines = [(rng.uniform(0, math.pi), rng.uniform(-1, 1)) for _ in range(rng.randint(3, 4))]
    points: list[tuple[float, float]] = []
    on: dict[int, list[int]] = {i: [] for i in range(len(lines))}
    for (i, (a, d)), (j, (b, e)) in combinations(enumerate(lines), 2):
        matrix = np.array([[-math.sin(a), math.cos(a)], [-math.sin(b), math.cos(b)]])
        x, y = map(float, np.linalg.solve(matrix, [d, e]))
        if math.hypot(x, y) > 4:
            continue
        near = [n for n, (u, w) in enumerate(points) if math.hypot(u - x, w - y) < 1e-6]
        if not near:
            points.append((x, y))
        spot = near[0] if near else len(points) - 1
        for line in (i, j):
            if spot not in on[line]:
                on[line].append(spot)
    edges = []
    for i, (a, d) in enumerate(lines):
        dx, dy = math.cos(a), math.sin(a)
        along = {n: points[n][0] * dx + points[n][1] * dy for n in on[i]}
        for side in (-1, 1):
            if rng.random() < 0.5:
                reach = side * (max((side * t for t in along.values()), default=0.0) + 1.0)
                points.append((reach * dx - d * dy, reach * dy + d * dx))
                along[len(points) - 1] = reach
        edges += list(pairwise(sorted(along, key=along.__getitem__)))
    return points, edges, 1e-6


def draw_pencils(rng: random.Random):
    """Two points in each of which three or four lines meet, one of the lines through both."""
    lines = [(0.0, 0.0)]
    for x in (0.0, 2.0):
        for _ in range(rng.randint(2, 3)):
            angle = rng.uniform(0.3, math.pi - 0.3)
            lines.append((angle, -x * math.sin(angle)))
    return draw_lines(rng, lines)


def draw_triangles(rng: random.Random, count: int | None = None):
    """The triangulation of scattered places; ways that bend by less than 17 degrees lead on."""
    points: list[tuple[float, float]] = []
    count = count or rng.randint(4, 8)
    while len(points) < count:
        x, y = rng.uniform(0, 3), rng.uniform(0, 3)
        if all(math.hypot(u - x, w - y) > 0.5 for u, w in points):
            points.append((x, y))
    corners = Delaunay(np.array(points)).simplices
    edges = {frozenset(map(int, pair)) for three in corners for pair in combinations(three, 2)}
    return points, sorted(tuple(sorted(edge)) for edge in edges), 0.3


def draw_triangles_with_hole(rng: random.Random):
    """The same round a hole: no way passes near the middle."""
    points, edges, tolerance_rad = draw_triangles(rng, rng.randint(7, 10))
    kept = [edge for edge in edges if not _near_middle(*(points[i] for i in edge))]
    return points, kept, tolerance_rad


def _near_middle(one: tuple[float, float], other: tuple[float, float]) -> bool:
    middle, a, b = np.array([1.5, 1.5]), np.array(one), np.array(other)
    t = float(np.clip((middle - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1))
    return bool(np.linalg.norm(a + t * (b - a) - middle) < 0.45)


def thin(rng: random.Random, edges, *, extra: float):
    """The largest piece: a random spanning tree of it, and some of the other edges."""
    edges = list(edges)
    rng.shuffle(edges)
    root: dict[int, int] = {}
    degree: dict[int, int] = {}
    kept, spare = [], []

    def find(i):
        while root.setdefault(i, i) != i:
            i = root[i]
        return i

    for one, other in edges:
        full = max(degree.get(one, 0), degree.get(other, 0)) >= MOST_ARMS
        if find(one) == find(other) or full:
            spare.append((one, other))
            continue
        root[find(one)] = find(other)
        kept.append((one, other))
        for i in (one, other):
            degree[i] = degree.get(i, 0) + 1
    for one, other in spare:
        full = max(degree.get(one, 0), degree.get(other, 0)) >= MOST_ARMS
        if rng.random() < extra and not full and find(one) == find(other):
            kept.append((one, other))
            for i in (one, other):
                degree[i] = degree.get(i, 0) + 1
    pieces: dict[int, list] = {}
    for one, other in kept:
        pieces.setdefault(find(one), []).append((one, other))
    return max(pieces.values(), key=len, default=[])
