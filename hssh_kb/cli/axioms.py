"""``hssh axioms``: each axiom with number, source, status and text; glossary and policies."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from hssh_kb.cli.output import print_json, wrap_words
from hssh_kb.cli.variants import add_directory, use_directory

NAME = "axioms"
HELP = "the axioms: number, source, status, text; the glossary of predicates"
DESCRIPTION = "Print the axioms that decide which maps are consistent, and the preferences."
EXAMPLES = """\
  hssh axioms                  all of them, in words
  hssh axioms --glossary       what each predicate means, who derives and who reads it
  hssh axioms --json           as one document
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the choice of the glossary."""
    parser.add_argument(
        "--glossary", action="store_true", help="the predicates instead of the axioms"
    )
    add_directory(parser)


def run(args: argparse.Namespace) -> int:
    """Print the axioms, or the glossary."""
    from hssh_kb.glossary import list_predicates
    from hssh_kb.theory import axiom_directory, list_axioms, list_policies

    use_directory(args)
    directory = str(axiom_directory())
    if args.json:
        document = {
            "schema": "hssh.axioms/1",
            "directory": directory,
            "axioms": [asdict(axiom) for axiom in list_axioms()],
            "policies": list_policies(),
        }
        if args.glossary:
            document["predicates"] = [asdict(predicate) for predicate in list_predicates()]
        print_json(document)
    elif args.glossary:
        _print_glossary()
    else:
        _print_axioms()
        print(f"The axioms as logic programs: {directory}")
    return 0


def _print_axioms() -> None:
    from hssh_kb.theory import list_axioms, list_policies

    for axiom in list_axioms():
        print(f"{axiom.number:>3}  {axiom.title}  [{axiom.name}]")
        for label, text in (
            ("", axiom.text),
            ("Source: ", axiom.source),
            ("Status: ", axiom.status),
        ):
            for line in wrap_words(label + text, 92):
                print(f"     {line}")
        print()
    print("Which of the consistent maps are preferred (hssh maps --policy):")
    for name, text in list_policies().items():
        print(f"  {name:<18} {text}")
    print()


def _print_glossary() -> None:
    from hssh_kb.glossary import list_predicates

    print("Letters are sorts: V visit, P place, K dlp, O rotation, R reading, M size of a star,")
    print("A alpha or action, Q dstate, H path, D direction, T travel, I assumption or moment.\n")
    for predicate in list_predicates():
        print(predicate.atom)
        for line in wrap_words(predicate.meaning, 88):
            print(f"    {line}")
        derived, read = ", ".join(predicate.derived_by), ", ".join(predicate.read_by) or "nobody"
        for line in wrap_words(f"derived by: {derived}; read by: {read}", 88):
            print(f"    {line}")
