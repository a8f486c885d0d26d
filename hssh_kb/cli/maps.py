"""``hssh maps``: ranked map hypotheses."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from hssh_kb.cli.basic_maps import run_basic_maps
from hssh_kb.cli.options import add_budget, add_input, parse_count
from hssh_kb.cli.output import (
    count_noun,
    format_table,
    print_json,
    show_progress,
    tell_notices,
    wrap_words,
)
from hssh_kb.cli.query import run_query
from hssh_kb.cli.variants import add_variant, refuse_variant, take_variant, use_directory
from hssh_kb.errors import UsageError
from hssh_kb.search_budget import allow_seconds, tell_seconds

if TYPE_CHECKING:
    from hssh_kb.change_of_mind import ChangeOfMind
    from hssh_kb.experience import Experience
    from hssh_kb.ranking import MapRow, RankedMaps

NAME = "maps"
HELP = "ranked map hypotheses of a knowledge base or a trace"
DESCRIPTION = """\
Rank the maps that are consistent with an experience. With displacements the posterior decides,
without them the fewest paths, then the fewest places. Ties are shown as ties.
A trace of kind "basic" (views and actions) gives the maps of the basic SSH.

--query asks a conjunction of a trace's consistent maps (at most 20,000 of them), of a knowledge
base's stored maps, or of those that --best, --minimal or --policy choose. Capital letters are
variables; P, V are numbers of visits, H paths, D plus or minus:
  visit(V) name(V,N) at(V,P) new(V) place(P) path(H) on(H,P) order(H,D,P,P2) places(N)
  neighbour(H,D,P,P2) dstate(Q,P) along(Q,H,D) alpha(Q,A) paths(N)"""
EXAMPLES = """\
  hssh maps office.hssh                        the ranked maps stored in a knowledge base
  hssh maps walk.json                          rank the maps of a trace
  hssh maps walk.json --all --json             every consistent map, as one document
  hssh maps walk.json --minimal subset         subset-minimal maps
  hssh maps office.hssh --best 3 -v            three maps, with the terms of their scores
  hssh maps walk.json --changes                which beliefs changed on the way, and why
  hssh maps walk.json --policy places-then-paths  fewest places first
  hssh maps walk.json --query 'at(V,P), on(H,P)'  what holds in every map, and in how many
  hssh maps walk.json --without 13             without the axiom that the way back leads back
  hssh maps walk.json --weaken 8=5             a circular path costs 5, and is not forbidden
  hssh maps walk.json --rules mine.lp          with an axiom of one's own
  hssh maps office.hssh --best 3 --query 'at(7,P)'  where visit 7 was, in the three best maps
