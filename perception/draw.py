"""A picture of a local topology: grid, skeleton, core, gateways and star."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.errors import InputError
from perception.gateways import Gateway
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
_SKELETON: Colour = (150, 150, 150)
_CORE: Colour = (0, 165, 255)
_BASE: Colour = (0, 0, 160)
_ROBOT: Colour = (200, 60, 60)
_ANCHOR: Colour = (180, 0, 180)
_INK: Colour = (30, 30, 30)


def draw_topology(image: Image, topology: LocalTopology, *, side_px: int = 720) -> Picture:
    """Draw a grid with what was found in it.

    Grey: skeleton; orange: its core, and the discs of its base points (stars); rings: anchors; blue
    dot: the robot; coloured bars with arrows: gateways, in the colour of their path; thin arrows:
    the dlps that cannot be travelled. Names carry their place in the clockwise order; below stand
    the path types.

    Parameters
    ----------
    image : the grid the topology was found in.
    side_px : the longer side of the picture, without the margin.

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
    canvas = _Canvas(_background(image, topology, zoom), zoom)
    _draw_skeleton(canvas, topology)
    _draw_star(canvas, topology)
    return canvas.picture


class _Canvas:
    """A picture whose points are given in cells."""

    def __init__(self, picture: Picture, zoom: float) -> None:
        self.picture = picture
        self.zoom = zoom
        self.margin = _margin(zoom)

    def at(self, point: Array | tuple[float, float]) -> tuple[int, int]:
        x = (float(point[0]) + 0.5) * self.zoom + self.margin
        y = (float(point[1]) + 0.5) * self.zoom + self.margin
        return round(x), round(y)

    def line(
        self, a: tuple[float, float], b: tuple[float, float], colour: Colour, width: int
    ) -> None:
        cv2.line(self.picture, self.at(a), self.at(b), colour, width, cv2.LINE_AA)

    def arrow(
        self, a: tuple[float, float], b: tuple[float, float], colour: Colour, width: int
    ) -> None:
        cv2.arrowedLine(
            self.picture, self.at(a), self.at(b), colour, width, cv2.LINE_AA, tipLength=0.3
        )

    def text(self, text: str, point: tuple[float, float], colour: Colour) -> None:
        """Write on a light ground, moved into the picture and made small enough for it."""
        font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.6
        height, width = self.picture.shape[:2]
        (w, h), _ = cv2.getTextSize(text, font, size, 2)
        if w > width - 12:
            size *= (width - 12) / w
            (w, h), _ = cv2.getTextSize(text, font, size, 2)
        x, y = self.at(point)
        left = min(max(x - w // 2, 6), max(width - w - 6, 6))
        foot = min(max(y + h // 2, h + 4), height - 6)
        ground = self.picture[max(foot - h - 3, 0) : foot + 4, max(left - 3, 0) : left + w + 3]
        ground[:] = (ground * 0.15 + 255 * 0.85).astype(np.uint8)
        cv2.putText(self.picture, text, (left, foot), font, size, colour, 2, cv2.LINE_AA)


def _margin(zoom: float) -> int:
    return 36 if zoom > 0 else 0


def _background(image: Image, topology: LocalTopology, zoom: float) -> Picture:
    """Return the grid in three greys, the region the robot can pass faintly tinted."""
    cells = classify(image)
    grey = np.full((*image.shape, 3), 205, np.uint8)
    grey[cells.free] = 255
    grey[cells.free & topology.inside] = (255, 250, 240)
    grey[cells.occupied] = 60
    height, width = image.shape
    size = max(round(width * zoom), 1), max(round(height * zoom), 1)
    method = cv2.INTER_NEAREST if zoom >= 1 else cv2.INTER_AREA
    scaled = cv2.resize(grey, size, interpolation=method)
    edge = _margin(zoom)
    framed = cv2.copyMakeBorder(
        scaled, edge, edge, edge, edge, cv2.BORDER_CONSTANT, value=(235, 235, 235)
    )
    return np.asarray(framed, np.uint8)


def _draw_skeleton(canvas: _Canvas, topology: LocalTopology) -> None:
    dot = max(round(canvas.zoom * 0.45), 1)
    for point, core in zip(topology.skeleton_px, topology.core, strict=True):
        cv2.circle(canvas.picture, canvas.at(point), dot, _CORE if core else _SKELETON, -1)
    for point, radius in zip(topology.base_px, topology.base_radius_px, strict=True):
        size = max(round(float(radius) * canvas.zoom), 1)
        cv2.circle(canvas.picture, canvas.at(point), size, _CORE, 1, cv2.LINE_AA)
        cv2.drawMarker(canvas.picture, canvas.at(point), _BASE, cv2.MARKER_STAR, 14, 2)
    for gateway in topology.gateways:
        if gateway.anchor_px is not None:
            cv2.circle(canvas.picture, canvas.at(gateway.anchor_px), 6, _ANCHOR, 2, cv2.LINE_AA)
    cv2.circle(canvas.picture, canvas.at(topology.robot_px), 7, _ROBOT, -1, cv2.LINE_AA)


def _draw_star(canvas: _Canvas, topology: LocalTopology) -> None:
    """Draw gateways and dlps of the most probable reading, numbered clockwise as in the star."""
    reading = topology.readings[0]
    paths = sorted({dlp.path for dlp in reading.star.dlps})
    colours = {path: _PATHS[k % len(_PATHS)] for k, path in enumerate(paths)}
    reach = 0.06 * max(topology.inside.shape)
    names: list[tuple[str, Point, Colour]] = []
    for k, dlp in enumerate(reading.star.dlps):
        number, heading = reading.gateway_out[k], reading.headings_px[k]
        colour = colours[dlp.path]
        dx, dy = math.cos(heading), math.sin(heading)
        if number is not None:
            gateway = topology.gateways[number]
            _draw_gateway(canvas, gateway, colour, reach)
            x, y = gateway.centre_px
            name_at = (x + 2.4 * reach * dx, y + 2.4 * reach * dy)
        else:
            x, y = (float(v) for v in topology.base_px.mean(axis=0))
            far = _gateway_reach(topology) + 0.5 * reach
            tip = (x + far * dx, y + far * dy)
            canvas.arrow((x + 0.5 * far * dx, y + 0.5 * far * dy), tip, colour, 1)
            name_at = (tip[0] + reach * dx, tip[1] + reach * dy)
        names.append((f"{k + 1}: {dlp}", name_at, colour))
    for text, point, colour in names:
        canvas.text(text, point, colour)
    canvas.text(_describe(topology), (0.5 * topology.inside.shape[1], -20 / canvas.zoom), _INK)
    told = zip(reading.star.dlps, reading.types, strict=True)
    types = [f"{dlp} {name or '(not told)'}" for dlp, name in told]
    below = topology.inside.shape[0] + 17 / canvas.zoom
    canvas.text(", ".join(types), (0.5 * topology.inside.shape[1], below), _INK)


def _describe(topology: LocalTopology) -> str:
    """Return the caption: where the robot is, the shape, the star."""
    state = "at a place" if topology.at_place else "on a path"
    if not topology.gateways:
        return f"{state}: no way leads out"
    shape = f" ({topology.shape})" if topology.shape else ""
    doubt = "" if len(topology.readings) == 1 else f", weight {topology.readings[0].weight:.2f}"
    return f"{state}{shape}, clockwise: {topology.star}{doubt}"


def _gateway_reach(topology: LocalTopology) -> float:
    middle = topology.base_px.mean(axis=0)
    return max(math.dist(g.centre_px, middle) for g in topology.gateways)


def _draw_gateway(canvas: _Canvas, gateway: Gateway, colour: Colour, reach: float) -> None:
    canvas.line(*gateway.ends_px, colour, 3)
    x, y = gateway.centre_px
    dx, dy = math.cos(gateway.outward_rad), math.sin(gateway.outward_rad)
    canvas.arrow((x, y), (x + 1.5 * reach * dx, y + 1.5 * reach * dy), colour, 3)
