"""Symbolic worlds and noisy walks through them, from seeds: the ground truth of the search tests.

A world is places with dlps at bearings, and corridors between their gateways; a walk is what
a robot did in it; ``observe`` is what the robot would have written down, with eyes that err as
much as asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from hssh_kb.experience import Displacement, Experience, Reading, Visit
from hssh_kb.hypothesis import Hypothesis
from perception.star import Dlp, Star

EAST, SOUTH, WEST, NORTH = range(4)  # clockwise
STEPS = {EAST: (1, 0), SOUTH: (0, -1), WEST: (-1, 0), NORTH: (0, 1)}
BEARINGS = (0.0, -math.pi / 2, math.pi, math.pi / 2)


@dataclass(frozen=True)
class World:
    """Places with their dlps (clockwise: bearing, path name, direction, alpha), and corridors.

    ``lengths``: of corridors that do not run straight, by where they start.
    """

    positions: tuple[tuple[float, float], ...]
    dlps: tuple[tuple[tuple[float, str, str, int], ...], ...]
    corridors: dict[tuple[int, int], tuple[int, int]]
    lengths: dict[tuple[int, int], float] = field(default_factory=dict)

    def opposite(self, place: int, k: int) -> int:
        _, name, direction, _ = self.dlps[place][k]
        return next(
            i
            for i, (_, other, way, _) in enumerate(self.dlps[place])
            if other == name and way != direction
        )

    def exits(self, place: int) -> list[int]:
        return [k for k in range(len(self.dlps[place])) if (place, k) in self.corridors]


@dataclass
class Walk:
    """places[v], arrive[v] (dlp faced), depart[v]; None at the two ends."""

    places: list[int]
    arrive: list[int | None]
    depart: list[int | None]


@dataclass(frozen=True)
class Eyes:
    """How the robot sees; see ``observe``."""

    sigma: float = 0.05  # of a displacement, fraction of its length, per axis
    sigma_m: float = 0.0  # added to it, metres, per axis
    heading_rad: float = 0.01  # per travel
    headings: bool = True  # readings carry the headings of the dlps
    headings_rad: float = 0.0  # noise of those
    spread_m: float = 0.0  # of the origin of a visit around its place
    turned: bool = True  # stars are listed from an arbitrary dlp on
    robot_frames: bool = False  # the frame of a visit looks along the robot, not the place
    wrong: float = 0.0  # share of the visits whose best star is wrong
    true_weight: float = 0.3  # of the true star then
    lost: float = 0.0  # share of the wrong visits without the true star
    doubtful: float = 0.0  # share of the right visits with a wrong alternative
    missed: float = 0.0  # chance that a place passed straight through goes unnoticed
    scale: float = 1.0  # metres per grid edge


# Eyes like those of a robot that drives through a building
ROBOT = Eyes(
    sigma=0.01,
    sigma_m=0.1,
    heading_rad=0.02,
    headings_rad=0.08,
    spread_m=0.25,
    robot_frames=True,
    wrong=0.3,
    doubtful=0.4,
    missed=0.05,
    scale=8,
)


@dataclass(frozen=True)
class Truth:
    """What was seen, and what it was: place and true reading (-1: none) of each visit.

    ``skipped`` are the travels (by the visit they lead to) on which a place went unnoticed.
    """

    experience: Experience
    places: tuple[int, ...]
    readings: tuple[int, ...]
    skipped: tuple[int, ...]

    @property
    def partition(self) -> tuple[int, ...]:
        first: dict[int, int] = {}
        return tuple(first.setdefault(p, v) for v, p in enumerate(self.places))

    def hypothesis(self) -> Hypothesis:
        """The true map; needs the true reading of each visit."""
        if min(self.readings) < 0:
            raise ValueError("a visit has no true reading")
        partition, offsets = self.partition, []
        stars = [
            v.readings[i].star for v, i in zip(self.experience.visits, self.readings, strict=True)
        ]
        for v, first in enumerate(partition):
            names = [(dlp.path, dlp.direction) for dlp in stars[first].dlps]
            offsets.append(names.index((stars[v].dlps[0].path, stars[v].dlps[0].direction)))
        return Hypothesis(partition, tuple(offsets), self.readings, doubted=self.skipped)


def make_grid(
    width: int,
    height: int,
    *,
    stubs: bool = False,
    holes: float = 0.0,
    jitter: float = 0.0,
    rng: np.random.Generator | None = None,
) -> World:
    """A grid; borders are L and T (or +, all alike, with stubs); some corridors may be left out."""
    cells = [(x, y) for y in range(height) for x in range(width)]
    index = {cell: i for i, cell in enumerate(cells)}
    shut = set()
    if holes and rng is not None:
        shut = _choose_shut(cells, index, holes, rng)
    corridors = {}
    for (x, y), i in index.items():
        for k, (dx, dy) in STEPS.items():
            j = index.get((x + dx, y + dy))
            if j is not None and frozenset((i, j)) not in shut:
                corridors[i, k] = (j, (k + 2) % 4)
    dlps = [
        tuple(
            (BEARINGS[k], "ab"[k % 2], "+-"[k // 2], int(stubs or (i, k) in corridors))
            for k in range(4)
        )
        for i in range(len(cells))
    ]
    positions = np.array(cells, float)
    if jitter and rng is not None:
        positions = positions + rng.uniform(-jitter, jitter, positions.shape)
    return World(tuple(map(tuple, positions.tolist())), tuple(dlps), corridors)


def _choose_shut(cells, index, holes, rng):
    """Choose corridors to leave out so that the world stays connected."""
    edges = [
        frozenset((index[x, y], index[x + dx, y + dy]))
        for x, y in cells
        for dx, dy in ((1, 0), (0, 1))
        if (x + dx, y + dy) in index
    ]
    shut: set[frozenset[int]] = set()
    for e in rng.permutation(len(edges))[: int(holes * len(edges))]:
        trial = shut | {edges[e]}
        seen, todo = {0}, [0]
        while todo:
            i = todo.pop()
            for edge in edges:
                if edge not in trial and i in edge:
                    (j,) = edge - {i}
                    if j not in seen:
                        seen.add(j)
                        todo.append(j)
        if len(seen) == len(cells):
            shut = trial
    return shut


def follow_route(world: World, cells: list[int]) -> Walk:
    """The walk along a list of neighbouring places."""
    walk = Walk(list(cells), [None], [])
    for here, there in pairwise(cells):
        k = next(k for k in world.exits(here) if world.corridors[here, k][0] == there)
        gateway = world.corridors[here, k][1]
        walk.depart.append(k)
        walk.arrive.append(world.opposite(there, gateway))
    walk.depart.append(None)
    return walk


def walk_randomly(
    world: World, travels: int, rng: np.random.Generator, *, start: int | None = None
) -> Walk:
    """A random walk that turns back only at dead ends."""
    here = int(rng.integers(len(world.positions))) if start is None else start
    walk, came = Walk([here], [None], []), None
    for _ in range(travels):
        ways = [k for k in world.exits(here) if k != came] or world.exits(here)
        k = ways[int(rng.integers(len(ways)))]
        here, came = world.corridors[here, k]
        walk.depart.append(k)
        walk.places.append(here)
        walk.arrive.append(world.opposite(here, came))
    walk.depart.append(None)
    return walk


def explore(world: World, travels: int, rng: np.random.Generator) -> Walk:
    """A walk that prefers corridors it has not gone through (as a robot on an errand would)."""
    here = int(rng.integers(len(world.positions)))
    walk, came, used = Walk([here], [None], []), None, {}
    for _ in range(travels):
        ways = [k for k in world.exits(here) if k != came] or world.exits(here)
        least = min(used.get((here, k), 0) for k in ways)
        ways = [k for k in ways if used.get((here, k), 0) == least]
        k = ways[int(rng.integers(len(ways)))]
        there, gateway = world.corridors[here, k]
        used[here, k] = used.get((here, k), 0) + 1
        used[there, gateway] = used.get((there, gateway), 0) + 1
        here, came = there, gateway
        walk.depart.append(k)
        walk.places.append(here)
        walk.arrive.append(world.opposite(here, came))
    walk.depart.append(None)
    return walk


def observe(world: World, walk: Walk, eyes: Eyes, rng: np.random.Generator) -> Truth:
    """Write down a walk as an experience, seen with the given eyes."""
    kept = [v for v in range(len(walk.places)) if not _is_missed(world, walk, v, eyes, rng)]
    frames = [_choose_frame(world, walk, v, eyes, rng) for v in range(len(walk.places))]
    ways = zip(walk.places, walk.depart, strict=True)
    lengths = [eyes.scale * world.lengths.get(way, 0.0) for way in ways]
    visits, truths, skipped = [], [], []
    for order, v in enumerate(kept):
        readings, true = _read_star(world, walk, v, frames[v][2], eyes, rng)
        truths.append(true)
        if order and v - kept[order - 1] > 1:
            skipped.append(order)
        displacement = None
        if order:
            displacement = _measure(frames, lengths, range(kept[order - 1], v + 1), eyes, rng)
        visits.append(Visit(tuple(readings), displacement))
    experience = Experience(tuple(visits), "walk", slip=_slip_of(eyes))
    places = tuple(walk.places[v] for v in kept)
    return Truth(experience, places, tuple(truths), tuple(skipped))


def _slip_of(eyes: Eyes) -> float:
    return max(0.02, eyes.missed / 2) if eyes.missed or eyes.lost else 0.0


def _is_missed(world, walk, v, eyes, rng) -> bool:
    if not eyes.missed or v in (0, len(walk.places) - 1):
        return False
    straight = walk.depart[v] == walk.arrive[v]
    return bool(straight and rng.random() < eyes.missed)


def _choose_frame(world, walk, v, eyes, rng) -> tuple[float, float, float]:
    x, y = world.positions[walk.places[v]]
    x, y = eyes.scale * x, eyes.scale * y
    if eyes.spread_m:
        x, y = x + rng.normal(0, eyes.spread_m), y + rng.normal(0, eyes.spread_m)
    theta = 0.0
    if eyes.robot_frames and walk.arrive[v] is not None:
        theta = world.dlps[walk.places[v]][walk.arrive[v]][0] + rng.normal(0, 0.1)
    return x, y, theta


def _measure(frames, lengths, steps, eyes, rng) -> Displacement:
    """The displacement from the first of the frames to the last, travel by travel."""
    pose, cov = np.zeros(3), np.zeros((3, 3))
    for a, b in pairwise(steps):
        xa, ya, ta = frames[a]
        xb, yb, tb = frames[b]
        c, s = math.cos(ta), math.sin(ta)
        dx, dy = c * (xb - xa) + s * (yb - ya), -s * (xb - xa) + c * (yb - ya)
        length = max(lengths[a], math.hypot(dx, dy))
        sigma = math.hypot(eyes.sigma * length, eyes.sigma_m)
        z = np.array([dx, dy, tb - ta]) + rng.normal(0, 1, 3) * [sigma, sigma, eyes.heading_rad]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        lever = turn @ np.array([z[0], z[1], 0])
        shift = np.array([[1, 0, -lever[1]], [0, 1, lever[0]], [0, 0, 1]])
        noise = np.diag([sigma**2, sigma**2, eyes.heading_rad**2])
        cov = shift @ cov @ shift.T + turn @ noise @ turn.T
        pose = pose + turn @ z
    cov = cov + np.eye(3) * 1e-12
    theta = (pose[2] + math.pi) % (2 * math.pi) - math.pi
    return Displacement(float(pose[0]), float(pose[1]), float(theta), tuple(map(tuple, cov)))


def _read_star(world, walk, v, frame_rad, eyes, rng) -> tuple[list[Reading], int]:
    place = walk.places[v]
    true = [list(dlp) for dlp in world.dlps[place]]
    arrive, depart = walk.arrive[v], walk.depart[v]
    right = _write(true, arrive, depart, frame_rad, 1.0, eyes, rng)
    if eyes.wrong and rng.random() < eyes.wrong:
        wrong = _spoil(world, place, true, arrive, depart, rng)
        if wrong is not None:
            dlps, a, d = wrong
            if rng.random() < eyes.lost:
                return [_write(dlps, a, d, frame_rad, 1.0, eyes, rng)], -1
            weight = eyes.true_weight
            return [
                _write(dlps, a, d, frame_rad, 1 - weight, eyes, rng),
                _write(true, arrive, depart, frame_rad, weight, eyes, rng),
            ], 1
    if eyes.doubtful and rng.random() < eyes.doubtful:
        wrong = _spoil(world, place, true, arrive, depart, rng)
        if wrong is not None:
            weight = float(rng.uniform(0.1, 0.45))
            dlps, a, d = wrong
            return [
                _write(true, arrive, depart, frame_rad, 1 - weight, eyes, rng),
                _write(dlps, a, d, frame_rad, weight, eyes, rng),
            ], 0
    return [right], 0


def _write(dlps, arrive, depart, frame_rad, weight, eyes, rng) -> Reading:
    size = len(dlps)
    shift = int(rng.integers(size)) if eyes.turned and size else 0
    at = {(k + shift) % size: k for k in range(size)}
    dlps_out = tuple(Dlp(dlps[at[i]][1], dlps[at[i]][2], dlps[at[i]][3]) for i in range(size))
    headings: tuple[float, ...] = ()
    if eyes.headings:
        noise = rng.normal(0, eyes.headings_rad, size) if eyes.headings_rad else np.zeros(size)
        headings = tuple(
            float((dlps[at[i]][0] - frame_rad + noise[i] + math.pi) % (2 * math.pi) - math.pi)
            for i in range(size)
        )

    def move(k):
        return None if k is None else (k + shift) % size

    return Reading(Star(dlps_out), move(arrive), move(depart), weight, headings)


def _spoil(world, place, true, arrive, depart, rng):
    """A wrong star: an arm missing, an arm added, or a path that does not run straight through."""
    size = len(true)
    opposite = [world.opposite(place, k) for k in range(size)]
    used = {depart, None if arrive is None else opposite[arrive]}
    kinds = []
    kinds += [("flip", k) for k in range(size) if k not in used]
    kinds += [
        ("split", k)
        for k in range(size)
        if true[k][2] == "+" and true[k][3] == 1 and true[opposite[k]][3] == 1
    ]
    if not kinds:
        return None
    kind, k = kinds[int(rng.integers(len(kinds)))]
    dlps = [list(dlp) for dlp in true]
    if kind == "flip":
        dlps[k][3] = 1 - dlps[k][3]
        if any(dlp[3] for dlp in dlps):
            return dlps, arrive, depart
        return None
    return _split_path(dlps, k, opposite[k], arrive, depart)


def _split_path(dlps, k, far, arrive, depart):
    """Give each of two arms its own local-path, whose other end is a wall."""
    bend = 0.25
    marked = []
    for i, (bearing, name, direction, alpha) in enumerate(dlps):
        if i in (k, far):
            own = f"{name}{'x' if i == k else 'y'}"
            tilt = bend if i == k else -bend
            marked.append((bearing + tilt / 2, own, "+", 1, i, False))
            marked.append((bearing + math.pi + tilt / 2, own, "-", 0, i, True))
        else:
            marked.append((bearing, name, direction, alpha, i, False))
    marked.sort(key=lambda item: -((item[0] + 7.0) % (2 * math.pi)))
    out = [[b, n, d, a] for b, n, d, a, _, _ in marked]

    def find(i, wall):
        return next(p for p, item in enumerate(marked) if item[4] == i and item[5] == wall)

    def move_depart(i):
        return None if i is None else find(i, False)

    def move_arrive(i):
        # facing dlp i, the robot came in through the gateway of the opposite of i
        if i is None:
            return None
        if i == k:
            return find(far, True)
        if i == far:
            return find(k, True)
        return find(i, False)

    return out, move_arrive(arrive), move_depart(depart)


def blind(experience: Experience) -> Experience:
    """The experience without the alternatives: the word of the best stars is taken."""
    visits = tuple(
        replace(visit, readings=(replace(visit.readings[0], weight=1.0),))
        for visit in experience.visits
    )
    return replace(experience, visits=visits)


def find_first_clash(truth: Truth) -> int | None:
    """The first visit whose best star is not the one seen before at its place, None if none."""
    first: dict[int, int] = {}
    for v, place in enumerate(truth.places):
        before = truth.experience.visits[first.setdefault(place, v)].readings[0].star
        if not truth.experience.visits[v].readings[0].star.isomorphisms(before):
            return v
    return None
