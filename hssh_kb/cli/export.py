"""``hssh export``: the knowledge base in plain formats."""

from __future__ import annotations

import argparse
from pathlib import Path

from hssh_kb.cli.options import add_input
from hssh_kb.cli.output import print_json
from hssh_kb.errors import UsageError

NAME = "export"
HELP = "write plain files: JSON, logic program, ROS map"
DESCRIPTION = """\
Write the whole knowledge base (.json), its experience as facts for clingo (.lp), or the global
occupancy map with its ROS description (.pgm and .yaml). The ending of the name decides."""
EXAMPLES = """\
  hssh export office.hssh -o office.json
  hssh export office.hssh -o office.lp
  hssh export views.json -o views.lp               a basic trace: for axioms/basic_maps.lp
  hssh export office.hssh -o office.pgm            writes office.yaml too
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_input(parser)
    parser.add_argument(
        "-o", "--output", metavar="F.{json,lp,pgm}", required=True, help="the file to write"
    )


def run(args: argparse.Namespace) -> int:
    """Write the files and print their names."""
    from hssh_kb.basic import is_basic_trace, load_basic_trace, write_basic_instance
    from hssh_kb.cli.inputs import spare_inputs
    from hssh_kb.export import check_ending
    from hssh_kb.kb import KnowledgeBase
    from perception.atomic import write_atomically

    ending = check_ending(args.output)
    if is_basic_trace(args.input):
        if ending != ".lp":
            raise UsageError(
                f"{args.input} is a basic trace, of which there is only an .lp to write"
            )
        text = write_basic_instance(load_basic_trace(args.input))
        write_atomically(Path(args.output), text.encode())
        files = [args.output]
    else:
        kb = KnowledgeBase.open(args.input)
        written = {".pgm": (".pgm", ".yaml")}.get(ending, (ending,))
        for each in written:
            spare_inputs(Path(args.output).with_suffix(each), args.input, kb.record.source)
        files = [str(file) for file in kb.export(args.output)]
    if args.json:
        print_json({"schema": "hssh.export/1", "files": files})
    else:
        print("\n".join(files))
    return 0
