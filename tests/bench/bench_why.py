"""Why-not: reasons as brute force finds them, and answers about 60 visits.

Must: minimal conflicts and repairs of 200 contradictory assumptions equal brute force; a why-not
on a 60-visit trace in 1 s of CPU, whatever is supposed, with an answer each time.
"""

from __future__ import annotations

import random
import sys
import time
from pathlib import Path
from typing import Any

from hssh_kb.check import check

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import test_planar_why_not
import test_why_not
import worlds

CONTRADICTIONS, SEVERAL, PLANAR_SEEDS = 200, 40, 60
WALKS, QUESTIONS, VISITS = 4, 40, 60


def run() -> bool:
    """Print the tables; return whether all figures are reached."""
    good = [
        check_conflicts(CONTRADICTIONS, 1, 2),
        check_conflicts(SEVERAL, 3, 4),
        check_planarity(),
        check_long(readings=False),
        check_long(readings=True),
    ]
    return all(good)


def check_conflicts(count: int, fewest: int, most: int) -> bool:
    """Compare all minimal conflicts and repairs of random assumptions with brute force."""
    answers = []
    seed = 0
    while answers.count(True) < count and False not in answers:
        answers.append(test_why_not.compare(seed, fewest, most))
        seed += 1
    print(
        f"{answers.count(True)} contradictory sets of {fewest} to {most} assumptions: "
        f"{answers.count(False)} differ from brute force in conflicts or repairs (must: 0)"
    )
    return False not in answers


def check_planarity() -> bool:
    """Compare with brute force where only planarity stands against assumptions."""
    asked = [test_planar_why_not.compare(seed) for seed in range(PLANAR_SEEDS)]
    wrong, refused = (sum(column) for column in zip(*asked, strict=True))
    print(
        f"{refused} refusals by planarity alone: {wrong} answers differ from brute force (must: 0)"
    )
    return wrong == 0


def check_long(*, readings: bool) -> bool:
    """Ask about walks of 60 visits: pairs at random, true pairs at once, and mixed ones."""
    timed: dict[str, list[tuple[float, Any]]] = {}
    for seed in range(5, 5 + WALKS):
        rng = random.Random(seed)
        route = worlds.random_walk(rng, worlds.grid(5, 5), VISITS - 1)
        world = worlds.grid(5, 5, stubs=seed % 2 == 0)
        experience = world.drive(route, [rng.randrange(4) for _ in route])
        if readings:
            experience = worlds.with_alternatives(rng, experience)
        true = [(v, w) for v in range(VISITS) for w in range(v) if route[v] == route[w]]
        for i in range(QUESTIONS):
            kind, texts = _ask(rng, i, true)
            start = time.process_time()
            answer = check(experience, texts, budget_s=20.0)
            timed.setdefault(kind, []).append((time.process_time() - start, answer))
    label = ", alternative readings" if readings else ""
    good = [_tell_times(kind + label, some) for kind, some in timed.items()]
    return all(good)


def _ask(rng: random.Random, i: int, true: list[tuple[int, int]]) -> tuple[str, list[str]]:
    if i % 2:
        v, w = rng.sample(range(VISITS), 2)
        return "one pair", [f"v{v}=v{w}"]
    given = [(*pair, True) for pair in rng.sample(true, 2 + i % 3)]
    if i % 4:
        return "2 to 4 true pairs", [f"v{v}=v{w}" for v, w, _ in given]
    given[2:] = [(*rng.sample(range(VISITS), 2), rng.random() < 0.5) for _ in range(2)]
    return "2 true pairs, 2 at random", [f"v{v}{'=' if s else '!='}v{w}" for v, w, s in given]


def _tell_times(label: str, timed: list[tuple[float, Any]]) -> bool:
    times = sorted(seconds for seconds, _ in timed)
    statuses = [answer.status for _, answer in timed]
    spent = statuses.count("budget spent") + statuses.count("unsatisfiable")
    print(
        f"{len(times)} why-nots on {VISITS} visits, {label}: {statuses.count('violated')} refused, "
        f"median {times[len(times) // 2]:.3f} s CPU, worst {times[-1]:.2f} s (must: 1 s), "
        f"{spent} undecided or unexplained (must: 0)"
    )
    return times[-1] <= 1.0 and not spent
