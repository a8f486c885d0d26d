"""Benchmarks: each ``bench_NAME.py`` has ``run() -> bool``, prints a table, False on a miss."""
