"""``hssh build``: a log, a bag, a floor map or a trace becomes a knowledge base."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from hssh_kb.cli.build_options import ENDINGS, add_input_options, gather_options, tell_kind
from hssh_kb.cli.options import add_budget, parse_count, parse_metres
from hssh_kb.cli.output import count_noun, print_json, show_progress, tell_notices
from hssh_kb.errors import InputError, UsageError
from hssh_kb.search_budget import tell_seconds

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase

NAME = "build"
HELP = "lidar logs, ROS bags, floor maps or traces become knowledge bases"
DESCRIPTION = """\
Read a CARMEN log (plain, gz, xz or bz2), a ROS bag, the yaml file of a ROS map, or a trace (JSON);
find places and paths, rank the maps, lay them out, and write one knowledge base file. A floor map
is explored by a virtual robot that knows where it is, so it has one map. Several inputs are built
in parallel, into a folder; one that fails does not stop the others."""
EXAMPLES = """\
  hssh build drive.log.xz                            writes drive.hssh
  hssh build drive.log.gz -o office.hssh --poses odometry
  hssh build drive.log --doors keep                  doors count as ways too
  hssh build drive.log --min-gateway 1.2             only what is wider counts
  hssh build walk.json -o walk.hssh --json
  hssh build office.yaml --names rooms.yaml          a ROS map; places are called by their rooms
  hssh build office.yaml --start=-3.5,12             the part of the floor that holds this point
  hssh build drive.bag --scan /base_scan             also ROS 2 bags, mcap and db3 files
  hssh build monday.log tuesday.log.xz -o maps/ --jobs 2
  hssh build *.log -o maps/ --executor dask:tcp://cluster:8786
"""
_ENDINGS = ENDINGS | {".log", ".clf", ".carmen", ".txt", ".json", ".gz", ".xz", ".bz2"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("input", metavar="INPUT", nargs="+", help="a log, bag, ROS map or trace")
    parser.add_argument(
        "-o",
        "--output",
        metavar="KB",
        help="the file to write (default: INPUT's name with .hssh); for several inputs a folder "
        "that exists",
    )
    parser.add_argument(
        "--poses",
        choices=("auto", "corrected", "odometry"),
        help="take the corrected poses some logs carry, or raw odometry and scan matching "
        "(default: auto, the corrected ones where there are any)",
    )
    parser.add_argument(
        "--best",
        metavar="K",
        type=parse_count,
        help="how many maps to keep (default: 5)",
    )
    parser.add_argument(
        "--resolution", metavar="M", type=parse_metres, help="cell of the global map (default: 0.1)"
    )
    parser.add_argument(
        "--jobs",
        metavar="N",
        type=parse_count,
        help="how many inputs to build at a time (default: as many as there are cores)",
    )
    parser.add_argument(
        "--executor",
        metavar="dask:ADDRESS",
        help="build on a Dask cluster instead; its workers have to see the same folders",
    )
    add_input_options(parser)
    add_budget(parser, None, told=tell_seconds())


def run(args: argparse.Namespace) -> int:
    """Build and save."""
    if len(args.input) > 1 or args.executor:
        from hssh_kb.cli.build_many import run_many

        return run_many(args)
    if args.jobs:
        raise UsageError("--jobs has no effect on a single input")
    return _run_one(args, Path(args.input[0]))


def _run_one(args: argparse.Namespace, source: Path) -> int:
    from hssh_kb.answers import document_build
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.store import is_knowledge_base
    from hssh_kb.variant import Variant

    target = Path(args.output) if args.output else Path(name_output(source))
    check_target(source, target)
    if tell_kind(source) != "bag" and is_knowledge_base(source):
        raise InputError(f"{source}: is a knowledge base already; 'hssh maps {source}' reads it")
    options = gather_options(args, source)
    with show_progress(f"building {target}") as report:
        kb = KnowledgeBase.build(source, progress=report, **options)
    told = Variant().tell(probable=kb.ranked_by == "posterior")
    tell_notices([*kb.record.notices, *([told] if told else [])])
    kb.save(target)
    if args.json:
        print_json(document_build(kb, str(target)))
    else:
        print(_format_build(kb, target))
    if kb.ranked.inconsistent_from is not None:
        return 1
    return 4 if kb.ranked.budget_spent else 0


def name_output(source: Path) -> str:
    """Return the default name of the knowledge base of an input.

    Examples
    --------
    >>> name_output(Path("logs/aces-corrected.log.xz")), name_output(Path("v1.2.json"))
    ('aces-corrected.hssh', 'v1.2.hssh')
    """
    name = Path(source.name)
    while name.suffix.lower() in _ENDINGS:
        name = name.with_suffix("")
    return f"{name}.hssh"


def check_target(source: Path, target: Path) -> None:
    """Refuse now what would fail only after minutes of work.

    Raises
    ------
    InputError : the target cannot be written. UsageError : it is the input.
    """
    if target.is_dir():
        raise InputError(f"{target}: is a directory; give the name of a file to write")
    if not target.parent.is_dir():
        raise InputError(f"{target.parent}: no such folder; make it first, or write elsewhere")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"{target.parent}: cannot be written to; write elsewhere with -o")
    if target.exists() and source.exists() and target.samefile(source):
        raise UsageError(f"{target}: is the input itself; choose another name with -o")


def _format_build(kb: KnowledgeBase, target: Path) -> str:
    lines = list[str]()
    record = kb.record
    if kb.trajectory is not None:
        length = f"{kb.trajectory.length_m:.0f} m"
        told = count_noun(record.scans, "scan") if record.scans else "explored by a virtual robot"
        lines.append(f"{told} over {length}")
    lines.append(f"{count_noun(len(kb.experience), 'visit')} to places")
    if kb.rows:
        best = kb.rows[0]
        told = f"{count_noun(best.places, 'place')} on {count_noun(best.paths, 'path')}"
        tie = f", tied with {best.tie - 1} more" if best.tie > 1 else ""
        lines.append(f"best of {count_noun(len(kb.rows), 'map')} kept: {told}{tie}")
    if kb.ranked.inconsistent_from is not None:
        at = kb.experience.visit_label(kb.ranked.inconsistent_from)
        lines.append(f"no map holds from {at} on; the maps are those of the visits before it")
    if kb.ranked.budget_spent:
        lines.append("the budget was spent: these are the best maps found so far (--budget)")
    seconds = record.seconds
    if seconds:
        spent = ", ".join(f"{stage} {value:.1f}" for stage, value in seconds.items())
        lines.append(f"{sum(seconds.values()):.1f} s ({spent})")
    lines.append(f"written to {target}")
    return "\n".join(lines)
