"""The search over the tree of maps at building and city size: real floor and street graphs.

Floors are navigation graphs of real buildings, the city is the street graph of lower and mid
Manhattan; both as symbolic worlds with true angles and lengths (streets may be walked both
ways; what cannot lie in the plane is left out, see tests/hssh_kb/street_worlds.py). "right": the
partition of the visits into places is the true one. Noise is the standard deviation of a
displacement per axis as a fraction of the length of the corridor, with 0.01 rad of heading noise
a travel. CPU seconds; each walk of the city in a process of its own, for its memory.

``HSSH_CITY_SEEDS`` and ``HSSH_CITY_LONG`` (travels of the long walk, 0 for none) make it shorter.
"""

import os
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from hssh_kb.map_tree import score_hypothesis
from hssh_kb.score import estimate_score
from hssh_kb.search import search_maps
from hssh_kb.tree_search import TreeOfMaps
from tests.bench.data import data_path
from tests.bench.pictures import FOLDER

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hssh_kb"))
from street_worlds import read_floor, read_manhattan
from symbolic_walks import Eyes, Truth, observe, walk_randomly

FLOORS = ("GDC3", "GDC2", "GDC1", "AHG1", "AHG2", "AHGM", "AHG_Apartment", "UT_Campus")
FLOOR_SEEDS = 5
CITY_TRAVELS = 2_000
LONG_TRAVELS = 20_000
LONG_S = 600.0
WORK_PER_ARRIVAL = 1_500


