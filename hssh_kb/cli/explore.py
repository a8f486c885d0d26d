"""``hssh explore``: where to go next to tell the rival maps apart."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from hssh_kb.cli.options import add_budget, add_input, parse_count
from hssh_kb.cli.output import print_json, show_progress, tell_notices, wrap_words
from hssh_kb.errors import NoAnswerError, UsageError

if TYPE_CHECKING:
    from hssh_kb.explore import Exploration, Suggestion

NAME = "explore"
HELP = "where to go next to tell rival maps apart"
DESCRIPTION = """\
Rank the ways to go next, unexplored or known, by how much what is seen there would tell the rival
maps apart: expected loss of entropy per length of the walk. Or follow one of two strategies of the
NX robot: its exploration agenda, or the rehearsal of a doubtful recognition."""
EXAMPLES = """\
  hssh explore office.hssh                          what would settle the doubt soonest
  hssh explore walk.json --all --best 3             weigh every consistent map, not only the best
  hssh explore office.hssh --strategy agenda        ways never taken, nearest first
  hssh explore office.hssh --strategy rehearsal     test the last doubtful recognition of a place
  hssh explore office.hssh --json
"""
DEFAULT_BUDGET_S = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_input(parser)
    parser.add_argument(
        "--strategy",
        choices=("entropy", "agenda", "rehearsal"),
        default="entropy",
        help="entropy (default): tell the maps apart; agenda: nearest unexplored way; "
        "rehearsal: known ways from a place that may not be the one it is taken for",
    )
    parser.add_argument(
        "--best", metavar="K", type=parse_count, default=5, help="how many to show (default: 5)"
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="weigh all consistent maps, not only those that 'hssh maps' ranks; either way by "
        "their posterior, or alike where nothing was measured",
    )
    add_budget(parser, None, told=f"{DEFAULT_BUDGET_S:g}, for --all")


def run(args: argparse.Namespace) -> int:
    """Find and print where to go next."""
    from hssh_kb.explore_document import document_exploration
    from hssh_kb.kb import KnowledgeBase

    if args.budget and not args.all:
        raise UsageError("--budget has no effect without --all: only then are maps looked for")
    kb = KnowledgeBase.open(args.input)
    tell_notices(kb.record.notices if not kb.record.scans else ())
    try:
        with show_progress("exploring"):
            found = kb.explore(
                args.strategy,
                best=args.best,
                every=args.all,
                budget_s=args.budget or DEFAULT_BUDGET_S,
            )
    except NoAnswerError as error:
        if args.json:
            print_json(_document_nothing(args.strategy, str(error)))
        else:
            print(f"{str(error)[0].upper()}{str(error)[1:]}.")
        return 1
    if args.json:
        print_json(document_exploration(found))
    else:
        print("\n".join(_format_exploration(found)))
    return 0


def _document_nothing(strategy: str, reason: str) -> dict[str, object]:
    return {
        "schema": "hssh.explore/1",
        "strategy": strategy,
        "informative": False,
        "found": 0,
        "text": None,
        "reason": reason,
        "suggestions": [],
    }


def _format_exploration(found: Exploration) -> list[str]:
    lines = wrap_words(found.text, 92)
    for one in found.suggestions:
        lines += ["", *_format_suggestion(found, one)]
    hidden = found.found - len(found.suggestions)
    if hidden:
        lines += ["", f"({hidden} more: --best {found.found})"]
    return lines


def _format_suggestion(found: Exploration, one: Suggestion) -> list[str]:
    mark = "=" if one.tie > 1 else "."
    told = [one.text]
    if one.route_text:
        told.append(f"How to get there: {one.route_text}")
    if len(found.weights) > 1:
        told.append(
            f"Doubt: {found.entropy_bits:.2f} bits now, {one.entropy_bits:.2f} expected after."
        )
        expects = "; ".join(group.text for group in one.expects)
        told.append(f"{expects[0].upper()}{expects[1:]}.")
    lines = list[str]()
    for text in told:
        lines += [f"   {line}" for line in wrap_words(text, 89)]
    lines[0] = f"{one.rank}{mark} {lines[0].strip()}"
    return lines
