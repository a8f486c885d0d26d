"""Options by which a user changes the axioms, shared by the commands that reason with them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from hssh_kb.cli.output import tell_notices
from hssh_kb.errors import UsageError

if TYPE_CHECKING:
    from hssh_kb.variant import Variant


def add_directory(parser: argparse._ActionsContainer) -> None:
    """Add the choice of a directory of axioms."""
    parser.add_argument(
        "--axioms",
        metavar="DIR",
        help="axiom files of your own, a copy changed (default: $HSSH_AXIOMS, else the packaged)",
    )


def add_variant(parser: argparse.ArgumentParser, *, weaken: bool) -> None:
    """Add the options that change the theory."""
    group = parser.add_argument_group("the theory")
    add_directory(group)
    group.add_argument(
        "--rules",
        metavar="FILE",
        action="append",
        default=[],
        help="rules of your own for violation(NAME,WITNESS); repeatable",
    )
    group.add_argument(
        "--without",
        metavar="AXIOM",
        action="append",
        default=[],
        help="switch an axiom off, by number or name ('hssh axioms'); repeatable",
    )
    if weaken:
        group.add_argument(
            "--weaken",
            metavar="AXIOM=COST",
            action="append",
            default=[],
            help="let an axiom be broken at a cost, least cost first; repeatable",
        )


def use_directory(args: argparse.Namespace) -> None:
    """Use the directory of axioms that was given, for this one command."""
    from hssh_kb.theory import use_axioms

    use_axioms(args.axioms)


def take_variant(args: argparse.Namespace, *, drawn: bool = False) -> Variant:
    """Return the theory that was asked for, and say in one line if it is not the packaged one.

    Parameters
    ----------
    args : the arguments of the command.
    drawn : whether a map drawn by hand is checked, which all axioms judge.
    """
    from hssh_kb.variant import read_variant

    use_directory(args)
    variant = read_variant(args.rules, args.without, getattr(args, "weaken", ()))
    if not drawn:
        variant.check_effect()
    told = "" if drawn else variant.tell()
    tell_notices([told] if told else [])
    return variant


def refuse_variant(args: argparse.Namespace, where: str) -> None:
    """Refuse the options where they have no effect.

    Raises
    ------
    UsageError : one was given.
    """
    for name in ("rules", "without", "weaken"):
        if getattr(args, name, None):
            raise UsageError(f"--{name} has no effect on {where}")
