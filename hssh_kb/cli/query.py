"""``hssh maps --query``: what holds in every map, in some, and in how many."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from hssh_kb.cli.output import count_noun, format_table, print_json, show_progress, wrap_words
from hssh_kb.errors import UsageError

if TYPE_CHECKING:
    from hssh_kb.experience import Experience
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.query import QueryAnswer
    from hssh_kb.variant import Variant


def run_query(
    args: argparse.Namespace,
    found: KnowledgeBase | Experience,
    budget_s: float,
    variant: Variant,
) -> int:
    """Ask the query of the maps that the other options choose, and print the answer."""
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.theory_answers import document_query

    if args.verbose:
        raise UsageError("-v has no effect with --query")
    chosen = args.best or args.minimal or args.policy or variant.weights
    stored = isinstance(found, KnowledgeBase)
    weaker = args.no_planarity or args.no_order or not variant.is_plain
    with show_progress("asking the maps"):
        if chosen or (stored and not args.all and not weaker):
            answer, asked_of = _ask_ranked(args, found, budget_s, variant)
        else:
            answer, asked_of = _ask_all(args, found, budget_s, variant), "all consistent maps"
    if args.json:
        print_json(document_query(args.query, answer, asked_of, complete=answer.complete))
    else:
        print(_format_query(answer, asked_of))
    if not answer.complete:
        return 4
    return 0 if answer.some else 1


def _ask_all(
    args: argparse.Namespace,
    found: KnowledgeBase | Experience,
    budget_s: float,
    variant: Variant,
) -> QueryAnswer:
    from hssh_kb.query import query_all_maps

    return query_all_maps(
        _experience_of(found),
        args.query,
        order=not args.no_order,
        planarity=not args.no_planarity,
        budget_s=budget_s,
        variant=variant,
    )


def _ask_ranked(
    args: argparse.Namespace,
    found: KnowledgeBase | Experience,
    budget_s: float,
    variant: Variant,
) -> tuple[QueryAnswer, str]:
    from dataclasses import replace

    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.query import query_maps
    from hssh_kb.ranking import rank_maps

    start = time.monotonic()
    stored = isinstance(found, KnowledgeBase) and not (args.minimal or args.policy)
    stored = stored and variant.is_plain
    if isinstance(found, KnowledgeBase) and stored and (args.best or 0) <= len(found.hypotheses):
        maps = found.hypotheses[: args.best]
        answer = query_maps(found.experience, maps, args.query, budget_s=budget_s)
        return answer, f"the {count_noun(len(maps), 'best map')} stored"
    ranked = rank_maps(
        _experience_of(found),
        best=args.best,
        minimal=args.minimal,
        policy=args.policy,
        planarity=not args.no_planarity,
        order=not args.no_order,
        budget_s=budget_s / 2,
        variant=variant,
    )
    rest = max(budget_s - (time.monotonic() - start), 0.0)
    answer = query_maps(_experience_of(found), ranked.maps, args.query, budget_s=rest)
    told = f"the {count_noun(len(ranked.maps), 'best map')}"
    return replace(answer, complete=answer.complete and not ranked.budget_spent), told


def _experience_of(found: KnowledgeBase | Experience) -> Experience:
    from hssh_kb.kb import KnowledgeBase

    return found.experience if isinstance(found, KnowledgeBase) else found


_ROW_LIMIT = 60


def _format_query(answer: QueryAnswer, asked_of: str) -> str:
    told = f"Asked of {asked_of}: {count_noun(answer.maps, 'map')}."
    if not answer.variables:
        told += f" It holds in {answer.some[0][1] if answer.some else 0} of them."
    elif answer.some:
        told += (
            f" {count_noun(len(answer.some), 'answer')}; {len(answer.every)} "
            f"hold{'s' * (len(answer.every) == 1)} in every map."
        )
    else:
        told += " No answer holds in any map."
    if not answer.complete:
        told += " The budget was spent before all maps were asked: this is a partial answer."
    lines = wrap_words(told, 92)
    if answer.variables and answer.some:
        rows = [
            [*instance, "every" if instance_count == answer.maps else str(instance_count)]
            for instance, instance_count in answer.some[:_ROW_LIMIT]
        ]
        lines += ["", format_table([*answer.variables, "maps"], rows)]
        if len(answer.some) > _ROW_LIMIT:
            lines.append(f"and {len(answer.some) - _ROW_LIMIT} more, which --json prints")
    return "\n".join(lines)
