"""Small knowledge bases, whole ones with every part filled, for the tests of what reads them."""

from __future__ import annotations

import itertools

import numpy as np
from symbolic_walks import Eyes, Truth, follow_route, make_grid, observe

from hssh_kb.hypothesis import Hypothesis
from hssh_kb.kb import KnowledgeBase
from hssh_kb.ranking import RankedMaps
from hssh_kb.records import BuildRecord, PlaceLayout, Raster, Trajectory
from perception.geometry import compose
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame

STEPS_A_TRAVEL = 8
SCALE_M = 5.0


def walk_true(width, height, cells, *, scale=SCALE_M, seed=0) -> Truth:
    """A walk seen without error, stars listed as the world lists them."""
    eyes = Eyes(sigma=1e-4, heading_rad=1e-4, turned=False, scale=scale)
    world = make_grid(width, height)
    return observe(world, follow_route(world, cells), eyes, np.random.default_rng(seed))


def true_map(truth: Truth) -> Hypothesis:
    return Hypothesis(
        truth.partition,
        (0,) * len(truth.partition),
        log_posterior=-3.5,
        terms={"layout": -2.0, "places": -1.5},
    )


def new_places_map(truth: Truth) -> Hypothesis:
    """The map in which every visit is a new place."""
    count = len(truth.partition)
    return Hypothesis(
        tuple(range(count)), (0,) * count, log_posterior=-9.25, terms={"layout": -1.0}
    )


FIGURE_8 = (0, 1, 2, 5, 4, 3, 0, 1, 4)


def make_kb(names=None, cells=FIGURE_8) -> KnowledgeBase:
    """A walk on a 3x2 grid with layout, drive, local maps and global map, all made by hand."""
    truth = walk_true(3, 2, list(cells))
    best = true_map(truth)
    visits = truth.experience.visits
    poses = [np.zeros(3)]
    for visit in visits[1:]:
        d = visit.displacement
        poses.append(compose(poses[-1], [d.x, d.y, d.theta]))
    poses = np.array(poses)
    drive = [poses[0]]
    for a, b in itertools.pairwise(poses):
        drive += [a + (b - a) * s for s in np.linspace(0, 1, STEPS_A_TRAVEL + 1)[1:]]
    drive = np.array(drive)
    layout = PlaceLayout(
        poses[list(best.places)], np.repeat(np.eye(3)[None] * 0.01, len(best.places), 0), 0.5
    )
    trajectory = Trajectory(
        drive,
        np.arange(len(drive)) * 0.5,
        np.arange(len(visits), dtype=np.int64) * STEPS_A_TRAVEL,
        odometry=drive + 0.1,
    )
    rng = np.random.default_rng(1)
    tiles = {
        v: Raster(
            rng.choice(np.array([OCCUPIED, UNKNOWN, FREE], np.uint8), (20, 30)),
            Frame(-1.5, 1.0, 0.1),
        )
        for v in range(len(visits))
    }
    return KnowledgeBase(
        truth.experience,
        RankedMaps((best, new_places_map(truth)), "posterior"),
        (layout, None),
        tiles,
        trajectory,
        draw_grid(poses),
        names or {},
        BuildRecord("drive.log", "0.1.0", len(drive), {"read": 0.25}, ("one note",), {"best": 2}),
    )


def draw_grid(poses) -> Raster:
    """A hand-drawn global map: free within 1.2 m of the drive, a wall around, the rest unknown."""
    low, high = poses[:, :2].min(0) - 4, poses[:, :2].max(0) + 4
    frame = Frame(float(low[0]), float(high[1]), 0.2)
    width, height = ((high - low) / frame.resolution_m).astype(int)
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    cells = frame.to_metres(np.stack([columns, rows], -1))
    away = np.full((height, width), np.inf)
    for a, b in itertools.pairwise(poses[:, :2]):
        for s in np.linspace(0, 1, 30):
            away = np.minimum(away, np.linalg.norm(cells - (a + s * (b - a)), axis=-1))
    image = np.full((height, width), UNKNOWN, np.uint8)
    image[away < 1.4] = OCCUPIED
    image[away < 1.2] = FREE
    return Raster(image, frame)
