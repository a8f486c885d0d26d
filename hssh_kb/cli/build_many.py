"""``hssh build`` with several inputs, or on a cluster."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from hssh_kb.build_many import BuildTask, Built, build_many
from hssh_kb.cli.build import check_target, name_output
from hssh_kb.cli.build_options import gather_options
from hssh_kb.cli.output import (
    count_noun,
    format_table,
    print_json,
    show_progress,
    tell_error,
    tell_notices,
)
from hssh_kb.errors import UsageError
from hssh_kb.executor import DASK, count_cores


def run_many(args: argparse.Namespace) -> int:
    """Build several inputs and print what became of each."""
    if args.executor and not args.executor.startswith(DASK):
        raise UsageError(f"there is no executor {args.executor!r}: use 'dask:ADDRESS'")
    if args.executor and args.jobs:
        raise UsageError("--jobs has no effect on a cluster, which has its own workers")
    tasks = _make_tasks(args)
    with show_progress(f"building {count_noun(len(tasks), 'knowledge base')}") as report:
        built = build_many(
            tasks,
            where=args.executor or "processes",
            jobs=args.jobs or count_cores(),
            report=report if sys.stderr.isatty() else None,
        )
    for one in built:
        if one.document is not None:
            tell_notices(f"{one.task.source}: {text}" for text in one.document["notices"])
    for one in built:
        if one.error is not None:
            tell_error(_name_fault(one))
    if args.json:
        print_json(_document_many(built))
    else:
        print("\n".join(_format_many(built)))
    return _choose_code(built)


def _make_tasks(args: argparse.Namespace) -> list[BuildTask]:
    """Return what to build; refuse now what would fail only after minutes of work."""
    sources = [Path(text) for text in args.input]
    if len(sources) > 1 and (not args.output or not Path(args.output).is_dir()):
        told = f"{args.output} is none" if args.output else "there is no -o"
        raise UsageError(
            f"{len(sources)} inputs need a folder that exists to write to, -o FOLDER; {told}"
        )
    if args.output and not Path(args.output).is_dir():
        targets = [Path(args.output)]
    else:
        targets = [Path(args.output or ".") / name_output(source) for source in sources]
    tasks = list[BuildTask]()
    for source, target in zip(sources, targets, strict=True):
        check_target(source, target)
        tasks.append(BuildTask(source, target, gather_options(args, source)))
    return tasks


def _name_fault(one: Built) -> str:
    """Return what went wrong with an input, naming it."""
    text = str(one.error)
    return text if str(one.task.source) in text else f"{one.task.source}: {text}"


def _document_many(built: Sequence[Built]) -> dict[str, object]:
    return {
        "schema": "hssh.builds/1",
        "builds": [one.document for one in built if one.document is not None],
        "faults": [
            {
                "input": str(one.task.source),
                "error": _name_fault(one),
                "exit_code": one.error.exit_code,
            }
            for one in built
            if one.error is not None
        ],
    }


def _format_many(built: Sequence[Built]) -> list[str]:
    rows = list[list[str]]()
    for one in built:
        if one.document is None:
            continue
        known = one.document
        remark = ""
        if known["inconsistent_from"] is not None:
            remark = f"no map holds from v{known['inconsistent_from']} on"
        elif known["budget_spent"]:
            remark = "the budget was spent: best maps so far"
        counts = [str(known[key]) for key in ("scans", "visits", "places", "paths", "maps")]
        seconds = f"{sum(known['seconds'].values()):.1f}"
        rows.append([known["kb"], *counts, seconds, remark])
    done = len(rows)
    lines = [f"{done} of {count_noun(len(built), 'knowledge base')} built"]
    if rows:
        header = ["written to", "scans", "visits", "places", "paths", "maps", "s", ""]
        lines.append(format_table(header, rows, left=frozenset({0, 7})))
    return lines


def _choose_code(built: Sequence[Built]) -> int:
    """Return the exit code: our own fault, then bad input, then no map, then a spent budget."""
    codes = {70 if one.error.exit_code == 70 else 3 for one in built if one.error is not None}
    documents = [one.document for one in built if one.document is not None]
    if any(document["inconsistent_from"] is not None for document in documents):
        codes.add(1)
    if any(document["budget_spent"] for document in documents):
        codes.add(4)
    return next((code for code in (70, 3, 1, 4) if code in codes), 0)
