"""The search over the tree of maps at building and city size: real floor and street graphs.

Floors are navigation graphs of real buildings, the city is the street graph of lower and mid
Manhattan; both as symbolic worlds with true angles and lengths (streets may be walked both
ways; what cannot lie in the plane is left out, see tests/hssh_kb/street_worlds.py). Towns of as
many crossings, each another one made from its seed, show that nothing is tuned to one city.
"right": the partition of the visits into places is the true one. Noise is the standard deviation
of a displacement per axis as a fraction of the length of the corridor, with 0.01 rad of heading
noise a travel. CPU seconds; each walk of a city in a process of its own, for its memory.

``HSSH_CITY_SEEDS``, ``HSSH_CITY_TOWNS`` and ``HSSH_CITY_LONG`` (travels of the long walk; 0 for
none) make it shorter, ``HSSH_CITY_FLOORS=0`` leaves out the floors.
"""

import os
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from hssh_kb.live_map import LiveMap
from hssh_kb.map_tree import score_hypothesis
from hssh_kb.score import estimate_score
from hssh_kb.search import search_maps
from tests.bench.data import data_path
from tests.bench.pictures import FOLDER

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hssh_kb"))
from street_worlds import make_town, read_floor, read_manhattan
from symbolic_walks import Eyes, Truth, observe, walk_randomly

FLOORS = ("GDC3", "GDC2", "GDC1", "AHG1", "AHG2", "AHGM", "AHG_Apartment", "UT_Campus")
FLOOR_SEEDS = 5
CITY_TRAVELS = 2_000
LONG_TRAVELS = 20_000
LONG_S = 600.0
WORK_PER_ARRIVAL = 400
TOWNS, TOWN_CROSSINGS = 5, 1_500


def run() -> bool:
    """Print the tables; False if a figure is missed."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    fine = _count("FLOORS", 1) == 0 or _map_floors()
    fine = _map_city("town", None, _count("TOWNS", TOWNS)) and fine
    streets = data_path("graphs", "touchdown")
    if streets is None:
        return fine
    fine = _map_city("Manhattan", streets, _count("SEEDS", 10)) and fine
    long = _count("LONG", LONG_TRAVELS)
    return (not long or _walk_on(streets, long)) and fine


def _count(name: str, default: int) -> int:
    return int(os.environ.get(f"HSSH_CITY_{name}", default))


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


def _map_city(name: str, streets: Path | None, seeds: int) -> bool:
    """Walks of 2,000 travels, each mapped from the first visit to the last."""
    if not seeds:
        return True
    title = f"{name}, {CITY_TRAVELS:,} travels, .03"
    print(f"{title:<30} places found right  cpu s    MB  grown  score-truth")
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


def _map_one(task: tuple[Path | None, int]) -> tuple[int, int, bool, float, float, int, float]:
    streets, seed = task
    world = read_manhattan(streets) if streets else make_town(TOWN_CROSSINGS, seed)
    truth = _walk(world, CITY_TRAVELS, 0.03, seed)
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
    live = LiveMap(score=estimate_score(truth.experience), work_per_arrival=WORK_PER_ARRIVAL)
    taken_ms = np.zeros(len(truth.partition))
    for v, visit in enumerate(truth.experience.visits):
        start = time.process_time()
        live.arrive(visit)
        taken_ms[v] = 1e3 * (time.process_time() - start)
    total = taken_ms.sum() / 1e3
    mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    best = live.best()
    told = tell_likeness(best[0].visits, truth.partition) if best else "none"
    print(f"Manhattan, {travels:,} travels, visit by visit: {total:.0f} s (must: {LONG_S:.0f})")
    print(f"map: {told}; {mb:.0f} MB")
    tenths = np.array_split(taken_ms, 10)
    for k, part in enumerate(tenths):
        low, high = np.percentile(part, [50, 95])
        print(
            f"  tenth {k + 1:>2}: mean {part.mean():6.1f} ms an arrival, median {low:6.1f}, "
            f"95 % within {high:6.1f}"
        )
    plot_costs(taken_ms, truth)
    # The first fifth is spent in a town that is hardly known; from then on the cost may not grow.
    flat = tenths[-1].mean() <= 1.5 * np.mean(np.concatenate(tenths[2:5]))
    return bool(best) and total <= LONG_S and bool(flat)


def tell_likeness(found: tuple[int, ...], true: tuple[int, ...]) -> str:
    """Say how alike two partitions are: pairs of successive visits to one place that they share."""
    if found == true:
        return "right"
    pairs = [set(_pair_visits(one)) for one in (found, true)]
    shared = len(pairs[0] & pairs[1])
    return (
        f"not right; {shared / len(pairs[0]):.2%} of its closures are true, "
        f"{shared / len(pairs[1]):.2%} of the true ones found"
    )


def _pair_visits(partition: tuple[int, ...]) -> list[tuple[int, int]]:
    """Each visit with the one before it to the same place."""
    latest: dict[int, int] = {}
    pairs = []
    for v, first in enumerate(partition):
        if first in latest:
            pairs.append((latest[first], v))
        latest[first] = v
    return pairs


def plot_costs(taken_ms: np.ndarray, truth: Truth) -> None:
    """Plot what each arrival took, and block by block, on a logarithmic axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots()
    number = np.arange(len(taken_ms))
    axes.semilogy(number, np.maximum(taken_ms, 0.1), ".", ms=2, color="0.8", label="one arrival")
    width = max(len(taken_ms) // 40, 1)
    parts = [taken_ms[k : k + width] for k in range(0, len(taken_ms), width)]
    middle = [k * width + len(part) / 2 for k, part in enumerate(parts)]
    for told, style, value in (
        (f"mean of {width}", "C0-", np.mean),
        (f"median of {width}", "C1-", np.median),
    ):
        axes.semilogy(middle, [value(part) for part in parts], style, label=told)
    axes.set(xlabel="travels", ylabel="CPU per arrival [ms]", title="Manhattan, noise 0.03")
    places = axes.twinx()
    new = np.cumsum([first == v for v, first in enumerate(truth.partition)])
    places.plot(number, new[: len(number)], "C2--", label="places met")
    places.set_ylabel("places")
    figure.legend(loc="outside lower center", ncols=4)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / "city-cost-per-arrival.png", dpi=110)
    print(f"plotted in {FOLDER.relative_to(FOLDER.parents[1])}/city-cost-per-arrival.png")
