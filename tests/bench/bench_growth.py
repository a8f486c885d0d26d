"""Leaves, expansions and milliseconds per arrival against travels: exhaustive beside lazy.

The published form of this result (Johnson & Kuipers 2012): on a logarithmic axis, how the tree of
maps grows when every consistent map is kept up to date, and when only the promising ones are. The
exhaustive side ends once one arrival costs more than ``MOST_S``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.score import estimate_score
from hssh_kb.tree_search import TreeOfMaps
from tests.bench.bench_search import SMALL, Small
from tests.bench.pictures import FOLDER

from symbolic_walks import Eyes, follow_route, make_grid, observe, walk_randomly  # isort: skip

TRAVELS = 30
SIGMA = 0.05
MOST_S = 8.0
LEAST_GAIN = 100.0


@dataclass
class Growth:
    """What one way of searching costs at each arrival."""

    leaves: list[int] = field(default_factory=list)
    grown: list[int] = field(default_factory=list)
    spent_ms: list[float] = field(default_factory=list)


def run() -> bool:
    """Print the table and plot it; False if lazy search misses the truth or gains too little."""
    print(f"noise {SIGMA:g}: what the last arrival costs that all maps are kept up to")
    head = ("world", "travels", "maps", "grown: all", "lazy", "ms: all", "lazy", "right")
    print("{:<16} {:>8} {:>8} {:>11} {:>6} {:>9} {:>6} {:>6}".format(*head))
    fine, curves = True, {}
    for small in SMALL:
        every, lazy, right = _compare(small)
        curves[small.name] = every, lazy
        last = len(every.leaves) - 1
        gain = every.grown[last] / lazy.grown[last]
        ok = right and gain >= LEAST_GAIN
        fine = fine and ok
        print(
            f"{small.name:<16} {last:>8} {every.leaves[last]:>8} {every.grown[last]:>11} "
            f"{lazy.grown[last]:>6} {every.spent_ms[last]:>9.1f} {lazy.spent_ms[last]:>6.1f} "
            f"{right!s:>6}{'' if ok else '  MISSED'}",
            flush=True,
        )
    _plot(curves)
    return fine


def _compare(small: Small) -> tuple[Growth, Growth, bool]:
    rng = np.random.default_rng(0)
    world = make_grid(*small.size, stubs=small.stubs)
    if small.route:
        around = list(small.route[1:])
        walk = follow_route(world, [small.route[0], *(around * TRAVELS)[:TRAVELS]])
    else:
        walk = walk_randomly(world, TRAVELS, rng)
    truth = observe(world, walk, Eyes(sigma=SIGMA), rng)
    lazy, right = _grow(truth.experience, exhaustive=False, partition=truth.partition)
    every, _ = _grow(truth.experience, exhaustive=True, partition=truth.partition)
    return every, lazy, right


def _grow(
    experience: Experience, *, exhaustive: bool, partition: tuple[int, ...]
) -> tuple[Growth, bool]:
    tree, growth = TreeOfMaps(estimate_score(experience)), Growth()
    best: tuple[Hypothesis, ...] = ()
    for visit in experience.visits:
        start = time.process_time()
        tree.extend(visit)
        if exhaustive:
            best = tree.exhaust()
        else:
            tree.search()
            best = tree.best(1)
        spent_s = time.process_time() - start
        growth.leaves.append(len(best) if exhaustive else tree.leaves)
        growth.grown.append(tree.expansions)
        growth.spent_ms.append(1e3 * spent_s)
        if exhaustive and spent_s > MOST_S:
            break
    return growth, best[0].visits == partition


def _plot(curves: dict[str, tuple[Growth, Growth]]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.2), layout="constrained")
    columns = (
        ("leaves", "leaves of the tree"),
        ("grown", "maps grown so far"),
        ("spent_ms", "CPU per arrival [ms]"),
    )
    for axes, (name, label) in zip(figure.subplots(1, 3), columns, strict=True):
        for k, (world, pair) in enumerate(curves.items()):
            for growth, line, how in zip(pair, ("-", "--"), ("all maps", "lazy"), strict=True):
                values = np.maximum(getattr(growth, name), 0.1)
                axes.semilogy(values, f"C{k}{line}", label=f"{world}, {how}")
        axes.set(xlabel="travels", ylabel=label)
        axes.grid(alpha=0.3)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / "growth.png", dpi=110)
    print(f"plotted in {FOLDER.relative_to(FOLDER.parents[1])}/growth.png")
