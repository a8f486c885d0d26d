"""What stands around a map: title, scale bar, legend."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hssh_kb.palette import BLOCKED, DRIVE, INK, PAPER, ROUTE, STUB, Palette
from hssh_kb.place_graph import PlaceGraph
from hssh_kb.scene import Disc, Line, Scene, Shape, Text, estimate_width

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.route import Route

_GREY = "#5b6470"
_ROW = 19.0
_WIDTH = 215.0
_MOST_PATHS = 24


def draw_title(scene: Scene, kb: KnowledgeBase, number: int) -> None:
    """Write what the picture shows, and what the map's rank rests on."""
    row = kb.rows[number - 1]
    source = Path(kb.record.source).name if kb.record.source else "experience"
    tie = f" ({row.tie} maps tie)" if row.tie > 1 else ""
    posterior = row.hypothesis.log_posterior
    if kb.record.scans == 0 and kb.trajectory is not None and len(kb.rows) == 1:
        reason = "a finished map, explored by a virtual robot"
    elif posterior is not None:
        reason = f"log posterior {posterior:.1f}"
    else:
        reason = "fewest paths, then fewest places"
    sub = (
        f"map {number} of {len(kb.rows)}, rank {row.rank}{tie}: {reason}; "
        f"{row.places} places, {row.paths} paths, {len(row.hypothesis.visits)} visits"
    )
    scene.title = f"{source}: {sub}"
    scene.add(Text(28, 24, source, 18, INK, bold=True, group="title"))
    scene.add(Text(28, 46, sub, 12.5, _GREY, group="title"))
    scene.width = max(scene.width, 56 + estimate_width(sub, 12.5))


def draw_scale_bar(scene: Scene, x: float, y: float, pixels_per_m: float) -> None:
    """Draw a bar of a round number of metres."""
    length_m = next(
        m for m in (100, 50, 20, 10, 5, 2, 1, 0.5) if m * pixels_per_m <= 160 or m == 0.5
    )
    end = x + length_m * pixels_per_m
    bar = np.array([[x, y - 4], [x, y], [end, y], [end, y - 4]])
    scene.add(Line(bar, INK, 1.6, group="scale"))
    scene.add(Text(end + 8, y - 1, f"{length_m:g} m", 12, INK, group="scale"))


def draw_legend(
    scene: Scene,
    graph: PlaceGraph,
    palette: Palette,
    corner: tuple[float, float],
    *,
    drive: bool,
    route: Route | None,
) -> float:
    """Draw the meaning of marks and the list of paths; return where it ends (y, pixels)."""
    x, y = corner
    group = "legend"
    for mark, text in _list_marks(graph, drive):
        _draw_mark(scene, mark, x, y, group)
        scene.add(Text(x + 34, y, text, 12, INK, group=group))
        y += _ROW
    if route is not None:
        scene.add(Line(np.array([[x, y], [x + 24, y]]), ROUTE, 9, 0.9, group=group))
        y = _write(scene, f"route {route.start.title} to {route.goal.title}", x + 34, y)
        y = _write(scene, route.text, x, y + 4, width=_WIDTH)
    y += 12
    travelled = [path for path in graph.paths if path.travelled]
    scene.add(Text(x, y, "Paths, places in order", 12.5, INK, bold=True, group=group))
    y += _ROW + 2
    most = max(int((scene.height - y) / _ROW) - 4, _MOST_PATHS)
    for path in travelled[:most]:
        colour = palette.colour(path.name)
        scene.add(Disc(x + 9, y, 8.5, colour, group=group))
        scene.add(Text(x + 9, y, path.name, 10.5, PAPER, "middle", bold=True, group=group))
        titles = [graph.places[label].title for label in path.places]
        y = _write(scene, " \u2013 ".join(titles), x + 26, y, width=_WIDTH - 26)
    if len(travelled) > most:
        y = _write(scene, f"and {len(travelled) - most} more", x + 26, y)
    stubs = len(graph.paths) - len(travelled)
    if stubs:
        noun = "path" if stubs == 1 else "paths"
        y = _write(scene, f"{stubs} {noun} never travelled", x, y + 4, colour=_GREY)
    return y


def _list_marks(graph: PlaceGraph, drive: bool) -> list[tuple[str, str]]:
    marks = [("place", "place, with its star")]
    if any(place.frontiers for place in graph.places.values()):
        marks.append(("frontier", "open, never travelled"))
    if any(0 in place.star.alpha for place in graph.places.values()):
        marks.append(("blocked", "no way on"))
    if graph.doubted:
        marks.append(("doubted", "driven, a place may be missing"))
    if drive:
        marks.append(("drive", "the drive"))
    return marks


def _draw_mark(scene: Scene, mark: str, x: float, y: float, group: str) -> None:
    match mark:
        case "place":
            scene.add(Line(np.array([[x + 1, y], [x + 23, y]]), _GREY, 3, group=group))
            scene.add(Disc(x + 12, y, 6.5, PAPER, INK, 1.8, group=group))
        case "frontier":
            scene.add(Line(np.array([[x + 3, y], [x + 16, y]]), INK, 2, group=group))
            head = np.array([[x + 21, y], [x + 15, y - 3.6], [x + 15, y + 3.6]])
            scene.add(Shape(head, INK, group=group))
        case "blocked":
            scene.add(Line(np.array([[x + 5, y], [x + 18, y]]), BLOCKED, 1.6, group=group))
            scene.add(Line(np.array([[x + 18, y - 5], [x + 18, y + 5]]), BLOCKED, 2.2, group=group))
        case "doubted":
            line = np.array([[x, y], [x + 24, y]])
            scene.add(Line(line, STUB, 2.6, dash=6.0, group=group))
        case _:
            scene.add(Line(np.array([[x, y], [x + 24, y]]), DRIVE, 1.4, group=group))


def _write(
    scene: Scene, text: str, x: float, y: float, *, width: float = _WIDTH, colour: str = INK
) -> float:
    """Write a text in lines of a given width; return where the next row begins."""
    for line in _wrap(text, 12.0, width):
        scene.add(Text(x, y, line, 12.0, colour, group="legend"))
        y += _ROW - 2
    return y + 2


def _wrap(text: str, size: float, width: float) -> list[str]:
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and estimate_width(longer, size) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