"""
DEFAULT_BUDGET_S = 60.0
_COLUMNS = ("map", "rank", "places", "paths", "log posterior")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_input(parser)
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument("--all", action="store_true", help="every consistent map")
    amount.add_argument("--best", metavar="K", type=parse_count, help="the K best maps")
    parser.add_argument(
        "--minimal",
        choices=("cardinality", "subset"),
        help="let minimality decide, in this sense, even where there is metrical evidence",
    )
    parser.add_argument(
        "--policy",
        choices=("paths-then-places", "places-then-paths", "places-only"),
        help="let minimality decide, and make these few in this order (default: paths-then-places)",
    )
    parser.add_argument(
        "--query", metavar="ATOMS", help="what holds in the maps, as literals with commas between"
    )
    parser.add_argument("--no-planarity", action="store_true", help="allow paths to cross anywhere")
    parser.add_argument(
        "--no-path-types",
        action="store_true",
        help="leave aside the path types a trace may tell (as is done with displacements)",
    )
    parser.add_argument("--no-order", action="store_true", help="allow circular paths")
    parser.add_argument(
        "--changes",
        action="store_true",
        help="also how the favourite changed as the visits arrived one by one, and why",
    )
    add_variant(parser, weaken=True)
    add_budget(parser, None, told=tell_seconds())
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="also the terms of each score, and doubts"
    )


def run(args: argparse.Namespace) -> int:
    """Rank the maps and print them."""
    from hssh_kb.answers import document_maps
    from hssh_kb.basic import is_basic_trace
    from hssh_kb.experience import forget_types
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.ranking import rank_maps
    from hssh_kb.store import read_kb_or_trace

    if args.verbose and args.json:
        raise UsageError("-v has no effect with --json, which always holds the terms")
    if is_basic_trace(args.input):
        refuse_variant(args, "a basic trace, whose axioms are read from --axioms")
        use_directory(args)
        return run_basic_maps(args, args.budget or DEFAULT_BUDGET_S)
    variant = take_variant(args)
    asked = args.all or args.minimal or args.policy or args.no_planarity or args.no_order
    asked = asked or not variant.is_plain
    found = read_kb_or_trace(args.input)
    stored = found if isinstance(found, KnowledgeBase) else None
    experience = found.experience if isinstance(found, KnowledgeBase) else found
    tell_notices(() if stored else experience.notices)
    if args.no_path_types:
        if stored:
            raise UsageError("--no-path-types has no effect on maps that are stored; give a trace")
        found = experience = forget_types(experience)
    if args.query is not None:
        return run_query(args, found, args.budget or DEFAULT_BUDGET_S, variant)
    if stored and not asked and (not args.best or args.best <= len(stored.hypotheses)):
        if args.budget:
            raise UsageError("--budget has no effect: these maps are stored, nothing is searched")
        ranked = replace(stored.ranked, maps=stored.hypotheses[: args.best])
    else:
        with show_progress("ranking maps"):
            ranked = rank_maps(
                experience,
                every=args.all,
                best=args.best,
                minimal=args.minimal,
                planarity=not args.no_planarity,
                order=not args.no_order,
                budget_s=args.budget or allow_seconds(len(experience)),
                policy=args.policy,
                variant=variant,
            )
    if ranked.ranked_by == "posterior" and not variant.is_plain:
        tell_notices([variant.tell(probable=True)])
    changes = _find_changes(experience, ranked) if args.changes else None
    if args.json:
        print_json(document_maps(experience, ranked, changes))
    else:
        print(_format_maps(experience, ranked, verbose=args.verbose))
        if changes is not None:
            print("\n".join(["", *_format_changes(changes)]))
    if ranked.inconsistent_from is not None:
        return 1
    return 4 if ranked.budget_spent else 0


def _find_changes(experience: Experience, ranked: RankedMaps) -> Sequence[ChangeOfMind]:
    from hssh_kb.live_map import list_changes_of_mind

    if ranked.ranked_by != "posterior":
        raise UsageError("--changes needs displacements: without them all visits count at once")
    with show_progress("retracing the changes of mind"):
        return list_changes_of_mind(experience)


def _format_changes(changes: Sequence[ChangeOfMind]) -> list[str]:
    if not changes:
        return ["The favourite never changed: each best map grew out of the one before it."]
    return [line for change in changes for line in wrap_words(f"- {change.text}", 92)]


def _format_maps(experience: Experience, ranked: RankedMaps, *, verbose: bool) -> str:
    from hssh_kb.ranking import tabulate_maps

    rows = tabulate_maps(experience, ranked)
    lines = [*wrap_words(_summarise(experience, ranked, rows), 92), ""]
    shares = [f"{row.probability:.3f}" for row in rows if row.probability is not None]
    likely = len(shares) == len(rows)
    columns = [*_COLUMNS, *(["probability"] if likely else []), "place of each visit"]
    lines.append(
        format_table(
            columns,
            [
                [
                    str(row.number),
                    f"{row.rank}{'=' if row.tie > 1 else ' '}",
                    str(row.places),
                    str(row.paths),
                    _format_number(row.hypothesis.log_posterior),
                    *(shares[i : i + 1] if likely else []),
                    " ".join(f"P{place}" for place in row.hypothesis.visits),
                ]
                for i, row in enumerate(rows)
            ],
            left=frozenset({len(columns) - 1}),
        )
    )
    if verbose:
        lines += ["", *_format_terms(experience, rows)]
    return "\n".join(lines)


def _summarise(experience: Experience, ranked: RankedMaps, rows: Sequence[MapRow]) -> str:
    if ranked.inconsistent_from is not None:
        at = experience.visit_label(ranked.inconsistent_from)
        why = ranked.contradiction or "'hssh check' says why."
        text = (
            "No map is consistent with the whole experience: it contradicts itself from "
            f"{at} on. {why} These are maps of the visits before it."
        )
    else:
        if ranked.consistent is not None:
            text = f"{count_noun(ranked.consistent, 'consistent map')}; "
        else:
            text = "The consistent maps were not all counted; "
        text += f"{count_noun(len(rows), 'map')} shown. "
        text += _say_what_decided(ranked)
        text += f" {ranked.contradiction}" if ranked.contradiction else ""
    if rows and rows[0].tie > 1:
        text += f" The first {rows[0].tie} tie: nothing that was observed tells them apart."
    if ranked.budget_spent:
        text += " The budget was spent: this is a partial answer (--budget)."
    elif not ranked.proven:
        text += " The search ended without a proof that no other map is better."
    return text


def _say_what_decided(ranked: RankedMaps) -> str:
    if ranked.ranked_by == "posterior":
        return "Metrical evidence decided: the map with the highest posterior comes first."
    if ranked.minimality == "subset":
        return "Minimality decided: no map makes do with a part of the paths and places of these."
    told = {
        "places-then-paths": "the fewest places, then the fewest paths, come first",
        "places-only": "the fewest places come first",
    }
    if ranked.penalty is not None:
        return (
            f"Broken axioms cost {ranked.penalty} in each of these, and no map makes do with less; "
            "then minimality decided."
        )
    usual = "the fewest paths, then the fewest places, come first"
    return f"Minimality decided: {told.get(ranked.policy, usual)}."


def _format_number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _format_terms(experience: Experience, rows: Sequence[MapRow]) -> list[str]:
    lines = list[str]()
    names = sorted({name for row in rows for name in row.hypothesis.terms})
    if names:
        cells = [
            [str(row.number), *(_format_number(row.hypothesis.terms.get(name)) for name in names)]
            for row in rows
        ]
        lines += ["terms of the log posterior", format_table(["map", *names], cells)]
    else:
        lines.append("These maps have no metrical score, so there are no terms.")
    for row in rows:
        h = row.hypothesis
        other = [experience.visit_label(v) for v, reading in enumerate(h.readings) if reading]
        if other:
            lines.append(
                f"map {row.number} takes another reading of the star at {', '.join(other)}"
            )
        if h.doubted:
            told = ", ".join(f"v{v - 1}-v{v}" for v in h.doubted)
            lines.append(f"map {row.number} doubts that nothing was passed on the travel {told}")
    return lines
