"""What the commands share: printing answers, notices, tables and progress."""

from __future__ import annotations

import contextlib
import json
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document to stdout."""
    print(json.dumps(document, allow_nan=False, default=_to_plain))


def _to_plain(value: Any) -> Any:  # noqa: ANN401
    """Turn numpy scalars and arrays, paths and tuples into what JSON knows."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return str(value)


def tell_error(text: str) -> None:
    """Print one sentence to stderr."""
    print(f"hssh: {' '.join(text.split())}", file=sys.stderr)


def tell_notices(notices: Iterable[str]) -> None:
    """Print remarks to stderr, one a line."""
    for notice in notices:
        print(f"note: {notice}", file=sys.stderr)


def count_noun(count: int, noun: str) -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> count_noun(1, "map"), count_noun(2, "map")
    ('1 map', '2 maps')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def format_table(
    header: Sequence[str], rows: Iterable[Sequence[str]], *, left: frozenset[int] = frozenset()
) -> str:
    """Return a plain table; columns are right-aligned unless in ``left``; the last one wraps.

    Examples
    --------
    >>> print(format_table(["n", "word"], [["1", "one"], ["10", "ten"]], left=frozenset({1})))
     n  word
     1  one
    10  ten
    """
    lines = [list(header), *map(list, rows)]
    widths = [max(len(line[c]) for line in lines) for c in range(len(header))]
    indent = sum(widths[:-1]) + 2 * (len(widths) - 1)
    room = max(shutil.get_terminal_size((100, 24)).columns - indent, 20)
    out = []
    for line in lines:
        cells = [
            cell.ljust(widths[c]) if c in left else cell.rjust(widths[c])
            for c, cell in enumerate(line[:-1])
        ]
        last = line[-1] if len(lines[0]) - 1 in left else line[-1].rjust(widths[-1])
        wrapped = wrap_words(last, room) if widths[-1] > room else [last]
        out.append("  ".join([*cells, wrapped[0]]).rstrip())
        out.extend(" " * indent + more for more in wrapped[1:])
    return "\n".join(out)


def wrap_words(text: str, width: int) -> list[str]:
    """Break a text at spaces into lines of at most ``width`` characters, longer words aside.

    Examples
    --------
    >>> wrap_words("one two three", 8)
    ['one two', 'three']
    """
    lines, line = list[str](), ""
    for word in text.split():
        longer = f"{line} {word}" if line else word
        if line and len(longer) > width:
            lines.append(line)
            line = word
        else:
            line = longer
    return [*lines, line]


Report = Callable[[str, int, int], None]


@contextlib.contextmanager
def show_progress(title: str) -> Iterator[Report]:
    """Give a function ``report(stage, done, in all)`` that draws bars if stderr is a terminal."""
    if not sys.stderr.isatty():
        yield lambda stage, done, total: None  # noqa: ARG005
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<12}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        tasks: dict[str, Any] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=max(total, 1))
            progress.update(tasks[stage], completed=done, total=max(total, 1))

        progress.console.print(title, highlight=False)
        yield report
