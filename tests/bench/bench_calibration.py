"""Is a map that is given probability p right about a fraction p of the time?

Walks through simulated worlds at three noises. For the short walks every consistent map is grown,
so that the probabilities are those of the score alone; for the longer ones they are those of the
maps that the search found, as a user sees them. "right": the partition of the visits into places
is the true one. ECE: expected calibration error, the mean distance between probability and
frequency over bins of a tenth, weighted by how many maps are in each; maps given less than a
twentieth are left out, since their great number would make any score look calibrated. There
is no published figure: the trials before this project found a score "not calibrated", wrong in
6 of 6 on the worlds of identical places at noise 0.15 and 0.30.
"""

import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hssh_kb.score import estimate_score
from hssh_kb.search import search_maps
from hssh_kb.tree_search import TreeOfMaps

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hssh_kb"))
from symbolic_walks import Eyes, explore, make_grid, observe, walk_randomly

NOISES = (0.05, 0.15, 0.30)
SEEDS = 60
MOST_ECE = 0.10
LEAST_SHARE = 0.05
MOST_BEST_ECE = 0.15  # of the best maps alone: fewer, so noisier
PICTURE = Path("build/bench/calibration.png")


@dataclass(frozen=True)
class Family:
    """One kind of world and walk."""

    name: str
    size: int
    stubs: bool
    walk: Callable
    travels: int
    every: bool
    holes: float = 0.0
    jitter: float = 0.0


FAMILIES = (
    Family("3x3 L T +", 3, False, walk_randomly, 12, True),
    Family("3x3 of +", 3, True, walk_randomly, 9, True),
    Family("6x6 holes, jitter, exploring", 6, False, explore, 12, True, 0.3, 0.25),
    Family("4x4 L T +, searched", 4, False, walk_randomly, 30, False),
    Family("4x4 of +, searched", 4, True, walk_randomly, 30, False),
    Family("5x5 holes, jitter, searched", 5, False, explore, 40, False, 0.2, 0.2),
)


def run() -> bool:
    """Print the reliability table; False if the maps are over- or underrated."""
    shares, hits, tops, top_hits = [], [], [], []
    print(f"{'world, travels':36}{'noise':>6}{'maps':>6}{'ECE':>7}{'best: p':>9}{'right':>7}")
    tasks = [(f, s, seed) for f in range(len(FAMILIES)) for s in NOISES for seed in range(SEEDS)]
    with ProcessPoolExecutor(2) as pool:
        done = list(pool.map(_weigh_one, tasks, chunksize=SEEDS // 4))
    for k in range(0, len(tasks), SEEDS):
        family, noise = FAMILIES[tasks[k][0]], tasks[k][1]
        p = np.concatenate([one[0] for one in done[k : k + SEEDS]])
        right = np.concatenate([one[1] for one in done[k : k + SEEDS]])
        best = np.array([one[0][0] for one in done[k : k + SEEDS]])
        best_right = np.array([one[1][0] for one in done[k : k + SEEDS]])
        told = p >= LEAST_SHARE
        print(
            f"{family.name + ', ' + str(family.travels):36}{noise:6.2f}{len(p) / SEEDS:6.0f}"
            f"{rate_calibration(p[told], right[told]):7.3f}"
            f"{best.mean():9.2f}{best_right.mean():7.2f}"
        )
        shares.append(p)
        hits.append(right)
        tops.append(best)
        top_hits.append(best_right)
    p, right = np.concatenate(shares), np.concatenate(hits)
    best, best_right = np.concatenate(tops), np.concatenate(top_hits)
    _print_reliability(p, right)
    told = p >= LEAST_SHARE
    every, only = rate_calibration(p[told], right[told]), rate_calibration(best, best_right)
    print(
        f"ECE of the maps given {LEAST_SHARE} or more {every:.3f} (must: {MOST_ECE}), "
        f"of the best maps {only:.3f} (must: {MOST_BEST_ECE})"
    )
    _draw(p, right, best, best_right)
    return every <= MOST_ECE and only <= MOST_BEST_ECE


def _weigh_one(task: tuple[int, float, int]) -> tuple[np.ndarray, np.ndarray]:
    """Probability of each partition, best first, and whether it is the true one."""
    number, noise, seed = task
    family = FAMILIES[number]
    rng = np.random.default_rng(9000 + seed)
    world = make_grid(
        family.size,
        family.size,
        stubs=family.stubs,
        holes=family.holes,
        jitter=family.jitter,
        rng=rng,
    )
    truth = observe(world, family.walk(world, family.travels, rng), Eyes(sigma=noise), rng)
    if family.every:
        tree = TreeOfMaps(estimate_score(truth.experience), experience=truth.experience)
        maps = tree.exhaust()
    else:
        maps = search_maps(truth.experience, best=100).maps
    total: dict[tuple[int, ...], float] = {}
    for one in maps:
        total[one.visits] = np.logaddexp(total.get(one.visits, -np.inf), one.log_posterior)
    weights = np.array(list(total.values()))
    p = np.exp(weights - np.logaddexp.reduce(weights))
    order = np.argsort(-p, kind="stable")
    right = np.array([visits == truth.partition for visits in total])
    return p[order], right[order]


def rate_calibration(p: np.ndarray, right: np.ndarray) -> float:
    """Expected calibration error over ten bins of equal width."""
    bins = np.minimum((10 * p).astype(int), 9)
    gaps = [abs((p[bins == b] - right[bins == b]).sum()) for b in range(10)]
    return float(sum(gaps) / len(p))


def _print_reliability(p: np.ndarray, right: np.ndarray) -> None:
    bins = np.minimum((10 * p).astype(int), 9)
    print("\nprobability   maps   mean p   right")
    for b in range(10):
        held = bins == b
        if held.any():
            print(
                f"  {b / 10:.1f} - {(b + 1) / 10:.1f} {held.sum():6} {p[held].mean():8.3f} "
                f"{right[held].mean():7.3f}"
            )


def _draw(p, right, best, best_right) -> None:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        print("no picture: matplotlib is not installed (extra 'plot')")
        return
    figure = Figure(figsize=(5, 5), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for q, hit, name in ((p, right, "all maps"), (best, best_right, "best maps")):
        bins = np.minimum((10 * q).astype(int), 9)
        held = [b for b in range(10) if (bins == b).sum() >= 5]
        axes.plot(
            [q[bins == b].mean() for b in held],
            [hit[bins == b].mean() for b in held],
            "o-",
            label=name,
        )
    axes.set(
        xlabel="probability given to a map",
        ylabel="share of such maps that are right",
        xlim=(0, 1),
        ylim=(0, 1),
        title="Reliability of the map probabilities",
    )
    axes.legend()
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=150)
    print(f"reliability plot: {PICTURE}")