def run() -> bool:
    """Print the tables; False if a figure is missed."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    fine = _map_floors()
    streets = data_path("graphs", "touchdown")
    if streets is None:
        return fine
    fine = _map_city(streets, int(os.environ.get("HSSH_CITY_SEEDS", "10"))) and fine
    long = int(os.environ.get("HSSH_CITY_LONG", LONG_TRAVELS))
    return (not long or _walk_on(streets, long)) and fine


def _walk(world, travels: int, sigma: float, seed: int) -> Truth:
    rng = np.random.default_rng(seed)
    return observe(world, walk_randomly(world, travels, rng), Eyes(sigma=sigma), rng)


def _map_floors() -> bool:
    """200 travels on each floor, displacement noise 0.05."""
    folder = data_path("maps", "amrl")
    if folder is None:
        return True
    print(f"{'floor, 200 travels, .05':<28} {'places':>7} {'right':>7} {'cpu s':>7} {'max':>7}")
    hits = count = 0
    for name in FLOORS:
        world = read_floor(folder / f"{name}.navigation.json")
        right, seconds = 0, []
        for seed in range(FLOOR_SEEDS):
            truth = _walk(world, 200, 0.05, seed)
            start = time.process_time()
            found = search_maps(truth.experience)
            seconds.append(time.process_time() - start)
            right += found.inconsistent_from is None and found.maps[0].visits == truth.partition
        hits, count = hits + right, count + FLOOR_SEEDS
        print(
            f"{name:<28} {len(world.positions):>7} {right:>3} of {FLOOR_SEEDS:<3}"
            f"{np.median(seconds):>6.2f} {max(seconds):>7.2f}",
            flush=True,
        )
    print(f"{'all floors':<28} {hits / count:>15.0%} (must: 95 %)\n")
    return hits >= 0.95 * count


def _map_city(streets: Path, seeds: int) -> bool:
    """Walks of 2,000 travels through Manhattan, each mapped from the first visit to the last."""
    print(
        f"{'Manhattan, 2,000 travels, .03':<30} places found right  cpu s    MB  grown  score-truth"
    )
    tasks = [(streets, seed) for seed in range(seeds)]
    rows = []
    with ProcessPoolExecutor(2, max_tasks_per_child=1) as pool:
        for seed, row in enumerate(pool.map(_map_one, tasks)):
            rows.append(row)
            true, found, right, seconds, mb, grown, ahead = row
            print(
                f"{'seed ' + str(seed):<30} {true:>6} {found:>5} {'yes' if right else 'NO':>5} "
                f"{seconds:>6.1f} {mb:>5.0f} {grown:>6} {ahead:>+8.1f}",
                flush=True,
            )
    share = sum(row[2] for row in rows) / len(rows)
    seconds, mb = max(row[3] for row in rows), max(row[4] for row in rows)
    ok = share >= 0.8 and seconds <= 60 and mb <= 2048
    print(
        f"right {share:.0%} (must: 80 %), at most {seconds:.0f} s (60) and {mb:.0f} MB (2,048)"
        f"{'' if ok else '  MISSED'}\n"
    )
    return ok


def _map_one(task: tuple[Path, int]) -> tuple[int, int, bool, float, float, int, float]:
    streets, seed = task
    truth = _walk(read_manhattan(streets), CITY_TRAVELS, 0.03, seed)
    start = time.process_time()
    found = search_maps(truth.experience)
    seconds = time.process_time() - start
    mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    best = found.maps[0]
    right = found.inconsistent_from is None and best.visits == truth.partition
    ahead = 0.0
    if found.inconsistent_from is None and not right:
        true = score_hypothesis(
            truth.experience, truth.hypothesis(), estimate_score(truth.experience)
        )
        ahead = best.log_posterior - true.log_posterior
    places = len(set(truth.partition)), len(set(best.visits))
    return *places, right, seconds, mb, found.expansions, ahead


def _walk_on(streets: Path, travels: int) -> bool:
    """One long walk, visit by visit: what an arrival costs as the walk goes on."""
    truth = _walk(read_manhattan(streets), travels, 0.03, 0)
    tree = TreeOfMaps(estimate_score(truth.experience))
    spent_ms, grown = [], []
    for visit in truth.experience.visits:
        start = time.process_time()
        tree.extend(visit)
        tree.search(budget_work=WORK_PER_ARRIVAL)
        spent_ms.append(1e3 * (time.process_time() - start))
        grown.append(tree.expansions)
    total = sum(spent_ms) / 1e3
    mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    best = tree.best(1)
    right = bool(best) and best[0].visits == truth.partition
    print(f"Manhattan, {travels:,} travels, visit by visit: {total:.0f} s (must: {LONG_S:.0f})")
    print(f"right: {right}, {mb:.0f} MB, {tree.expansions} maps grown")
    tenths = np.array_split(np.array(spent_ms), 10)
    for k, part in enumerate(tenths):
        low, high = np.percentile(part, [50, 95])
        print(f"  tenth {k + 1:>2}: {low:6.1f} ms an arrival, 95 % within {high:6.1f} ms")
    _plot(np.array(spent_ms), truth)
    # The first tenth is spent in a town that is hardly known; from then on the cost may not grow.
    flat = np.mean(tenths[-1]) <= 1.5 * np.mean(np.concatenate(tenths[2:5]))
    return bool(best) and total <= LONG_S and bool(flat)


def _plot(spent_ms: np.ndarray, truth: Truth) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots()
    number = np.arange(len(spent_ms))
    axes.semilogy(number, np.maximum(spent_ms, 0.1), ".", ms=2, color="0.75", label="one arrival")
    width = max(len(spent_ms) // 50, 1)
    parts = [spent_ms[k : k + width] for k in range(0, len(spent_ms), width)]
    middle = [k * width + len(part) / 2 for k, part in enumerate(parts)]
    axes.semilogy(middle, [part.mean() for part in parts], "C0-", label=f"mean of {width}")
    axes.semilogy(middle, [np.percentile(p, 95) for p in parts], "C1-", label="95th percentile")
    axes.set(xlabel="travels", ylabel="CPU per arrival [ms]", title="Manhattan, noise 0.03")
    places = axes.twinx()
    new = np.cumsum([first == v for v, first in enumerate(truth.partition)])
    places.plot(number, new, "C2--", label="places met")
    places.set_ylabel("places")
    figure.legend(loc="outside lower center", ncols=4)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / "city-cost-per-arrival.png", dpi=110)
    print(f"plotted in {FOLDER.relative_to(FOLDER.parents[1])}/city-cost-per-arrival.png")
