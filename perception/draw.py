"""A picture of a local topology: grid, skeleton, core, gateways and star."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.geometry import Array
from perception.grid import Image, classify
from perception.topology import LocalTopology, Point

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

_PATHS: tuple[Colour, ...] = (
    (200, 90, 0),
    (40, 40, 210),
    (40, 140, 30),
    (160, 30, 160),
    (0, 120, 220),
    (140, 120, 0),
)
_SKELETON: Colour = (190, 150, 30)
_CORE: Colour = (0, 165, 255)
_BASE: Colour = (0, 0, 160)
_ROBOT: Colour = (200, 60, 60)
_ANCHOR: Colour = (180, 0, 180)
_INK: Colour = (30, 30, 30)
_PAPER: Colour = (255, 255, 255)
_FONT, _FONT_SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.6
_LINE_PX = 26
_GAP_PX = 5
_LEAST_MARGIN_PX = 36


@dataclass(frozen=True)
class Arrow:
    """An arrow with a name beyond its tip.

    Attributes
    ----------
    start, tip : in cells.
    width : of the line, in pixels.
    name, colour : what is written beyond the tip, and in which colour (blue, green, red).
    """

    start: Point
    tip: Point
    width: int
    name: str
    colour: Colour


@dataclass(frozen=True)
class Label:
    """A text in a box.

    Attributes
    ----------
    text : one line.
    x, y : middle of the box, in pixels from the upper left corner of the grid.
    width, height : of the box, in pixels.
    """

    text: str
    x: float
    y: float
    width: int
    height: int

    def overlaps(self, other: Label) -> bool:
        """Tell whether two boxes come closer than a small gap."""
        beside = abs(self.x - other.x) >= (self.width + other.width) / 2 + _GAP_PX
        return not beside and abs(self.y - other.y) < (self.height + other.height) / 2 + _GAP_PX


def draw_topology(image: Image, topology: LocalTopology, *, side_px: int = 720) -> Picture:
    """Draw a grid with what was found in it.

    Blue-green: skeleton; orange: its core, and the discs of its base points (stars); rings:
    anchors; blue dot: the robot; coloured bars with arrows: gateways, in the colour of their path;
    thin arrows: the dlps that cannot be travelled. Names carry their place in the clockwise order;
    below stand the path types.

    Parameters
    ----------
    image : the grid the topology was found in.
    side_px : the longer side of the grid in the picture; a margin for the texts comes to it.

    Returns
    -------
    (h, w, 3) uint8 blue, green, red.

    Raises
    ------
    InputError : the topology comes from a grid of another size.
    """
    if topology.inside.shape != image.shape:
        raise InputError(
            f"the topology was found in a grid of {topology.inside.shape}, "
            f"the image has {image.shape}"
        )
    zoom = max(side_px / max(image.shape), 0.05)
    grid = _scale_grid(image, topology, zoom)
    arrows = plan_arrows(topology)
    labels = place_labels(arrows, zoom)
    canvas = _Canvas(grid, zoom, labels, (_describe(topology), _describe_types(topology)))
    _draw_skeleton(canvas, topology)
    _draw_star(canvas, topology, arrows)
    for label, arrow in zip(labels, arrows, strict=True):
        canvas.text(label, arrow.colour)
    return canvas.picture


class _Canvas:
    """A grid in a frame wide enough for its labels, a caption above and one below it.

    Points are given in cells, places of labels in pixels of the grid.
    """

    def __init__(
        self, grid: Picture, zoom: float, labels: Sequence[Label], captions: tuple[str, str]
    ) -> None:
        height, width = grid.shape[:2]
        self.zoom = zoom
        self.left = _fit_margin([k.width / 2 - k.x for k in labels])
        right = _fit_margin([k.x + k.width / 2 - width for k in labels])
        above, below = (_wrap_text(c, self.left + width + right - 2 * _GAP_PX) for c in captions)
        self.top = _fit_margin([k.height / 2 - k.y for k in labels], len(above))
        bottom = _fit_margin([k.y + k.height / 2 - height for k in labels], len(below))
        frame = (self.top, bottom, self.left, right)
        framed = cv2.copyMakeBorder(grid, *frame, cv2.BORDER_CONSTANT, value=(235, 235, 235))
        self.picture: Picture = np.asarray(framed, np.uint8)
        foot = self.picture.shape[0] - _GAP_PX - _LINE_PX * len(below)
        for lines, start in ((above, _GAP_PX), (below, foot)):
            for k, line in enumerate(lines):
                x = self.picture.shape[1] / 2 - self.left
                y = start + (k + 0.5) * _LINE_PX - self.top
                self.text(Label(line, x, y, *_measure_text(line)), _INK)

    def at(self, point: Array | Point) -> tuple[int, int]:
        x = (float(point[0]) + 0.5) * self.zoom + self.left
        y = (float(point[1]) + 0.5) * self.zoom + self.top
        return round(x), round(y)

    def line(self, a: Point, b: Point, colour: Colour, width: int) -> None:
        for ink, size in ((_PAPER, width + 2), (colour, width)):
            cv2.line(self.picture, self.at(a), self.at(b), ink, size, cv2.LINE_AA)

    def arrow(self, arrow: Arrow) -> None:
        start, tip = self.at(arrow.start), self.at(arrow.tip)
        for ink, size in ((_PAPER, arrow.width + 2), (arrow.colour, arrow.width)):
            cv2.arrowedLine(self.picture, start, tip, ink, size, cv2.LINE_AA, tipLength=0.3)

    def text(self, label: Label, colour: Colour) -> None:
        """Write on a light ground."""
        left = round(label.x + self.left - label.width / 2)
        top = round(label.y + self.top - label.height / 2)
        ground = self.picture[
            max(top - 3, 0) : top + label.height + 4, max(left - 3, 0) : left + label.width + 3
        ]
        ground[:] = (ground * 0.15 + 255 * 0.85).astype(np.uint8)
        cv2.putText(
            self.picture,
            label.text,
            (left, top + label.height),
            _FONT,
            _FONT_SIZE,
            colour,
            2,
            cv2.LINE_AA,
        )


def _fit_margin(over_px: Sequence[float], lines: int = 0) -> int:
    """Return the width of a margin that labels reach over, with so many lines of text beyond."""
    over = max([0.0, *over_px])
    return max(round(over) + 2 * _GAP_PX + lines * _LINE_PX, _LEAST_MARGIN_PX)


def _measure_text(text: str) -> tuple[int, int]:
    """Return width and height of a text in pixels."""
    (width, height), _ = cv2.getTextSize(text, _FONT, _FONT_SIZE, 2)
    return int(width), int(height)


def _wrap_text(text: str, width_px: int) -> list[str]:
    """Return a text in lines that are no wider, unless a word alone is."""
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and _measure_text(longer)[0] <= width_px:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _scale_grid(image: Image, topology: LocalTopology, zoom: float) -> Picture:
    """Return the grid in three greys, the region the robot can pass faintly tinted."""
    cells = classify(image)
    grey = np.full((*image.shape, 3), 205, np.uint8)
    grey[cells.free] = 255
    grey[cells.free & topology.inside] = (255, 250, 240)
    grey[cells.occupied] = 60
    height, width = image.shape
    size = max(round(width * zoom), 1), max(round(height * zoom), 1)
    method = cv2.INTER_NEAREST if zoom >= 1 else cv2.INTER_AREA
    return np.asarray(cv2.resize(grey, size, interpolation=method), np.uint8)


def plan_arrows(topology: LocalTopology) -> list[Arrow]:
    """Return the arrows of the most probable reading, numbered clockwise as in the star.

    Those through gateways start there, those that cannot be travelled near the base points.
    """
    reading = topology.readings[0]
    paths = sorted({dlp.path for dlp in reading.star.dlps})
    colours = {path: _PATHS[k % len(_PATHS)] for k, path in enumerate(paths)}
    reach = 0.06 * max(topology.inside.shape)
    middle = topology.base_px.mean(axis=0)
    edge = max((math.dist(g.centre_px, middle) for g in topology.gateways), default=0.0)
    arrows = []
    for k, dlp in enumerate(reading.star.dlps):
        number, heading = reading.gateway_out[k], reading.headings_px[k]
        if number is not None:
            x, y = topology.gateways[number].centre_px
            near, far, width = 0.0, 1.5 * reach, 4
        else:
            x, y = middle.tolist()
            far = edge + 0.5 * reach
            near, width = 0.5 * far, 2
        dx, dy = math.cos(heading), math.sin(heading)
        start, tip = (x + near * dx, y + near * dy), (x + far * dx, y + far * dy)
        arrows.append(Arrow(start, tip, width, f"{k + 1}: {dlp}", colours[dlp.path]))
    return arrows


def place_labels(arrows: Sequence[Arrow], zoom: float) -> list[Label]:
    """Place the name of each arrow beyond its tip, further out where another name is.

    Parameters
    ----------
    zoom : pixels a cell.
    """
    labels: list[Label] = []
    for arrow in arrows:
        way = np.subtract(arrow.tip, arrow.start)
        dx, dy = (way / max(float(np.hypot(*way)), 1e-9)).tolist()
        width, height = _measure_text(arrow.name)
        x = (arrow.tip[0] + 0.5) * zoom + dx * (width / 2 + 2 * _GAP_PX)
        y = (arrow.tip[1] + 0.5) * zoom + dy * (height / 2 + 2 * _GAP_PX)
        label = Label(arrow.name, x, y, width, height)
        while any(label.overlaps(other) for other in labels):
            x, y = x + _GAP_PX * dx, y + _GAP_PX * dy
            label = Label(arrow.name, x, y, width, height)
        labels.append(label)
    return labels


def _draw_skeleton(canvas: _Canvas, topology: LocalTopology) -> None:
    dot = min(max(round(canvas.zoom * 0.45), 1), 3)
    for point, core in zip(topology.skeleton_px, topology.core, strict=True):
        cv2.circle(canvas.picture, canvas.at(point), dot, _CORE if core else _SKELETON, -1)
    for point, radius in zip(topology.base_px, topology.base_radius_px, strict=True):
        size = max(round(float(radius) * canvas.zoom), 1)
        cv2.circle(canvas.picture, canvas.at(point), size, _CORE, 1, cv2.LINE_AA)
        cv2.drawMarker(canvas.picture, canvas.at(point), _BASE, cv2.MARKER_STAR, 14, 2)


def _draw_star(canvas: _Canvas, topology: LocalTopology, arrows: Sequence[Arrow]) -> None:
    """Draw gateways, anchors, the robot, and the dlps."""
    for number, arrow in zip(topology.readings[0].gateway_out, arrows, strict=True):
        if number is not None:
            canvas.line(*topology.gateways[number].ends_px, arrow.colour, 4)
    for gateway in topology.gateways:
        if gateway.anchor_px is not None:
            cv2.circle(canvas.picture, canvas.at(gateway.anchor_px), 6, _ANCHOR, 2, cv2.LINE_AA)
    cv2.circle(canvas.picture, canvas.at(topology.robot_px), 7, _ROBOT, -1, cv2.LINE_AA)
    for arrow in arrows:
        canvas.arrow(arrow)


def _describe(topology: LocalTopology) -> str:
    """Return the caption: where the robot is, the shape, the star."""
    state = "at a place" if topology.at_place else "on a path"
    if not topology.gateways:
        return f"{state}: no way leads out"
    shape = f" ({topology.shape})" if topology.shape else ""
    doubt = "" if len(topology.readings) == 1 else f", weight {topology.readings[0].weight:.2f}"
    return f"{state}{shape}, clockwise: {topology.star}{doubt}"


def _describe_types(topology: LocalTopology) -> str:
    """Return which dlps are of which path type."""
    reading, found = topology.readings[0], dict[str, list[str]]()
    for dlp, name in zip(reading.star.dlps, reading.types, strict=True):
        found.setdefault(name or "type not told", []).append(str(dlp))
    return ", ".join(f"{name}: {' '.join(dlps)}" for name, dlps in found.items())
