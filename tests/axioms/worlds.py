"""Small grid worlds and walks on them, for tests: square lattices and triangular lattices."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence

from hssh_kb.experience import Experience
from hssh_kb.trace import experience_from_data, experience_to_data, make_experience

Cell = tuple[int, int]
SQUARE: tuple[Cell, ...] = ((0, 1), (1, 0), (0, -1), (-1, 0))
TRIANGULAR: tuple[Cell, ...] = ((0, 1), (1, 0), (1, -1), (0, -1), (-1, 0), (-1, 1))


class World:
    """Cells joined by edges; ``arms`` are the directions of the lattice, clockwise."""

    def __init__(self, edges: Iterable[tuple[Cell, Cell]], arms=SQUARE, *, stubs: bool = False):
        self.arms, self.stubs = arms, stubs
        self.edges = {frozenset(edge) for edge in edges}
        self.cells = sorted({cell for edge in self.edges for cell in edge})

    def open(self, cell: Cell, arm: int) -> bool:
        dx, dy = self.arms[arm]
        return self.stubs or frozenset((cell, (cell[0] + dx, cell[1] + dy))) in self.edges

    def arm(self, here: Cell, there: Cell) -> int:
        return self.arms.index((there[0] - here[0], there[1] - here[1]))

    def neighbours(self, cell: Cell) -> list[Cell]:
        return sorted(next(iter(edge - {cell})) for edge in self.edges if cell in edge)

    def star(self, cell: Cell, rotation: int = 0) -> tuple[list[str], dict[int, int]]:
        """Texts of the dlps, clockwise from some arm, and where each arm stands in them."""
        half = len(self.arms) // 2
        present = [
            a
            for a in range(len(self.arms))
            if self.open(cell, a) or self.open(cell, (a + half) % len(self.arms))
        ]
        rotation %= len(present)
        present = present[rotation:] + present[:rotation]
        texts = [
            f"{'abc'[a % half]}{'+' if a < half else '-'}{int(self.open(cell, a))}" for a in present
        ]
        return texts, {a: k for k, a in enumerate(present)}

    def drive(self, route: Sequence[Cell], rotations: Sequence[int] | None = None) -> Experience:
        """The experience of a route; ``rotations`` says where each visit's star list starts."""
        visits = []
        for v, cell in enumerate(route):
            texts, index = self.star(cell, rotations[v] if rotations else 0)
            arrive = index[self.arm(route[v - 1], cell)] if v else None
            depart = index[self.arm(cell, route[v + 1])] if v + 1 < len(route) else None
            visits.append((texts, arrive, depart))
        return make_experience(visits)


def grid(width: int, height: int, *, stubs: bool = False) -> World:
    """All cells of a rectangle, joined to their neighbours."""
    edges = [((x, y), (x + 1, y)) for x in range(width - 1) for y in range(height)]
    edges += [((x, y), (x, y + 1)) for x in range(width) for y in range(height - 1)]
    return World(edges, stubs=stubs)


def random_world(
    rng: random.Random, *, triangular: bool = False, size: int = 3, stubs: bool = False
) -> World:
    """A connected world with holes: a random spanning tree plus some further edges."""
    arms = TRIANGULAR if triangular else SQUARE
    width, height = rng.randint(2, size), rng.randint(2, size)
    cells = [(x, y) for x in range(width) for y in range(height)]
    half = arms[: len(arms) // 2]
    edges = [
        ((x, y), (x + dx, y + dy))
        for x, y in cells
        for dx, dy in half
        if (x + dx, y + dy) in set(cells)
    ]
    rng.shuffle(edges)
    keep, extra, root = [], [], {cell: cell for cell in cells}

    def find(cell):
        while root[cell] != cell:
            cell = root[cell]
        return cell

    for one, other in edges:
        a, b = find(one), find(other)
        if a != b:
            root[a] = b
            keep.append((one, other))
        else:
            extra.append((one, other))
    keep += [edge for edge in extra if rng.random() < 0.75]
    return World(keep, arms, stubs=stubs)


def random_walk(rng: random.Random, world: World, travels: int) -> list[Cell]:
    """A walk that seldom turns on its heel."""
    route = [rng.choice(world.cells)]
    while len(route) <= travels:
        options = world.neighbours(route[-1])
        if len(route) > 1 and len(options) > 1 and rng.random() < 0.8:
            options.remove(route[-2])
        route.append(rng.choice(options))
    return route


def random_experience(rng: random.Random, travels: int, **keywords) -> Experience:
    """The experience of a random walk in a random world, each star listed from anywhere."""
    world = random_world(rng, **keywords)
    route = random_walk(rng, world, travels)
    return world.drive(route, [rng.randrange(6) for _ in route])


def with_alternatives(rng: random.Random, experience: Experience) -> Experience:
    """Give some visits a second reading: another star of the walk, come in and left at random."""
    data = experience_to_data(experience)
    last = len(experience) - 1
    for v, item in enumerate(data["visits"]):
        if rng.random() < 0.4:
            star = rng.choice(experience.visits).star
            open_dlps = [k for k in range(len(star)) if star.alpha[k]]
            item["alternatives"] = [
                {
                    "star": [str(dlp) for dlp in star.dlps],
                    "arrive": star.opposite(rng.choice(open_dlps)) if v else None,
                    "depart": rng.choice(open_dlps) if v < last else None,
                    "weight": rng.choice([0.1, 0.2, 0.3]),
                }
            ]
    return experience_from_data(data)


def _serpentine() -> list[Cell]:
    rows = [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1), (0, 2), (1, 2), (2, 2)]
    columns = [(2, 1), (2, 0), (1, 0), (1, 1), (1, 2), (0, 2), (0, 1), (0, 0)]
    return rows + columns


RING = [(0, 0), (1, 0), (1, 1), (0, 1)] * 2 + [(0, 0)]
FIGURE8 = [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1), (0, 0)]
FIGURE8 += [(1, 0), (1, 1), (2, 1), (2, 0), (1, 0), (0, 0)]

REFERENCES: dict[str, tuple[World, list[Cell], tuple[int, int, int], tuple[int, int], int]] = {
    "ring-2x2-l": (grid(2, 2), RING, (9, 8, 8), (2, 2), 1),
    "block-2x2-plus": (grid(2, 2, stubs=True), RING, (12827, 1623, 444), (2, 2), 1),
    "figure8-3x2-lt": (grid(3, 2), FIGURE8, (11, 11, 11), (5, 6), 2),
    "grid-3x3-ltplus": (grid(3, 3), _serpentine(), (129, 88, 62), (4, 5), 1),
}
