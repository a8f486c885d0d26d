"""The theory: speed beside a plain brute-force search, and how far minimal maps are proven.

Must: all maps of the 16-travel 3x3 trace in 10 ms, 50,000 maps a second, the best map of a
30-travel 4x4 trace in 1 s.
"""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hssh_kb.maps import enumerate_maps, minimal_maps

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import brute_force
import worlds

REACH_S = 30.0


def measure(task: Callable[[], Any], repeat: int = 5) -> tuple[float, Any]:
    """Return the least time of some runs, in seconds, and the answer."""
    best, answer = float("inf"), None
    for _ in range(repeat):
        start = time.perf_counter()
        answer = task()
        best = min(best, time.perf_counter() - start)
    return best, answer


def run() -> bool:
    """Print both tables; return whether all figures are reached."""
    good = [
        check_speed(),
        check_best(),
        check_reach(),
    ]
    return all(good)


def check_speed() -> bool:
    """Enumerate the reference traces: the tree, the programs, the brute-force twin."""
    print(f"\n{'trace':<34}{'maps':>7}{'tree ms':>9}{'maps/s':>9}{'programs':>10}{'twin ms':>9}")
    good = True
    cases = [
        ("grid-3x3-ltplus", {}, 0.010),
        ("block-2x2-plus", {}, None),
        ("block-2x2-plus", {"planarity": False}, None),
    ]
    for name, keywords, budget_s in cases:
        world, route = worlds.REFERENCES[name][:2]
        good &= _time_case(name, world.drive(route), keywords, budget_s)
    world = worlds.grid(3, 2, stubs=True)
    good &= _time_case("figure-8 of +, 12 travels", world.drive(worlds.FIGURE8), {}, None, 10_651)
    return good


def _time_case(
    name: str,
    experience: Any,
    keywords: dict[str, bool],
    budget_s: float | None,
    expected: int | None = None,
) -> bool:
    seconds, found = measure(lambda: enumerate_maps(experience, **keywords))
    count = len(found.maps)
    few = count < 2000
    repeat = 3 if few else 1
    program_s = (
        measure(lambda: enumerate_maps(experience, engine="program", **keywords), repeat)[0]
        if few
        else float("nan")
    )
    plain = brute_force.plain(experience)
    twin_s, twin = measure(lambda: brute_force.all_maps(plain, **keywords), 1)
    label = name + (" (no planarity)" if keywords else "")
    rate = count / seconds
    print(
        f"{label:<34}{count:>7}{1e3 * seconds:>9.1f}{rate:>9.0f}{1e3 * program_s:>10.1f}"
        f"{1e3 * twin_s:>9.1f}"
    )
    in_time = seconds <= budget_s if budget_s else rate >= 50_000
    return in_time and len(twin) == count and expected in (None, count)


def check_best() -> bool:
    """Find the best maps of a 30-travel walk over a 4x4 grid of L, T and +."""
    rows = [(x if y % 2 == 0 else 3 - x, y) for y in range(4) for x in range(4)]
    columns = [(x, y if x % 2 else 3 - y) for x in range(4) for y in range(4)]
    route = [*rows, *columns[1:]]
    experience = worlds.grid(4, 4).drive(route)
    seconds, found = measure(lambda: minimal_maps(experience), 2)
    print(
        f"\nbest of a {len(route) - 1}-travel 4x4 walk: {found.costs[0][:2]} (paths, places), "
        f"{len(found.maps)} tie, {seconds:.2f} s (must: 1 s; at least 49,000 consistent maps)"
    )
    return bool(seconds <= 1.0 and found.complete)


def check_reach() -> bool:
    """Find the minimal maps of long random walks over grids of L, T and +; none is known better."""
    print(f"\n{'walk':<22}{'travels':>8}{'proven':>8}{'paths':>7}{'places':>7}{'CPU s':>8}")
    proven = {4: 0, 5: 0}
    for side, travels in ((4, 30), (4, 45), (4, 60), (4, 80), (4, 100), (5, 24), (5, 30), (5, 36)):
        for seed in range(2):
            rng = random.Random(seed)
            world = worlds.grid(side, side)
            route = worlds.random_walk(rng, world, travels)
            experience = world.drive(route, [rng.randrange(4) for _ in route])
            start = time.process_time()
            found = minimal_maps(experience, budget_s=REACH_S)
            seconds = time.process_time() - start
            paths, places = found.costs[0][:2] if found.costs else ("-", "-")
            told = "yes" if found.complete else "no"
            label = f"{side}x{side} L/T/+, seed {seed}"
            print(f"{label:<22}{travels:>8}{told:>8}{paths:>7}{places:>7}{seconds:>8.2f}")
            if found.complete:
                proven[side] = max(proven[side], travels)
    print(f"proven within {REACH_S:g} s up to {proven[4]} travels on 4x4, {proven[5]} on 5x5")
    return proven[4] >= 60
