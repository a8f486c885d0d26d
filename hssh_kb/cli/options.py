"""Option types that several commands share."""

from __future__ import annotations

import argparse
import math


def add_input(parser: argparse.ArgumentParser) -> None:
    """Add the positional argument of commands that question a knowledge base."""
    parser.add_argument(
        "input",
        metavar="KB|TRACE",
        help="a knowledge base (.hssh) or a trace (JSON, hssh.trace/1); told apart by content",
    )


def add_map(parser: argparse.ArgumentParser) -> None:
    """Add the choice of one of the ranked maps."""
    parser.add_argument(
        "--map",
        metavar="N",
        type=parse_count,
        default=1,
        help="which of the ranked maps, by its number in 'hssh maps' (default: the first)",
    )


def add_budget(
    parser: argparse.ArgumentParser, default_s: float | None, *, told: str | None = None
) -> None:
    """Add the time budget; ``told`` is the default as the help text gives it."""
    told = told or f"{default_s:g}"
    parser.add_argument(
        "--budget",
        metavar="SECONDS",
        type=parse_seconds,
        default=default_s,
        help=f"when spent, the answer so far is printed, exit code 4 (default: {told})",
    )


def parse_count(text: str) -> int:
    """Read a whole number of at least 1."""
    try:
        count = int(text)
    except ValueError:
        count = 0
    if count < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return count


def parse_seconds(text: str) -> float:
    """Read a positive number of seconds."""
    return _parse_positive(text, "seconds")


def parse_metres(text: str) -> float:
    """Read a positive length in metres."""
    return _parse_positive(text, "metres")


def _parse_positive(text: str, unit: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of {unit}")
    return value


def parse_point(text: str) -> tuple[float, float]:
    """Read ``X,Y``."""
    parts = text.split(",")
    try:
        x, y = (float(part) for part in parts)
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a point X,Y")
    return x, y
