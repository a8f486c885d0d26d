"""``hssh show``: a picture of a map."""

from __future__ import annotations

import argparse

from hssh_kb.cli.options import add_input, add_map
from hssh_kb.cli.output import print_json

NAME = "show"
HELP = "draw a map as SVG or PNG"
DESCRIPTION = """\
Draw corridors, places with their stars, paths in colours with names, the drive, and a route."""
EXAMPLES = """\
  hssh show office.hssh -o office.svg
  hssh show office.hssh -o route.png --route P0 P7
  hssh show office.hssh -o second.svg --map 2
  hssh show walk.json -o walk.svg                 a trace without measurements is drawn as a graph
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_input(parser)
    parser.add_argument(
        "-o", "--output", metavar="F.{svg,png}", required=True, help="the picture to write"
    )
    parser.add_argument(
        "--route", nargs=2, metavar=("FROM", "TO"), help="also draw the route between two places"
    )
    add_map(parser)


def run(args: argparse.Namespace) -> int:
    """Draw the picture."""
    from hssh_kb.cli.inputs import spare_inputs
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.show import check_ending

    check_ending(args.output)
    kb = KnowledgeBase.open(args.input)
    spare_inputs(args.output, args.input, kb.record.source)
    route = (args.route[0], args.route[1]) if args.route else None
    kb.show(args.output, route=route, number=args.map)
    if args.json:
        print_json(
            {"schema": "hssh.show/1", "file": args.output, "map": args.map, "route": args.route}
        )
    else:
        print(args.output)
    return 0
