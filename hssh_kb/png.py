"""A scene as PNG, drawn with OpenCV."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hssh_kb.errors import InternalError
from hssh_kb.scene import Bitmap, Disc, Item, Line, Scene, Shape, Text
from perception.geometry import Array, measure_along

_SHIFT = 4  # OpenCV takes coordinates in sixteenths of a pixel
_Canvas = NDArray[np.uint8]


def render_png(scene: Scene, scale: float = 2.0) -> bytes:
    r"""Return the PNG file of a scene, ``scale`` pixels for each of its own.

    Examples
    --------
    >>> scene = Scene(20, 10, "a dot")
    >>> scene.add(Disc(5, 5, 2, "#ff0000"))
    >>> render_png(scene)[:4]
    b'\x89PNG'
    """
    shape = (round(scene.height * scale), round(scene.width * scale), 3)
    canvas = np.full(shape, 255, np.uint8)
    for item in scene.items:
        _draw(canvas, item, scale)
    done, data = cv2.imencode(".png", canvas)
    if not done:
        raise InternalError("OpenCV could not encode a PNG")
    return bytes(data.tobytes())


def _draw(canvas: _Canvas, item: Item, scale: float) -> None:
    match item:
        case Bitmap():
            _draw_bitmap(canvas, item, scale)
        case Line():
            _draw_line(canvas, item, scale)
        case Shape():
            points = [_fixed(item.points * scale)]
            reach = _find_reach(item.points * scale, 1.0)

            def fill(target: _Canvas) -> None:
                cv2.fillPoly(target, points, _bgr(item.fill), cv2.LINE_AA, _SHIFT)

            _blend(canvas, item.opacity, fill, reach)
        case Disc():
            centre = tuple(_fixed(np.array([item.x, item.y]) * scale).tolist())
            if item.stroke_width:
                outer = round((item.radius + item.stroke_width / 2) * scale * 2**_SHIFT)
                cv2.circle(canvas, centre, outer, _bgr(item.stroke), -1, cv2.LINE_AA, _SHIFT)
            inner = round((item.radius - item.stroke_width / 2) * scale * 2**_SHIFT)
            cv2.circle(canvas, centre, max(inner, 1), _bgr(item.fill), -1, cv2.LINE_AA, _SHIFT)
        case Text():
            _draw_text(canvas, item, scale)


def _draw_bitmap(canvas: _Canvas, item: Bitmap, scale: float) -> None:
    """Stretch an image over its rectangle; parts beyond the canvas are cut off."""
    left, top = round(item.x * scale), round(item.y * scale)
    size = max(round(item.width * scale), 1), max(round(item.height * scale), 1)
    shrinks = size[0] < item.pixels.shape[1]
    pixels = cv2.resize(
        item.pixels, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    height, width = canvas.shape[:2]
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + size[0], width), min(top + size[1], height)
    if x0 < x1 and y0 < y1:
        canvas[y0:y1, x0:x1] = pixels[y0 - top : y1 - top, x0 - left : x1 - left, ::-1]


def _draw_line(canvas: _Canvas, item: Line, scale: float) -> None:
    parts = [item.points] if item.dash is None else list(_cut_dashes(item.points, item.dash))
    fixed = [_fixed(part * scale) for part in parts if len(part) > 1]
    if not fixed:
        return
    thickness = max(round(item.width * scale), 1)

    def stroke(target: _Canvas) -> None:
        cv2.polylines(target, fixed, False, _bgr(item.colour), thickness, cv2.LINE_AA, _SHIFT)

    _blend(canvas, item.opacity, stroke, _find_reach(item.points * scale, thickness))


def _find_reach(points: Array, margin: float) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of what a line through points may colour."""
    low, high = points.min(axis=0) - margin - 2, points.max(axis=0) + margin + 3
    left, top, right, bottom = (int(v) for v in (*low, *high))
    return max(left, 0), max(top, 0), max(right, 0), max(bottom, 0)


def _blend(
    canvas: _Canvas,
    opacity: float,
    paint: Any,  # noqa: ANN401
    reach: tuple[int, int, int, int],
) -> None:
    """Paint, mixed with what is there; nothing beyond the reach is coloured."""
    if opacity >= 1:
        paint(canvas)
        return
    left, top, right, bottom = reach
    window = (slice(top, bottom), slice(left, right))
    before = canvas[window].copy()
    if not before.size:
        return
    paint(canvas)
    canvas[window] = cv2.addWeighted(canvas[window], opacity, before, 1 - opacity, 0)


def _cut_dashes(points: Array, dash: float) -> Iterator[Array]:
    """Cut a polyline into dashes as long as the gaps between them."""
    along = measure_along(points)
    start = 0.0
    while start < along[-1]:
        end = min(start + dash, along[-1])
        inside = along[(along > start) & (along < end)]
        at = np.concatenate([[start], inside, [end]])
        yield np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])
        start += 2 * dash


def _draw_text(canvas: _Canvas, item: Text, scale: float) -> None:
    size = item.size * scale
    x, y = item.x * scale, item.y * scale
    write, width = _choose_type(item.text, size, item.bold)
    x -= {"start": 0.0, "middle": 0.5, "end": 1.0}[item.anchor] * width
    base = (round(x), round(y + 0.36 * size))
    if item.halo:
        reach = max(round(0.12 * size), 1)
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            step = reach if dx * dy == 0 else round(reach * 0.7)
            write(canvas, (base[0] + dx * step, base[1] + dy * step), _bgr(item.halo))
    write(canvas, base, _bgr(item.colour))


def _choose_type(text: str, size: float, bold: bool) -> tuple[Any, float]:
    """Return how to write a text and how wide it is; strokes where OpenCV has no type face."""
    if hasattr(cv2, "FontFace"):
        face, weight, points = cv2.FontFace("sans"), 700 if bold else 400, round(size * 0.98)
        box = cv2.getTextSize((0, 0), text, (0, 0), face, points, weight)

        def write(canvas: _Canvas, base: tuple[int, int], colour: tuple[int, ...]) -> None:
            cv2.putText(canvas, text, base, colour, face, points, weight)

        return write, float(box[2])
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    font, stretch, stroke = cv2.FONT_HERSHEY_SIMPLEX, size / 30, max(round(size / 13), 1) + bold
    wide = cv2.getTextSize(plain, font, stretch, stroke)[0][0]

    def scribble(canvas: _Canvas, base: tuple[int, int], colour: tuple[int, ...]) -> None:
        cv2.putText(canvas, plain, base, font, stretch, colour, stroke, cv2.LINE_AA)

    return scribble, float(wide)


def _fixed(points: Array) -> NDArray[np.int32]:
    return np.asarray(np.round(points * 2**_SHIFT), np.int32)


def _bgr(colour: str) -> tuple[int, int, int]:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return blue, green, red
