"""The theory: reasons as brute force finds them, and speed beside a plain brute-force search.

Must: all maps of the 16-travel 3x3 trace in 10 ms, 50,000 maps a second, the best map of a
30-travel 4x4 trace in 1 s, a why-not on a 60-visit trace in 1 s.
"""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hssh_kb.check import check
from hssh_kb.maps import enumerate_maps, minimal_maps

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import brute_force
import test_why_not
import worlds

WHY_NOTS = 40
CONTRADICTIONS = 200


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
        check_conflicts(),
        check_speed(),
        check_best(),
        check_why_not(),
    ]
    return all(good)


def check_conflicts() -> bool:
    """Compare all minimal conflicts and repairs of random assumptions with brute force."""
    answers = []
    seed = 0
    while answers.count(True) < CONTRADICTIONS and False not in answers:
        answers.append(test_why_not.compare(seed))
        seed += 1
    print(
        f"{answers.count(True)} contradictory assumptions: {answers.count(False)} differ from "
        "brute force in conflicts or repairs (must: 0)"
    )
    return False not in answers


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


def check_why_not() -> bool:
    """Ask why-not about 60-visit walks: of pairs at random, and of several true pairs at once."""
    pairs: list[tuple[float, Any]] = []
    several: list[tuple[float, Any]] = []
    for seed in range(5, 9):
        rng = random.Random(seed)
        route = worlds.random_walk(rng, worlds.grid(5, 5), 59)
        world = worlds.grid(5, 5, stubs=seed % 2 == 0)
        experience = world.drive(route, [rng.randrange(4) for _ in route])
        true = [(v, w) for v in range(60) for w in range(v) if route[v] == route[w]]
        for i in range(WHY_NOTS):
            asked = [rng.sample(range(60), 2)] if i % 2 else rng.sample(true, 2 + i % 3)
            texts = [f"v{v}=v{w}" for v, w in asked]
            timed = measure(lambda e=experience, t=texts: check(e, t, budget_s=5.0), 1)
            (pairs if i % 2 else several).append(timed)
    # The budget of those that were not decided counts as their time.
    good = _tell_times("one pair supposed", pairs)
    _tell_times("2 to 4 true pairs supposed at once (no figure asked)", several)
    return good


def _tell_times(label: str, timed: list[tuple[float, Any]]) -> bool:
    times = sorted(seconds for seconds, _ in timed)
    statuses = [answer.status for _, answer in timed]
    empty = sum(not a.text or (not a.consistent and not a.violations) for _, a in timed)
    late = times[int(0.95 * len(times))]
    print(
        f"{len(times)} why-nots on 60 visits, {label}: {statuses.count('violated')} refused, "
        f"{statuses.count('budget spent')} budget spent, median {times[len(times) // 2]:.2f} s, "
        f"95th percentile {late:.2f} s (must: 1 s), worst {times[-1]:.2f} s, "
        f"{empty} without an answer (must: 0)"
    )
    return late <= 1.0 and empty == 0
