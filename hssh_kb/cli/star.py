"""``hssh star``: gateways and star of grid images."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hssh_kb.cli.options import parse_metres, parse_point
from hssh_kb.cli.output import count_noun, print_json
from hssh_kb.errors import InputError, UsageError

NAME = "star"
HELP = "gateways and star of grid images"
DESCRIPTION = """\
Find the ways that lead out of the surroundings of the robot and the star they form. Dark is
occupied, light is free, middle grey is unknown; the robot stands in the middle unless told."""
EXAMPLES = """\
  hssh star crossing.png
  hssh star crossing.pgm --resolution 0.05 --robot 150,140 --robot-radius 0.3
  hssh star crossing.png -o gateways.png            draw them
  hssh star maps/*.png --json                       many images in one call
  hssh star crossing.png --method constriction --direction heading --continuity ray
"""


_CHOICES: tuple[tuple[str, tuple[str, str], str], ...] = (
    ("--method", ("anchor", "constriction"), "where gateways lie; both as published"),
    ("--direction", ("fit", "heading"), "of gateways: fitted, or mean heading as published"),
    (
        "--base",
        ("settled", "closest"),
        "base point of a place without a junction: in its bend or dead end, or closest to the "
        "robot as published",
    ),
    ("--continuity", ("angle", "ray"), "of paths: by angle and offset, or by ray as published"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("images", metavar="IMAGE", nargs="+", help="grey image (PNG, PGM, ...)")
    parser.add_argument(
        "--robot", metavar="X,Y", type=parse_point, help="pixel of the robot, x right, y down"
    )
    parser.add_argument(
        "--resolution", metavar="M", type=parse_metres, help="side of a cell in metres"
    )
    parser.add_argument(
        "--robot-radius", metavar="M", type=parse_metres, help="needs --resolution (default 0.25)"
    )
    for option, choices, told in _CHOICES:
        parser.add_argument(option, choices=choices, default=choices[0], help=told)
    parser.add_argument(
        "--force", action="store_true", help="read images of more than 100 million cells too"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="PNG",
        help="draw gateways and star; for several images a folder that exists",
    )


def run(args: argparse.Namespace) -> int:
    """Find and print gateways and stars."""
    if args.robot_radius is not None and args.resolution is None:
        raise UsageError("--robot-radius is in metres and has no effect without --resolution")
    targets = _name_targets(args.images, args.output)
    documents, faults = list[dict[str, Any]](), list[str]()
    for file, target in zip(args.images, targets, strict=True):
        try:
            documents.append(_read_star(args, file, target))
        except InputError as error:
            faults.append(str(error) if file in str(error) else f"{file}: {error}")
    if faults:
        raise InputError("; ".join(faults))
    if args.json:
        print_json({"schema": "hssh.star/1", "images": documents})
    else:
        print("\n".join(_format_star(document) for document in documents))
    return 0


def _name_targets(images: list[str], output: str | None) -> list[Path | None]:
    if output is None:
        return [None] * len(images)
    target = Path(output)
    if target.is_dir():
        return [target / f"{Path(image).stem}-star.png" for image in images]
    if len(images) > 1:
        raise UsageError(f"{output}: for {len(images)} images -o must be a folder that exists")
    if target.suffix.lower() != ".png":
        raise UsageError(f"{output}: the drawing is a PNG; give a name that ends in .png")
    return [target]


def _read_star(args: argparse.Namespace, file: str, target: Path | None) -> dict[str, Any]:
    from perception.images import MOST_CELLS, read_grey_image
    from perception.topology import local_topology, topology_to_data

    image = read_grey_image(file, most_cells=None if args.force else MOST_CELLS)
    topology = local_topology(
        image,
        robot_px=args.robot,
        resolution_m=args.resolution,
        robot_radius_m=args.robot_radius,
        method=args.method,
        direction=args.direction,
        base=args.base,
        continuity=args.continuity,
    )
    if target is not None:
        import cv2

        from perception.atomic import write_atomically
        from perception.draw import draw_topology

        png = cv2.imencode(".png", draw_topology(image, topology))[1]
        write_atomically(target, png.tobytes())
    return topology_to_data(topology, file)


def _format_star(document: dict[str, Any]) -> str:
    gateways = document["gateways"]
    place = "at a place" if document["at_place"] else "not at a place"
    shape = f", {document['shape']}" if document["shape"] else ""
    dlps = [
        f"{dlp} {told}" if told else dlp
        for dlp, told in zip(document["star"], document["types"], strict=True)
    ]
    lines = [
        f"{document['file']}: {count_noun(len(gateways), 'gateway')}, {place}{shape}",
        f"  star, clockwise: {', '.join(dlps) or '(empty: no way leads out)'}",
    ]
    for gateway in gateways:
        x, y = gateway["centre"]
        lines.append(f"  gateway at ({x:.1f}, {y:.1f}) px, outward {gateway['outward']:+.2f} rad")
    lines += [
        f"  or, with weight {reading['weight']:.2f}: {' '.join(reading['star'])}"
        for reading in document["readings"][1:]
    ]
    return "\n".join(lines)
