"""Run all benchmarks, or those named: ``python -m tests.bench [NAME ...]``."""

from __future__ import annotations

import importlib
import sys
import time
from pathlib import Path


def main(names: list[str]) -> int:
    """Run the benchmarks and return 1 if any of them misses its figures."""
    here = Path(__file__).parent
    every = sorted(path.stem.removeprefix("bench_") for path in here.glob("bench_*.py"))
    unknown = [name for name in names if name not in every]
    if unknown:
        print(f"no benchmark is called {', '.join(unknown)}; there are: {', '.join(every)}")
        return 2
    missed = []
    for name in names or every:
        print(f"\n=== {name} " + "=" * max(3, 74 - len(name)), flush=True)
        start = time.perf_counter()
        if not importlib.import_module(f"tests.bench.bench_{name}").run():
            missed.append(name)
        print(f"({time.perf_counter() - start:.1f} s)", flush=True)
    print("\nmissed their figures: " + ", ".join(missed) if missed else "\nall figures reached")
    return 1 if missed else 0


sys.exit(main(sys.argv[1:]))
