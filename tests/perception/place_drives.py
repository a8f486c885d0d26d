"""Drives through a place by each of its gateways, and what the place detector made of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.geometry import compose, wrap_angle
from perception.places import PlaceReading, PlaceSettings, PlaceVisit, detect_places
from perception.scanlog import ScanLog
from perception.simulate import Lidar, measure_scans
from tests.perception.corridor_worlds import CorridorWorld

STEP_M, STEP_RAD = 0.2, 0.15
BODY_M = 0.25
LIDAR = Lidar(fov_deg=180, beams=181, max_range_m=30.0)
DRIFT = (0.004, 0.004, 0.0015)
"""Error of the pose from one scan to the next, as scan matching leaves it."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One passage through a node: by which arm in, by which out, and the visits found there."""

    came: int
    went: int
    visits: tuple[PlaceVisit, ...]
    strays: tuple[PlaceVisit, ...]
    log: ScanLog
    poses: np.ndarray


def enter_by_all(
    world: CorridorWorld, node: int, settings: PlaceSettings, seed: int, *, look: bool = False
) -> list[Entry]:
    """Enter a place once by each of its arms, leaving by another; turn there once if asked to."""
    rng = np.random.default_rng([seed, node, 7])
    arms = world.arms(node)
    entries = []
    for came in range(len(arms)):
        others = [k for k in range(len(arms)) if k != came] or [came]
        went = int(rng.choice(others))
        truth = find_way(world, node, came, went, rng)
        if look:
            truth = look_around(truth, world.nodes[node])
        entries.append(enter(world, node, came, went, truth, settings, rng))
    return entries


def enter(
    world: CorridorWorld,
    node: int,
    came: int,
    went: int,
    truth: np.ndarray,
    settings: PlaceSettings,
    rng: np.random.Generator,
) -> Entry:
    """Drive along poses and look for places; sort the visits into those here and strays."""
    log = simulate(world.segments, truth, rng)
    poses = disturb(truth, rng)
    visits = detect_places(log, poses, settings)
    here, strays = [], []
    for visit in visits:
        # The drift is small beside the distances; the true centre follows from the nearest scan.
        at = truth[visit.scan, :2] + _turned(
            visit.centre_m - poses[visit.scan, :2], truth[visit.scan, 2] - poses[visit.scan, 2]
        )
        apart = np.hypot(*(world.nodes - at).T)
        k = int(np.argmin(apart))
        widest = max(way.width_m for _, way, _ in world.arms(k))
        reach = 0.8 + widest + (1.0 if len(world.arms(k)) == 1 else 0.0)
        if apart[k] > reach or not world.is_place(k):
            strays.append(visit)
        elif k == node:
            here.append(visit)
    return Entry(came, went, tuple(here), tuple(strays), log, poses)


def simulate(segments: np.ndarray, truth: np.ndarray, rng: np.random.Generator) -> ScanLog:
    """Return the scans of a drive."""
    ranges = measure_scans(segments, truth, LIDAR, rng)
    return ScanLog("entry", np.arange(len(truth)) * 0.3, ranges, LIDAR.angles_rad, truth=truth)


