"""``hssh maps`` on a trace of the basic SSH: views and actions instead of stars."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from hssh_kb.cli.output import count_noun, format_table, print_json, show_progress, wrap_words
from hssh_kb.errors import UsageError

if TYPE_CHECKING:
    from hssh_kb.basic import BasicMap


def run_basic_maps(args: argparse.Namespace, budget_s: float) -> int:
    """Find the maps of a basic trace, fewest paths and places first, and print them."""
    from hssh_kb.basic import describe_basic_map, enumerate_basic_maps, load_basic_trace
    from hssh_kb.ranking import DEFAULT_POLICY, order_sizes
    from hssh_kb.theory_answers import document_basic_maps

    _refuse(args)
    experience = load_basic_trace(args.input)
    policy = args.policy or DEFAULT_POLICY
    with show_progress("finding maps"):
        found, complete = enumerate_basic_maps(
            experience, order=not args.no_order, limit=_MAP_LIMIT, budget_s=budget_s
        )
    maps = sorted(
        (describe_basic_map(experience, dstates) for dstates in found),
        key=lambda m: (order_sizes(m.size[0], m.size[1], policy), m.dstates),
    )
    shown = maps
    if args.best:
        shown = maps[: args.best]
    elif not args.all and maps:
        least = order_sizes(maps[0].size[0], maps[0].size[1], policy)
        shown = [m for m in maps if order_sizes(m.size[0], m.size[1], policy) == least]
    if args.json:
        print_json(document_basic_maps(experience, shown, len(maps), policy, complete=complete))
    else:
        print(_format_maps(shown, len(maps), complete=complete))
    if not complete:
        return 4
    return 0 if maps else 1


_MAP_LIMIT = 100_000


def _refuse(args: argparse.Namespace) -> None:
    given = {
        "--query": args.query is not None,
        "--minimal": bool(args.minimal),
        "--no-planarity": args.no_planarity,
        "-v": args.verbose,
    }
    for name in (name for name, there in given.items() if there):
        raise UsageError(f"{args.input} is a basic trace, for which {name} would have no meaning")


def _format_maps(shown: list[BasicMap], consistent: int, *, complete: bool) -> str:
    if not consistent and complete:
        return "No map is consistent with these views and actions."
    told = f"{count_noun(consistent, 'consistent map')} of the basic SSH; {len(shown)} shown."
    if not complete:
        told = (
            f"{count_noun(consistent, 'map')} of the basic SSH found before the budget was spent; "
            f"{len(shown)} shown."
        )
    rows = [
        [
            str(number),
            str(one.size[1]),
            str(one.size[0]),
            " ".join(
                f"P{p}:H{path}{'+' if forth else '-'}"
                for p, (path, forth) in zip(one.places, one.paths, strict=True)
            ),
        ]
        for number, one in enumerate(shown, 1)
    ]
    header = ["map", "places", "paths", "place and directed path of each moment"]
    table = format_table(header, rows, left=frozenset({3}))
    return "\n".join([*wrap_words(told, 92), "", table])
