"""A scene as SVG."""

from __future__ import annotations

import base64
import xml.etree.ElementTree as ET

import cv2
import numpy as np
from numpy.typing import NDArray

from hssh_kb.scene import Bitmap, Disc, Item, Line, Scene, Shape, Text

_FONT = "'Helvetica Neue', Helvetica, Arial, 'DejaVu Sans', sans-serif"


def render_svg(scene: Scene) -> str:
    """Return the SVG document of a scene; items of one group share one ``<g id=...>``.

    Examples
    --------
    >>> scene = Scene(20, 10, "a dot")
    >>> scene.add(Disc(5, 5, 2, "#ff0000", group="dots"))
    >>> '<g id="dots">' in render_svg(scene)
    True
    """
    size = {"width": _number(scene.width), "height": _number(scene.height)}
    root = ET.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            **size,
            "viewBox": f"0 0 {size['width']} {size['height']}",
            "font-family": _FONT,
            "role": "img",
        },
    )
    ET.SubElement(root, "title").text = scene.title
    ET.SubElement(root, "rect", {**size, "fill": "#ffffff"})
    groups: dict[str, ET.Element] = {}
    for item in scene.items:
        parent = root
        if item.group:
            if item.group not in groups:
                groups[item.group] = ET.SubElement(root, "g", {"id": item.group})
            parent = groups[item.group]
        _draw(parent, item)
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode") + "\n"


def _draw(parent: ET.Element, item: Item) -> None:
    match item:
        case Bitmap():
            _draw_bitmap(parent, item)
        case Line():
            attributes = {
                "points": _points(item.points),
                "fill": "none",
                "stroke": item.colour,
                "stroke-width": _number(item.width),
                "stroke-linecap": "round",
                "stroke-linejoin": "round",
            }
            if item.opacity < 1:
                attributes["stroke-opacity"] = _number(item.opacity)
            if item.dash:
                attributes["stroke-dasharray"] = _number(item.dash)
            ET.SubElement(parent, "polyline", attributes)
        case Shape():
            attributes = {"points": _points(item.points), "fill": item.fill}
            if item.opacity < 1:
                attributes["fill-opacity"] = _number(item.opacity)
            ET.SubElement(parent, "polygon", attributes)
        case Disc():
            attributes = {"cx": _number(item.x), "cy": _number(item.y), "r": _number(item.radius)}
            attributes["fill"] = item.fill
            if item.stroke_width:
                attributes |= {"stroke": item.stroke, "stroke-width": _number(item.stroke_width)}
            disc = ET.SubElement(parent, "circle", attributes)
            if item.title:
                ET.SubElement(disc, "title").text = item.title
        case Text():
            _draw_text(parent, item)


def _draw_bitmap(parent: ET.Element, item: Bitmap) -> None:
    png = cv2.imencode(".png", item.pixels[:, :, ::-1])[1].tobytes()
    ET.SubElement(
        parent,
        "image",
        {
            "x": _number(item.x),
            "y": _number(item.y),
            "width": _number(item.width),
            "height": _number(item.height),
            "preserveAspectRatio": "none",
            "href": "data:image/png;base64," + base64.b64encode(png).decode("ascii"),
        },
    )


def _draw_text(parent: ET.Element, item: Text) -> None:
    attributes = {
        "x": _number(item.x),
        "y": _number(item.y + 0.36 * item.size),
        "font-size": _number(item.size),
        "fill": item.colour,
    }
    if item.anchor != "start":
        attributes["text-anchor"] = item.anchor
    if item.bold:
        attributes["font-weight"] = "bold"
    if item.halo:
        attributes |= {
            "stroke": item.halo,
            "stroke-width": _number(item.size * 0.24),
            "stroke-linejoin": "round",
            "paint-order": "stroke",
        }
    ET.SubElement(parent, "text", attributes).text = _strip_controls(item.text)


def _strip_controls(text: str) -> str:
    """Leave out characters that XML cannot hold."""
    return "".join(c for c in text if c >= " " and c not in "\ufffe\uffff")


def _points(points: NDArray[np.float64]) -> str:
    return " ".join(f"{_number(x)},{_number(y)}" for x, y in points)


def _number(value: float) -> str:
    return f"{float(value):.2f}".rstrip("0").rstrip(".")
