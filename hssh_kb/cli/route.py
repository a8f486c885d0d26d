"""``hssh route``: instructions from place to place."""

from __future__ import annotations

import argparse

from hssh_kb.cli.options import add_input, add_map
from hssh_kb.cli.output import print_json, tell_notices
from hssh_kb.errors import NoAnswerError

NAME = "route"
HELP = "route instructions from place to place"
DESCRIPTION = """\
Word the shortest travelled way between two places, the way people do: relative to where one
heads, silent where there is no choice, openings counted on the side one turns to."""
EXAMPLES = """\
  hssh route office.hssh P0 P7
  hssh route office.hssh "lift lobby" kitchen      names work where places have them
  hssh route office.hssh v3 v12 --map 2            on the second map, places given by visit
  hssh route office.hssh P0 P7 --json              typed steps beside the text
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_input(parser)
    parser.add_argument("start", metavar="FROM", help="a place: label (P3), visit (v7) or name")
    parser.add_argument("goal", metavar="TO", help="a place: label (P3), visit (v7) or name")
    add_map(parser)


def run(args: argparse.Namespace) -> int:
    """Find, word and print a route."""
    from hssh_kb.answers import document_no_route, document_route
    from hssh_kb.kb import KnowledgeBase

    kb = KnowledgeBase.open(args.input)
    tell_notices(kb.record.notices if not kb.record.scans else ())
    try:
        route = kb.route(args.start, args.goal, number=args.map)
    except NoAnswerError as error:
        if args.json:
            print_json(document_no_route(args.start, args.goal, str(error), args.map))
        else:
            print(f"{str(error)[0].upper()}{str(error)[1:]}.")
        return 1
    if args.json:
        print_json(document_route(route, args.map))
        return 0
    print(route.text)
    if route.maps > 1:
        print(f"({_tell_length(route.length_m)}holds in {route.holds_in} of {route.maps} maps)")
    elif route.length_m is not None:
        print(f"({_tell_length(route.length_m)[:-2]})")
    return 0


def _tell_length(length_m: float | None) -> str:
    return "" if length_m is None else f"{length_m:.0f} m; "
