"""Options of ``hssh build`` by the kind of input they have an effect on."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hssh_kb.cli.options import parse_metres, parse_point
from hssh_kb.errors import UsageError
from perception.files import looks_like_json
from perception.rosmap_kind import looks_like_ros_map

ENDINGS = frozenset((".yaml", ".yml", ".bag", ".mcap", ".db3"))
"""Endings of floor maps and bags, left out of the names of their knowledge bases."""

_OPTIONS = {
    "poses": ("poses", {"log", "bag"}),
    "doors": ("doors", {"log", "bag", "floor map"}),
    "min_gateway": ("min_gateway_m", {"log", "bag", "floor map"}),
    "resolution": ("resolution_m", {"log", "bag"}),
    "best": ("best", {"log", "bag", "trace"}),
    "budget": ("budget_s", {"log", "bag", "trace"}),
    "scan": ("scan_topic", {"bag"}),
    "odom": ("odom_topic", {"bag"}),
    "names": ("names", {"floor map"}),
    "start": ("start_m", {"floor map"}),
    "force": ("force", {"floor map"}),
}
"""By option: the keyword of ``build`` that takes it, and the inputs it has an effect on."""


def add_input_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that logs, bags and floor maps take."""
    parser.add_argument(
        "--doors",
        choices=("keep", "ignore"),
        help="whether doors and narrow openings count as ways (default: ignore, corridors only; "
        "for floor maps keep)",
    )
    parser.add_argument(
        "--min-gateway",
        metavar="M",
        type=parse_metres,
        help="gateways narrower than this (metres) count only where the robot drove through them; "
        "on floor maps they are closed",
    )
    parser.add_argument("--scan", metavar="TOPIC", help="laser scans of a bag, if it has several")
    parser.add_argument("--odom", metavar="TOPIC", help="odometry of a bag, if it has several")
    parser.add_argument(
        "--names", metavar="FILE", help="polygons of the rooms of a floor map, by name (yaml)"
    )
    parser.add_argument(
        "--start",
        metavar="X,Y",
        type=parse_point,
        help="a point (metres) of the part of a floor map to explore (default: the largest part); "
        "write --start=-3.5,12 if it begins with a minus",
    )
    parser.add_argument(
        "--force", action="store_true", help="read a floor map of more than 60 million cells too"
    )


def tell_kind(source: Path) -> str:
    """Tell by content what an input is: "trace", "floor map", "bag" or "log"."""
    from perception.bags import looks_like_bag

    if looks_like_bag(source):
        return "bag"
    if looks_like_json(source):
        return "trace"
    return "floor map" if looks_like_ros_map(source) else "log"


def gather_options(args: argparse.Namespace, source: Path) -> dict[str, Any]:
    """Return the keywords of ``build`` that were given.

    Raises
    ------
    UsageError : an option has no effect on this input.
    """
    kind = tell_kind(source)
    values = {name: getattr(args, name, None) for name in _OPTIONS}
    given = {name: value for name, value in values.items() if value not in (None, False)}
    idle = [f"--{name.replace('_', '-')}" for name in given if kind not in _OPTIONS[name][1]]
    if idle:
        raise UsageError(
            f"{source} is a {kind}, for which {' and '.join(idle)} would have no effect"
        )
    return {_OPTIONS[name][0]: value for name, value in given.items()}