def disturb(truth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the poses as a localisation that drifts would have them."""
    c, s = np.cos(truth[:-1, 2]), np.sin(truth[:-1, 2])
    d = np.diff(truth[:, :2], axis=0)
    steps = np.column_stack(
        [c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], wrap_angle(np.diff(truth[:, 2]))]
    )
    steps += rng.normal(size=steps.shape) * DRIFT
    poses = [truth[0]]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def _turned(shift: np.ndarray, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * shift[0] - s * shift[1], s * shift[0] + c * shift[1]])


def drive_corridor(
    world: CorridorWorld, settings: PlaceSettings, seed: int
) -> tuple[float, tuple[PlaceVisit, ...], Entry]:
    """Drive along a corridor; return metres driven, and the visits where there is no place.

    Its ends are dead ends: what is found within reach of the laser's first and last look is none
    of the corridor.
    """
    rng = np.random.default_rng([seed, 11])
    truth = follow(world.nodes)
    truth = truth[np.hypot(*(truth[:, :2] - world.nodes[0]).T) > 2.0]
    truth = truth[np.hypot(*(truth[:, :2] - world.nodes[-1]).T) > 6.0]
    log, poses = simulate(world.segments, truth, rng), disturb(truth, rng)
    visits = detect_places(log, poses, settings)
    at = np.array([truth[v.scan, :2] for v in visits]).reshape(-1, 2)
    off = [np.hypot(*(at - world.nodes[end]).T) > 9.0 for end in (0, -1)]
    strays = tuple(v for v, near in zip(visits, off[0] & off[1], strict=True) if near)
    length = float(np.hypot(*np.diff(truth[:, :2], axis=0).T).sum())
    return length, strays, Entry(0, 0, (), strays, log, poses)


def find_way(
    world: CorridorWorld, node: int, came: int, went: int, rng: np.random.Generator
) -> np.ndarray:
    """Return poses (n, 3) through a node, off the middle as people drive, clear of everything."""
    arms = world.arms(node)
    sway = rng.uniform(-0.25, 0.25, 2)
    poses = np.zeros((0, 3))
    for tame in (1.0, 0.5, 0.0):
        ends = []
        for k, shift in ((came, sway[0]), (went, sway[1])):
            heading, way, far = arms[k]
            length = float(np.hypot(*(world.nodes[far] - world.nodes[node])))
            ends.append((heading, min(7.0, 0.75 * length), tame * shift * way.width_m))
        poses = _turn_round(world, node, ends) if came == went else _pass_through(world, node, ends)
        if clearance(world.segments, poses) > BODY_M:
            return poses
    return poses


def look_around(poses: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return poses with one turn on the spot where they come nearest to a point."""
    k = int(np.argmin(np.hypot(*(poses[:, :2] - at).T)))
    turn = np.linspace(0, 2 * math.pi, math.ceil(2 * math.pi / (2 * STEP_RAD)) + 1)
    spin = np.column_stack([np.repeat(poses[k : k + 1, :2], len(turn), axis=0), poses[k, 2] + turn])
    return np.vstack([poses[:k], spin, poses[k + 1 :]])


def _pass_through(
    world: CorridorWorld, node: int, ends: Sequence[tuple[float, float, float]]
) -> np.ndarray:
    (one, far_one, aside_one), (other, far_other, aside_other) = ends
    knee = world.nodes[node]
    u, v = (np.array([math.cos(t), math.sin(t)]) for t in (one, other))
    a = knee + far_one * u + aside_one * np.array([u[1], -u[0]])
    b = knee + far_other * v - aside_other * np.array([v[1], -v[0]])
    cut = 1.0
    s = np.linspace(0, 1, 12)[:, None]
    start, end = knee + cut * u, knee + cut * v
    start, end = start + 0.6 * (a - knee - far_one * u), end + 0.6 * (b - knee - far_other * v)
    curve = (1 - s) ** 2 * start + 2 * s * (1 - s) * knee + s**2 * end
    return follow(np.vstack([a, curve, b]))


def _turn_round(
    world: CorridorWorld, node: int, ends: Sequence[tuple[float, float, float]]
) -> np.ndarray:
    heading, far, aside = ends[0]
    u = np.array([math.cos(heading), math.sin(heading)])
    knee = world.nodes[node] + 0.9 * u
    normal = np.array([u[1], -u[0]])
    into = follow(np.array([knee + far * u + aside * normal, knee]))
    out = follow(np.array([knee, knee + far * u - aside * normal]))
    turn = into[-1, 2] + np.linspace(0, math.pi, math.ceil(math.pi / STEP_RAD))[1:]
    spin = np.column_stack([np.repeat(knee[None], len(turn), axis=0), turn])
    return np.vstack([into, spin, out])


def follow(points: np.ndarray) -> np.ndarray:
    """Return poses (n, 3) along a polyline, a scan's step apart, turning at its corners."""
    gaps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(gaps)])
    at = np.linspace(0, along[-1], max(math.ceil(along[-1] / STEP_M), 2))
    xy = np.column_stack([np.interp(at, along, points[:, k]) for k in (0, 1)])
    ahead = np.diff(xy, axis=0)
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    heading = np.concatenate([heading, heading[-1:]])
    poses = [np.array([*xy[0], heading[0]])]
    for k in range(1, len(xy)):
        turn = float(wrap_angle(heading[k] - poses[-1][2]))
        parts = np.linspace(0, turn, max(math.ceil(abs(turn) / STEP_RAD), 1) + 1)[1:]
        poses += [np.array([*xy[k], heading[k] - turn + part]) for part in parts]
    return np.array(poses)


