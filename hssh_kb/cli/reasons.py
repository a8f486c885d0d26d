"""``hssh check``: maps drawn by hand, why something holds, and why a place is new."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from hssh_kb.cli.output import count_noun, print_json, show_progress, wrap_words
from hssh_kb.errors import UsageError

if TYPE_CHECKING:
    from hssh_kb.check import NewPlace
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.variant import Variant

_FACT = re.compile(r"(\s|%[^\n]*\n)*[a-z]\w*\(")
_MAP_SCHEMA = re.compile(r'"schema"\s*:\s*"hssh\.map/')


def is_drawn_map(path: str) -> bool:
    """Say by content whether a file is a map drawn by hand: ``hssh.map/1``, or facts."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    if text.lstrip("\ufeff \t\r\n").startswith("{"):
        return bool(_MAP_SCHEMA.search(text))
    return bool(_FACT.match(text.lstrip("\ufeff")))


def check_drawn_map(args: argparse.Namespace, variant: Variant) -> int:
    """Test a map drawn by hand and print what it violates."""
    from hssh_kb.finished import check_map
    from hssh_kb.theory_answers import document_finished

    if args.assume or args.why or args.why_new or args.claim or args.sides:
        raise UsageError(
            f"{args.input} is a map drawn by hand: --assume, --claim, --why, --why-new and --sides "
            "are about an experience"
        )
    findings = check_map(args.input, variant)
    if args.json:
        print_json(document_finished(args.input, findings))
        return 1 if findings else 0
    if not findings:
        print("The map violates no axiom.")
        return 0
    print(f"The map violates the axioms in {count_noun(len(findings), 'point')}:")
    for n, finding in enumerate(findings, 1):
        print("\n".join(wrap_words(f"{n}. {finding.text}", 92)))
        print(f"   {finding.axiom}: {finding.source}")
    return 1


def explain_atom(args: argparse.Namespace, kb: KnowledgeBase) -> int:
    """Print why an atom holds in a map."""
    from hssh_kb.theory_answers import document_why

    derivation = kb.explain(args.why, args.map)
    if args.json:
        print_json(document_why(derivation, args.map))
    else:
        print("\n".join(derivation.lines()))
    return 0


def tell_sides(args: argparse.Namespace, kb: KnowledgeBase) -> int:
    """Print which places lie left and right of each path of a map."""
    from hssh_kb.theory_answers import document_sides

    with show_progress("finding the sides of the paths"):
        boundaries = kb.sides(args.map, budget_s=args.budget)
    if args.json:
        print_json(document_sides(boundaries, args.map))
        return 0
    graph = kb.graph(args.map)

    def name(places: tuple[int, ...]) -> str:
        return ", ".join(graph.places[f"P{p}"].title for p in places) or "nothing"

    for one in boundaries:
        text = f"path({one.path[0]},{one.path[1]}) through {name(one.on)}: "
        text += f"left of it {name(one.left)}, right of it {name(one.right)}"
        if one.abnormal:
            text += f"; on no one side {name(one.abnormal)}"
        if not one.complete:
            text += "; not all choices were looked at, so the sides may be too large"
        print("\n".join(wrap_words(text + ".", 92)))
    return 0


def explain_new_place(args: argparse.Namespace, kb: KnowledgeBase, variant: Variant) -> int:
    """Print why a visit is a new place: what each earlier visit would violate."""
    from hssh_kb.alternatives import tell_possible
    from hssh_kb.theory_answers import document_new

    start = time.monotonic()
    with show_progress("checking"):
        answer = kb.explain_new(args.why_new, budget_s=args.budget, variant=variant)
    hypothesis = kb.hypothesis(args.map)
    is_new = answer.visit < len(hypothesis.visits) and (
        hypothesis.visits[answer.visit] == answer.visit
    )
    note = "" if is_new else _tell_place(kb, answer.visit, args.map)
    share = max(args.budget - (time.monotonic() - start), 1.0) / max(len(answer.earlier), 1)
    possible = {
        earlier: tell_possible(kb, answer.visit, earlier, args.map, budget_s=share)
        for earlier, check in answer.earlier
        if check.consistent
    }
    if args.json:
        document = document_new(answer, possible)
        print_json({**document, "map": args.map, "new_in_map": is_new})
    else:
        print("\n".join(_format_new(kb, answer, note, possible)))
    if not answer.complete:
        return 4
    return 0 if is_new else 1


def _tell_place(kb: KnowledgeBase, visit: int, number: int) -> str:
    visits = kb.hypothesis(number).visits
    label = kb.experience.visit_label(visit)
    if visit >= len(visits):
        return f"Map {number} does not reach {label}."
    return f"In map {number}, {label} is not new: it is at P{visits[visit]}."


def _format_new(
    kb: KnowledgeBase, answer: NewPlace, note: str, possible: Mapping[int, str]
) -> list[str]:
    lines = wrap_words(f"{note} {answer.text}".strip(), 92)
    if answer.earlier:
        lines.append("")
    for earlier, check in answer.earlier:
        label = kb.experience.visit_label(earlier)
        told = possible.get(earlier, check.text)
        first, *rest = wrap_words(f"{label}: {told}", 90)
        lines += [f"  {first}", *(f"    {line}" for line in rest)]
    return lines
