"""The same place entered by each of its gateways, and corridors without a place, in simulation.

Worlds are random: crossings of eleven kinds with arms of different widths (1.2 to 3 m), grids of
slanting corridors with holes, recessed doors, pillars, furniture, small rooms behind open doors.
Each place is entered once by each arm and left by another, with a lidar that sees a half circle,
and poses that drift as scan matching leaves them: without a stop, and with the one turn on the spot
that Beeson 2008, 5.3.2, lets a robot with such a lidar make. The published figure is his 360 places
without an error (with that turn).

A crossing whose arms continue each other by 28 to 52 degrees has no one right star: it is left out.
What fails are mostly arms that end within the local map: seen to its end, an arm is no way on.
Pictures of what failed are written to the folder HSSH_PICTURES, if it is set, else to a new one
among the temporary files.
"""

from __future__ import annotations

import itertools
import math
import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import cv2

from perception.places import PlaceSettings
from tests.perception.corridor_worlds import (
    RADIAL,
    CorridorWorld,
    draw_corridor,
    draw_grid,
    draw_radial,
)
from tests.perception.place_drives import (
    Verdict,
    add,
    drive_corridor,
    enter_by_all,
    has_arms,
    judge,
)
from tests.perception.place_pictures import draw_entries, draw_stray

SEEDS = 14
GRIDS = 8
CORRIDORS = 100
LEAST_PLACES = 200
SAME = 0.99
TABLES = (
    ("walls only", False, 0.0, True),
    ("walls only", False, 0.0, False),
    ("doors open, ignored", True, 1.05, True),
)
"""Rooms behind doors of 0.9 m or not, the narrowest gateway that counts, a turn on the spot or not.

The marks are those of the turn on the spot, which the published figure was reached with.
"""


def run() -> bool:
    """Print the tables; return whether every mark is reached."""
    cv2.setNumThreads(1)
    folder = Path(os.environ.get("HSSH_PICTURES") or tempfile.mkdtemp(prefix="places-"))
    folder.mkdir(parents=True, exist_ok=True)
    print(f"pictures of what failed: {folder}")
    print(
        f"{'':28}{'places':>7}{'entries':>8}{'once':>7}{'same':>7}{'2 best':>7}{'true':>7}"
        f"{'by which':>9}{'strays':>7}{'s':>6}"
    )
    good = True
    for name, rooms, narrowest, look in TABLES:
        settings = PlaceSettings(min_gateway_m=narrowest)
        told = f"{name}, {'turn' if look else 'no stop'}"
        reached = check_entries(told, rooms=rooms, look=look, settings=settings, folder=folder)
        good &= reached or not look
    return check_corridors(folder) and good


def check_entries(
    name: str, *, rooms: bool, look: bool, settings: PlaceSettings, folder: Path
) -> bool:
    """Enter every place by each of its gateways; tell whether the mark is reached."""
    start = time.perf_counter()
    work = partial(enter_world, rooms=rooms, look=look, settings=settings, folder=folder)
    by_kind: dict[str, list[Verdict]] = {}
    with ProcessPoolExecutor(2) as pool:
        for kind, verdicts in pool.map(work, list_worlds(SEEDS, GRIDS)):
            by_kind.setdefault(kind, []).extend(verdicts)
    for kind, verdicts in by_kind.items():
        print_line(f"  {kind}", verdicts)
    every = [v for verdicts in by_kind.values() for v in verdicts]
    total = add(every)
    print_line(name, every, time.perf_counter() - start)
    return total.same >= SAME * total.entries and len(every) >= LEAST_PLACES


def print_line(name: str, verdicts: list[Verdict], seconds: float | None = None) -> None:
    total = add(verdicts)
    n = max(total.entries, 1)
    shares = (total.found, total.same, total.second, total.true)
    print(
        f"{name:28}{len(verdicts):7}{total.entries:8}"
        + "".join(f"{share / n:7.3f}" for share in shares)
        + f"{total.right_way / n:9.3f}{total.strays:7}"
        + (f"{seconds:6.0f}" if seconds else ""),
        flush=True,
    )


def list_worlds(seeds: int, grids: int) -> list[tuple[str, int]]:
    """Return kind and seed of each world."""
    worlds = [(kind, seed) for kind in RADIAL for seed in range(seeds)]
    return worlds + [("grid", seed) for seed in range(grids)]


def enter_world(
    world: tuple[str, int], *, rooms: bool, look: bool, settings: PlaceSettings, folder: Path
) -> tuple[str, list[Verdict]]:
    """Return the verdicts on the places of one world."""
    kind, seed = world
    drawn = draw_grid(seed, rooms=rooms) if kind == "grid" else draw_radial(kind, seed, rooms=rooms)
    verdicts = []
    for node in list_places(drawn):
        entries = enter_by_all(drawn, node, settings, seed, look=look)
        verdict = judge(drawn, node, entries)
        verdicts.append(verdict)
        arms = [heading for heading, _, _ in drawn.arms(node)]
        bad = [
            e
            for e in entries
            if len(e.visits) != 1 or e.strays or not has_arms(e.visits[0].readings[0], arms)
        ]
        if bad and verdict.same + verdict.strays != verdict.entries:
            name = f"{kind}-{seed}-{node}{'-rooms' * rooms}{'-turn' * look}.png".replace(" ", "-")
            cv2.imwrite(str(folder / name), draw_entries(drawn, node, bad, settings))
    return kind, verdicts


def list_places(world: CorridorWorld) -> Iterator[int]:
    """Return the nodes that are places with one right star; of a lone crossing, that alone."""
    nodes: Iterable[int] = range(len(world.nodes)) if world.kind == "grid" else (0,)
    return (node for node in nodes if world.is_place(node) and not is_ambiguous(world, node))


def is_ambiguous(world: CorridorWorld, node: int) -> bool:
    """Tell whether two arms continue each other about as much as not."""
    headings = [heading for heading, _, _ in world.arms(node)]
    bends = [
        abs(math.degrees(math.remainder(a - b - math.pi, 2 * math.pi)))
        for a, b in itertools.combinations(headings, 2)
    ]
    return any(28 < bend < 52 for bend in bends)


def check_corridors(folder: Path) -> bool:
    """Drive ten kilometres of corridor without a place."""
    length, found = 0.0, 0
    with ProcessPoolExecutor(2) as pool:
        for metres, count in pool.map(partial(drive_one, folder=folder), range(CORRIDORS)):
            length, found = length + metres, found + count
    print(f"\ncorridors without a place: {length / 1000:.1f} km, places found: {found} (must: 0)")
    return found == 0


def drive_one(seed: int, folder: Path) -> tuple[float, int]:
    """Drive one corridor; return metres and how many places were found."""
    settings = PlaceSettings()
    world = draw_corridor(seed, 118.0)
    length, strays, entry = drive_corridor(world, settings, seed)
    if strays:
        cv2.imwrite(str(folder / f"corridor-{seed}.png"), draw_stray(world, entry, settings))
    return length, len(strays)
