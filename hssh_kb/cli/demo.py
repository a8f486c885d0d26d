"""``hssh demo``: the main job on the bundled world."""

from __future__ import annotations

import argparse
from pathlib import Path

from hssh_kb.cli.output import print_json, show_progress, tell_notices

NAME = "demo"
HELP = "simulate a drive, build its map, ask it questions"
DESCRIPTION = """\
Simulate a robot with a lidar driving through the bundled office floor, write the drive as a
CARMEN log, build the knowledge base from that log alone, and put the three questions to it:
which maps, how to get there, and why not. The top map is compared with the world's own graph."""
EXAMPLES = """\
  hssh demo                          writes demo/
  hssh demo -o other --seed 3        another drive, elsewhere
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", default="demo", help="folder to write (default: demo)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of noise and drift (default: 0)")


def run(args: argparse.Namespace) -> int:
    """Run the demonstration."""
    from hssh_kb.demo import describe_demo, run_demo

    with show_progress("demo: a drive through the bundled office floor") as report:
        demo = run_demo(Path(args.output), seed=args.seed, progress=report)
    tell_notices(demo.kb.record.notices)
    if args.json:
        print_json(demo.document())
    else:
        print(describe_demo(demo))
    return 0 if demo.matches_truth else 1
