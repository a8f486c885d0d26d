"""``hssh check``: axiom violations, and why not."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from hssh_kb.cli.options import add_budget, add_input, add_map
from hssh_kb.cli.output import print_json, show_progress, tell_notices, wrap_words
from hssh_kb.cli.reasons import (
    check_drawn_map,
    explain_atom,
    explain_new_place,
    is_drawn_map,
    tell_sides,
)
from hssh_kb.cli.variants import add_variant, take_variant
from hssh_kb.errors import UsageError

if TYPE_CHECKING:
    from hssh_kb.check import Check

NAME = "check"
HELP = 'axiom violations, and "why not?"'
DESCRIPTION = """\
Say whether a map exists for an experience, with assumptions if given: if not, which axioms are
violated, by which observations, and what could be dropped to mend it. Exit code 1 means no.

A map drawn by hand is checked as it is: JSON of schema hssh.map/1 (paths as lists of places,
stars, orders), or facts such as at(q,a). along(q,h,plus). on(h,a). --why takes an atom of one map:
  dstate(q(P,K)) at(Q,P) along(Q,H,D) on(H,P) order(H,D,P,P2) schema(Q,A,Q2)
with H = path(P,K), after its first place and the lesser of its two dlps there."""
EXAMPLES = """\
  hssh check office.hssh                       is the experience consistent at all?
  hssh check office.hssh --assume v7=v2        why are visits 7 and 2 not the same place?
  hssh check walk.json --assume v7!=v2         why are they?
  hssh check walk.json --assume v4=v0 --assume v5=v1 --json
  hssh check walk.json --claim maps.json --map 2  is the second map of this document possible?
  hssh check walk.json --sides                 what lies left and right of each path?
  hssh check office.hssh --why-new v9          why is visit 9 a new place?
  hssh check walk.json --why 'order(path(0,0),plus,0,2)'  why does this hold in the best map?
  hssh check drawn.json                        does a map drawn by hand violate an axiom?
  hssh check walk.json --assume v7=v2 --axioms mine/  the same under axioms of one's own
"""
DEFAULT_BUDGET_S = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_input(parser)
    parser.add_argument(
        "--assume",
        metavar="vI=vJ",
        action="append",
        default=[],
        help="assume that two visits were at one place (vI=vJ) or were not (vI!=vJ); repeatable",
    )
    parser.add_argument(
        "--claim",
        metavar="MAPS",
        help="assume a whole map: which visit is which place, as 'hssh maps --json' prints it",
    )
    parser.add_argument(
        "--sides",
        action="store_true",
        help="which places lie left and right of each path of a map, as far as was seen",
    )
    parser.add_argument("--why", metavar="ATOM", help="why this holds in a map: its derivation")
    parser.add_argument(
        "--why-new", metavar="vN", help="why this visit is a new place: what forbids each other"
    )
    add_map(parser)
    add_variant(parser, weaken=False)
    add_budget(parser, DEFAULT_BUDGET_S)


def run(args: argparse.Namespace) -> int:
    """Check and print the violations."""
    from hssh_kb.alternatives import find_standing
    from hssh_kb.answers import document_check
    from hssh_kb.check import check
    from hssh_kb.claims import check_claim, read_claim
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.store import read_kb_or_trace

    if is_drawn_map(args.input):
        return check_drawn_map(args, take_variant(args, drawn=True))
    variant = take_variant(args)
    asked = [args.assume, args.claim, args.why, args.why_new, args.sides]
    if sum(map(bool, asked)) > 1:
        raise UsageError("give only one of --assume, --claim, --why, --why-new and --sides")
    found = read_kb_or_trace(args.input)
    if isinstance(found, KnowledgeBase):
        experience = found.experience
    else:
        experience = found
        tell_notices(experience.notices)
    if args.why or args.why_new or args.sides:
        if not isinstance(found, KnowledgeBase):
            found = KnowledgeBase.from_experience(found, budget_s=args.budget, variant=variant)
        if args.sides:
            return tell_sides(args, found)
        return explain_atom(args, found) if args.why else explain_new_place(args, found, variant)
    with show_progress("checking"):
        if args.claim:
            claim = read_claim(args.claim, args.map)
            answer = check_claim(experience, claim, budget_s=args.budget, variant=variant)
        else:
            answer = check(
                experience, assumptions=args.assume, budget_s=args.budget, variant=variant
            )
    document, lines = document_check(answer), _format_check(answer)
    if isinstance(found, KnowledgeBase) and args.assume and found.hypotheses:
        standing = find_standing(found, args.assume)
        document["ranked"] = asdict(standing)
        if answer.consistent:
            lines += wrap_words(standing.text, 92)
    if args.json:
        print_json(document)
    else:
        print("\n".join(lines))
    if answer.status == "budget spent":
        return 4
    return 0 if answer.consistent else 1


def _format_check(answer: Check) -> list[str]:
    told = [violation.text for violation in answer.violations]
    lines = [] if answer.text in told else [*wrap_words(answer.text, 92), ""]
    for n, violation in enumerate(answer.violations, 1):
        lines += wrap_words(f"{n}. {violation.text}", 92)
        lines += [f"   {line}" for line in wrap_words(f"{violation.axiom}: {violation.source}", 88)]
        if violation.observations:
            lines.append(f"   observations that clash: {', '.join(violation.observations)}")
        lines.append("")
    if answer.repairs:
        lines += ["To mend it, any one of these would do:"]
        lines += [f"  - {'; and '.join(map(str, repair))}" for repair in answer.repairs]
    if answer.violations and not answer.complete:
        lines.append("There may be further reasons: they were not all looked for.")
    return lines[:-1] if lines[-1] == "" else lines