def clearance(segments: np.ndarray, poses: np.ndarray) -> float:
    """Return how near a drive comes to a wall, metres."""
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    squared = np.maximum((along**2).sum(axis=1), 1e-12)
    to = poses[:, None, :2] - start[None]
    share = np.clip((to * along).sum(axis=2) / squared, 0, 1)
    return float(np.sqrt(((to - share[..., None] * along) ** 2).sum(axis=2)).min())


@dataclass(frozen=True)
class Verdict:
    """What became of the entries of one place.

    Attributes
    ----------
    entries : how often it was entered. found : seen once, and not more than once.
    same : with the star that most entries saw, the gateways in the same directions.
    second : with that star as one of the two best readings.
    true : with the arms that the world has. right_way : in and out by the right dlps.
    strays : visits where there is no place.
    """

    entries: int
    found: int
    same: int
    second: int
    true: int
    right_way: int
    strays: int


def judge(world: CorridorWorld, node: int, entries: Sequence[Entry]) -> Verdict:
    """Compare the stars of all entries with each other and with the world."""
    arms = np.array([heading for heading, _, _ in world.arms(node)])
    bests = [e.visits[0].readings[0] for e in entries if len(e.visits) == 1]
    votes = [sum(is_same(a, b) for b in bests) for a in bests]
    model = bests[int(np.argmax(votes))] if bests else None
    found = same = second = true = right = 0
    for entry in entries:
        if len(entry.visits) != 1 or model is None:
            continue
        found += 1
        readings = entry.visits[0].readings
        same += is_same(readings[0], model)
        second += any(is_same(r, model) for r in readings[:2])
        true += has_arms(readings[0], arms)
        right += goes_right(readings[0], arms, entry)
    strays = sum(len(e.strays) for e in entries)
    return Verdict(len(entries), found, same, second, true, right, strays)


def is_same(a: PlaceReading, b: PlaceReading, within_rad: float = 0.6) -> bool:
    """Tell whether two readings are one star with its gateways in the same directions."""
    size = len(a.star)
    open_ = np.array(a.star.alpha, bool)
    for r in a.star.isomorphisms(b.star):
        other = np.asarray(b.headings_rad)[(np.arange(size) + r) % size]
        if np.all(np.abs(wrap_angle(other - np.asarray(a.headings_rad)))[open_] < within_rad):
            return True
    return False


def has_arms(reading: PlaceReading, arms: np.ndarray, within_rad: float = 0.6) -> bool:
    """Tell whether a star has a gateway in the direction of each arm, and no other."""
    open_ = np.array(reading.star.alpha, bool)
    have = np.asarray(reading.headings_rad)[open_]
    if len(have) != len(arms):
        return False
    return any(
        np.all(np.abs(wrap_angle(have[list(order)] - arms)) < within_rad)
        for order in itertools.permutations(range(len(have)))
    )


def goes_right(reading: PlaceReading, arms: np.ndarray, entry: Entry) -> bool:
    """Tell whether the robot came and went by the dlps it did."""
    if reading.arrive is None or reading.depart is None:
        return False
    came = reading.headings_rad[reading.star.opposite(reading.arrive)]
    went = reading.headings_rad[reading.depart]
    off = (came - arms[entry.came], went - arms[entry.went])
    return bool(all(abs(wrap_angle(turn)) < 0.7 for turn in off))


def add(verdicts: Sequence[Verdict]) -> Verdict:
    """Return the sums."""
    total = Verdict(0, 0, 0, 0, 0, 0, 0)
    for one in verdicts:
        total = replace(
            total, **{name: getattr(total, name) + getattr(one, name) for name in vars(total)}
        )
    return total
