"""The entry point: parse, run one command, turn every error into one sentence and a code."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import traceback
from collections.abc import Sequence

from hssh_kb.cli import axioms, build, check, demo, explore, export, maps, route, show, star
from hssh_kb.cli.output import tell_error
from hssh_kb.errors import HsshError

COMMANDS = (demo, build, star, maps, route, check, explore, show, export, axioms)

_EPILOG = """\
examples:
  hssh demo                                simulate a drive, build its map, ask it questions
  hssh build drive.log.xz -o office.hssh   a lidar log becomes a knowledge base
  hssh maps office.hssh                    its ranked maps
  hssh route office.hssh P0 P7             how to get there
  hssh check office.hssh --assume v7=v2    why are these two visits not one place?
  hssh explore office.hssh                 where to go next to tell rival maps apart

exit codes: 0 yes or found; 1 answered "no"; 2 wrong usage; 3 bad input;
            4 budget spent, partial answer printed; 70 a fault of this program
"""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="hssh",
        description="Topological maps from lidar logs: ranked hypotheses, routes, and reasons.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    _add_debug(parser, default=False)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for module in COMMANDS:
        command = commands.add_parser(
            module.NAME,
            help=module.HELP,
            description=module.DESCRIPTION,
            epilog=f"examples:\n{module.EXAMPLES}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        module.add_arguments(command)
        command.add_argument(
            "--json", action="store_true", help="print one JSON document with its schema"
        )
        _add_debug(command, default=argparse.SUPPRESS)
        command.set_defaults(run=module.run)
    return parser


def _add_debug(parser: argparse.ArgumentParser, *, default: bool | str) -> None:
    parser.add_argument(
        "--debug", action="store_true", default=default, help="show the traceback of an error"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; nothing is raised."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    try:
        return _run(arguments)
    except BrokenPipeError:
        # The reader of our answer went away, as `head` does: no fault of anyone.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (Exception, KeyboardInterrupt) as error:  # the last line of defence
        if debug:
            traceback.print_exception(error, file=sys.stderr)
        text, code = _describe_error(error)
        tell_error(text)
        return code


def _describe_error(error: BaseException) -> tuple[str, int]:
    """Return one sentence and the exit code."""
    if isinstance(error, HsshError):
        return str(error), error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return "interrupted; nothing was left half written", 130
    what = " ".join(str(error).split()) or "no message"
    return (
        f"this is a fault of hssh, not yours ({type(error).__name__}: {what}); "
        "please report it with the command and the output of --debug"
    ), 70


def _run(arguments: Sequence[str]) -> int:
    parser = make_parser()
    try:
        args = parser.parse_args(arguments)
    except SystemExit as stop:  # argparse has said what was wrong
        return int(stop.code or 0)
    if args.version:
        from hssh_kb.build import own_version

        print(f"hssh {own_version()}")
        return 0
    if args.command is None:
        parser.print_usage(sys.stderr)
        tell_error("which command? 'hssh --help' lists them")
        return 2
    code = int(args.run(args))
    sys.stdout.flush()
    return code


def main_and_exit() -> None:
    """Run the command line and leave the process with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")
    sys.exit(main())
