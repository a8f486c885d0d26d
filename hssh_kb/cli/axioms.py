"""``hssh axioms``: each axiom with number, source, status and text."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from hssh_kb.cli.output import print_json, wrap_words

NAME = "axioms"
HELP = "the axioms: number, source, status, text"
DESCRIPTION = "Print the axioms that decide which maps are consistent."
EXAMPLES = """\
  hssh axioms                  all of them, in words
  hssh axioms --json           as one document
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no arguments of its own."""


def run(args: argparse.Namespace) -> int:
    """Print the axioms."""
    from hssh_kb.theory import axiom_directory, list_axioms

    axioms, directory = list_axioms(), axiom_directory()
    if args.json:
        items = [asdict(axiom) for axiom in axioms]
        print_json({"schema": "hssh.axioms/1", "directory": str(directory), "axioms": items})
        return 0
    for axiom in axioms:
        print(f"{axiom.number:>3}  {axiom.title}  [{axiom.name}]")
        for label, text in (
            ("", axiom.text),
            ("Source: ", axiom.source),
            ("Status: ", axiom.status),
        ):
            for line in wrap_words(label + text, 92):
                print(f"     {line}")
        print()
    print(f"The axioms as logic programs: {directory}")
    return 0
