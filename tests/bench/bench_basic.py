"""Hybrid against basic SSH: how many maps the same drives leave open, and how fast that grows.

The sources give a bound, not a measurement: with m places of l dlps there are at most ml/2 travels
and ml turns, so a basic SSH that branches on each of the 3ml/2 actions has three times the exponent
of a hybrid one that branches on travels only. Here both are counted on random drives. A robot of
the basic SSH that is to know as much as a star says has to turn all around at each place ("looks
around"); one that turns only where it has to ("as driven") branches seldom, and knows less.
"""

from __future__ import annotations

import math
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hssh_kb.basic import enumerate_basic_maps, forget_stars
from hssh_kb.experience import Experience
from hssh_kb.maps import enumerate_maps

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import worlds

DRIVES, LONGEST, MOST_MAPS = 10, 14, 20_000
PUBLISHED = 3.0
Counter = Callable[[Experience], int | None]


def run() -> bool:
    """Print counts and exponents for two kinds of world; return whether the factor is reached."""
    good = True
    for label, stubs in (("stars as the world has them", False), ("crossings all alike", True)):
        good &= compare(label, stubs=stubs)
    return good


def count_hybrid(drive: Experience) -> int | None:
    """Return the number of maps of the hybrid SSH without planarity; None if too many."""
    found = enumerate_maps(drive, planarity=False, limit=MOST_MAPS)
    return len(found.maps) if found.complete else None


def count_basic(drive: Experience, *, look_around: bool) -> int | None:
    """Return the number of maps of the basic SSH on the same drive; None if too many."""
    basic = forget_stars(drive, look_around=look_around)
    found, complete = enumerate_basic_maps(basic, limit=MOST_MAPS)
    return len(found) if complete else None


def compare(label: str, *, stubs: bool) -> bool:
    """Count the maps of random drives as they grow, and fit the exponents."""
    rng = random.Random(7)
    drives = []
    for _ in range(DRIVES):
        world = worlds.random_world(rng, stubs=stubs)
        drives.append((world, worlds.random_walk(rng, world, LONGEST)))
    counters: dict[str, Counter] = {
        "hybrid": count_hybrid,
        "basic, as driven": lambda e: count_basic(e, look_around=False),
        "basic, looks around": lambda e: count_basic(e, look_around=True),
    }
    print(f"\n{label}: {DRIVES} random drives, geometric mean of the number of maps")
    print(f"{'travels':<22}" + "".join(f"{n:>9}" for n in range(1, LONGEST + 1)))
    slopes = {}
    for name, counter in counters.items():
        start = time.perf_counter()
        means = [mean for n in range(1, LONGEST + 1) if (mean := average(drives, n, counter))]
        told = "".join(f"{math.exp(mean):>9.1f}" for mean in means)
        slopes[name] = fit_exponent(means)
        print(
            f"{name:<22}{told}{'        -' * (LONGEST - len(means))}  "
            f"exponent {slopes[name]:.2f} a travel over {len(means)} lengths, "
            f"{time.perf_counter() - start:.1f} s"
        )
    ratio = slopes["basic, looks around"] / slopes["hybrid"]
    driven = slopes["basic, as driven"] / slopes["hybrid"]
    print(
        f"exponent of basic over hybrid: {ratio:.1f} looking around, {driven:.1f} as driven "
        f"(published: at least {PUBLISHED:g}, for the worst case; must: above {PUBLISHED:g} "
        "looking around)"
    )
    return ratio >= PUBLISHED


def average(
    drives: list[tuple[worlds.World, list[worlds.Cell]]], travels: int, counter: Counter
) -> float | None:
    """Return the mean of ln(maps) over the drives; None where one has too many to count."""
    logs = []
    for world, route in drives:
        count = counter(world.drive(route[: travels + 1]))
        if count is None:
            return None
        logs.append(math.log(count))
    return max(sum(logs) / len(logs), 1e-12)


def fit_exponent(means: list[float]) -> float:
    """Return the slope of ln(maps) over travels, by least squares."""
    travels = np.arange(1, len(means) + 1)
    return float(np.polyfit(travels, means, 1)[0])
