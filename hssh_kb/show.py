"""Pictures of a map: corridors, places with their stars, paths in colours, drive and route."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hssh_kb.errors import UsageError
from hssh_kb.labels import LabelPlacer
from hssh_kb.legend import draw_legend, draw_scale_bar, draw_title
from hssh_kb.map_geometry import MapGeometry, find_geometry
from hssh_kb.palette import BLOCKED, DRIVE, INK, PAPER, ROUTE, STUB, Palette, paint_grid
from hssh_kb.place_graph import Edge, Place, PlaceGraph
from hssh_kb.scene import Bitmap, Disc, Line, Scene, Shape, Text
from perception.atomic import write_atomically
from perception.geometry import Array, measure_along
from perception.grid import UNKNOWN

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.records import Raster
    from hssh_kb.route import Route

ENDINGS = (".svg", ".png")
_TITLE_PX, _MARGIN_PX, _LEGEND_PX = 64.0, 28.0, 250.0
_LONG_SIDE_PX, _WIDE_WORLD_M = 1000.0, 120.0
_MANY_PLACES, _MANY_PATHS = 60, 40


def check_ending(path: str | Path) -> str:
    """Return the ending of a picture's name.

    Raises
    ------
    UsageError : no picture has this ending.
    """
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise UsageError(f"{path}: cannot draw this; the name must end in {' or '.join(ENDINGS)}")
    return ending


def show_map(
    kb: KnowledgeBase,
    path: str | Path,
    *,
    route: tuple[str, str] | None = None,
    number: int = 1,
) -> None:
    """Draw one map of a knowledge base to an SVG or PNG file.

    Parameters
    ----------
    kb : the knowledge base.
    path : the file; its ending says which.
    route : places (from, to) between which the route is drawn too.
    number : which of the ranked maps.

    Raises
    ------
    UsageError : another ending.
    NoAnswerError : there is no such route.
    InputError : there is no such map or place, or the file cannot be written.
    """
    ending = check_ending(path)
    scene = draw_map(kb, route=kb.route(*route, number=number) if route else None, number=number)
    if ending == ".svg":
        from hssh_kb.svg import render_svg

        write_atomically(path, render_svg(scene).encode())
    else:
        from hssh_kb.png import render_png

        write_atomically(path, render_png(scene))


def draw_map(kb: KnowledgeBase, *, route: Route | None = None, number: int = 1) -> Scene:
    """Return the scene of one map of a knowledge base."""
    graph = kb.graph(number)
    return _Drawing(kb, graph, find_geometry(kb, graph, number), number).draw(route)


class _Drawing:
    """One drawing under way: the world's frame carried to the canvas, and the parts of a map."""

    def __init__(
        self, kb: KnowledgeBase, graph: PlaceGraph, geometry: MapGeometry, number: int
    ) -> None:
        self.kb, self.graph, self.geometry, self.number = kb, graph, geometry, number
        self.palette = Palette(graph)
        # The grid is drawn on the first map; another map bends the drive away from it.
        self.grid = kb.global_map if geometry.metric and number == 1 else None
        left, bottom, right, top = self._find_extent()
        wide = max(right - left, top - bottom)
        room = _LONG_SIDE_PX * (1.5 if geometry.metric and wide > _WIDE_WORLD_M else 1.0)
        if geometry.metric:
            crowd = float(np.sqrt(len(graph.places) / _MANY_PLACES))
            room = max(room, _LONG_SIDE_PX * min(crowd, 2.0))
        if not geometry.metric:
            room = min(room, 170.0 * max(wide, 1.0))
        self.scale = room / max(wide, 1e-6)
        self.origin = np.array([left, top])
        self.area = (_MARGIN_PX, _TITLE_PX)
        width, height = (right - left) * self.scale, (top - bottom) * self.scale
        self.bounds = (
            self.area[0],
            self.area[1],
            self.area[0] + max(width, 320.0),
            self.area[1] + max(height, 160.0),
        )
        self.radius = float(np.clip(0.42 * self.scale, 4.5, 8.0)) if geometry.metric else 8.0

    def _find_extent(self) -> tuple[float, float, float, float]:
        points = [np.array(list(self.geometry.positions.values()))]
        points += list(self.geometry.curves.values())
        if self.geometry.drive is not None:
            points.append(self.geometry.drive)
        if self.grid is not None:
            points.append(_find_known_corners(self.grid))
        cloud = np.concatenate(points)
        margin = 1.0 if self.geometry.metric else 0.45
        left, bottom = cloud.min(axis=0) - margin
        right, top = cloud.max(axis=0) + margin
        return float(left), float(bottom), float(right), float(top)

    def to_canvas(self, points: Array) -> Array:
        """Carry points (..., 2) of the map frame to the canvas, pixels."""
        scaled = (np.asarray(points, float) - self.origin) * self.scale
        return np.asarray(scaled * np.array([1.0, -1.0]) + np.array(self.area))

    def draw(self, route: Route | None) -> Scene:
        """Return the finished scene."""
        b = self.bounds
        scene = Scene(b[2] + _LEGEND_PX + _MARGIN_PX, b[3] + 52.0, "")
        draw_title(scene, self.kb, self.number)
        if self.grid is not None:
            scene.add(self._draw_grid(self.grid))
        if self.geometry.drive is not None:
            points = self.to_canvas(self.geometry.drive)
            scene.add(Line(points, DRIVE, 1.1, 0.75, group="drive"))
        if route is not None:
            self._draw_route(scene, route)
        self._draw_paths(scene)
        for place in self.graph.places.values():
            self._draw_place(scene, place)
        self._draw_labels(scene, route)
        if self.geometry.metric:
            draw_scale_bar(scene, self.area[0], b[3] + 26.0, self.scale)
        bottom = draw_legend(
            scene,
            self.graph,
            self.palette,
            (b[2] + 24.0, self.area[1] + 8.0),
            drive=self.geometry.drive is not None,
            route=route,
        )
        scene.height = max(scene.height, bottom + 20.0)
        return scene

    def _draw_grid(self, grid: Raster) -> Bitmap:
        frame = grid.frame
        height, width = grid.image.shape
        left, top = self.to_canvas(np.array([frame.left_m, frame.top_m]))
        cell = frame.resolution_m * self.scale
        # Only what lies on the canvas: the unknown margin of a grid may be wide.
        rows = np.clip(
            [(self.bounds[1] - top) / cell, (self.bounds[3] - top) / cell + 1], 0, height
        ).astype(int)
        columns = np.clip(
            [(self.bounds[0] - left) / cell, (self.bounds[2] - left) / cell + 1], 0, width
        ).astype(int)
        part = grid.image[rows[0] : rows[1], columns[0] : columns[1]]
        return Bitmap(
            paint_grid(part),
            float(left + columns[0] * cell),
            float(top + rows[0] * cell),
            part.shape[1] * cell,
            part.shape[0] * cell,
            group="map",
        )

    def _draw_paths(self, scene: Scene) -> None:
        width = self.radius * 0.62
        for curve in self.geometry.doubted.values():
            points = self.to_canvas(_smooth(curve))
            scene.add(Line(points, STUB, width * 0.6, dash=6.0, group="doubted"))
        for edge in self.graph.undirected_edges:
            points = self.to_canvas(_smooth(self.geometry.curves[edge.start, edge.dlp]))
            group = f"path-{edge.path}"
            scene.add(Line(points, PAPER, width + 2.4, 0.9, group=group))
            scene.add(Line(points, self.palette.colour(edge.path), width, group=group))

    def _draw_route(self, scene: Scene, route: Route) -> None:
        if not route.edges:
            return
        curves = [self._orient_curve(edge) for edge in route.edges]
        points = self.to_canvas(np.concatenate(curves))
        scene.add(Line(points, ROUTE, self.radius * 2.2, 0.9, group="route"))

    def _orient_curve(self, edge: Edge) -> Array:
        """Return the curve of a stretch in the direction it is walked."""
        if edge.doubted:
            there = self.geometry.doubted.get((edge.start, edge.goal))
            return self.geometry.doubted[edge.goal, edge.start][::-1] if there is None else there
        if (edge.start, edge.dlp) in self.geometry.curves:
            return _smooth(self.geometry.curves[edge.start, edge.dlp])
        back = self.graph.places[edge.goal].star.opposite(edge.arrive)
        return _smooth(self.geometry.curves[edge.goal, back])[::-1]

    def _draw_place(self, scene: Scene, place: Place) -> None:
        x, y = self.to_canvas(self.geometry.positions[place.label])
        for k, alpha in enumerate(place.star.alpha):
            colour = self.palette.colour(self.graph.path_of_dlp[place.label, k][0])
            heading = self.geometry.headings_rad[place.label, k]
            out = np.array([np.cos(heading), -np.sin(heading)])
            across = np.array([-out[1], out[0]])
            tip = np.array([x, y]) + out * self.radius * (2.5 if alpha else 1.9)
            stem = np.array([[x, y], tip])
            group = f"place-{place.label}"
            if not alpha:
                bar = np.array([tip - across * self.radius * 0.7, tip + across * self.radius * 0.7])
                scene.add(Line(stem, BLOCKED, 1.6, group=group))
                scene.add(Line(bar, BLOCKED, 2.2, group=group))
            elif k in place.frontiers:
                scene.add(Line(stem, PAPER, 4.2, group=group), Line(stem, INK, 2.0, group=group))
                head = [tip + out * 4.5, tip - across * 3.6, tip + across * 3.6]
                scene.add(Shape(np.array(head), INK, group=group))
            else:
                scene.add(Line(stem, colour, 3.0, group=group))
        seen = ", ".join(f"v{v}" for v in place.visits)
        title = f"{place.title}: visits {seen}; star {place.star}"
        radius = self.radius * (1.0 if len(place.visits) < 2 else 1.15)
        scene.add(
            Disc(float(x), float(y), radius, PAPER, INK, 1.8, title, group=f"place-{place.label}")
        )

    def _draw_labels(self, scene: Scene, route: Route | None) -> None:
        placer = LabelPlacer(self.bounds)
        placer.inked = np.concatenate(
            [
                self.to_canvas(_resample(curve, 6.0 / self.scale))
                for curve in self.geometry.curves.values()
            ]
            or [np.empty((0, 2))]
        )
        spots = {
            label: self.to_canvas(position) for label, position in self.geometry.positions.items()
        }
        for label, (x, y) in spots.items():
            reach = self.radius * 1.1
            placer.take((x - reach, y - reach, x + reach, y + reach))
            for k in range(len(self.graph.places[label].star)):
                heading = self.geometry.headings_rad[label, k]
                tip = np.array([x, y]) + 1.9 * self.radius * np.array(
                    [np.cos(heading), -np.sin(heading)]
                )
                placer.take((tip[0] - 3, tip[1] - 3, tip[0] + 3, tip[1] + 3))
        size = float(np.clip(self.radius * 1.7, 10.0, 13.5))
        ends = {route.start.label: "start", route.goal.label: "goal"} if route else {}
        self._draw_path_names(scene, placer, size)
        for label in sorted(spots, key=lambda name: name not in ends):
            place = self.graph.places[label]
            text = place.label if place.name is None else f"{place.name} ({place.label})"
            if label in ends:
                text = f"{ends[label]}: {text}"
            x, y = spots[label]
            bold = place.name is not None or label in ends
            drawn = placer.place(
                float(x),
                float(y),
                text,
                size,
                self.radius * 1.8,
                bold=bold,
                halo=PAPER,
                group="names",
            )
            scene.add(drawn)

    def _draw_path_names(self, scene: Scene, placer: LabelPlacer, size: float) -> None:
        """Put the letter of each path on its longest stretch; among many paths, where room is."""
        longest: dict[str, Array] = {}
        for edge in self.graph.undirected_edges:
            curve = self.geometry.curves[edge.start, edge.dlp]
            if edge.path not in longest or _length(curve) > _length(longest[edge.path]):
                longest[edge.path] = curve
        crowded = len(longest) > _MANY_PATHS
        for name, curve in longest.items():
            points = self.to_canvas(_resample(curve, _length(curve) / 10 or 1.0))
            middle = [
                points[round(share * (len(points) - 1))] for share in (0.5, 0.4, 0.6, 0.3, 0.7)
            ]
            side = size * 1.35
            width = side + (len(name) - 1) * size * 0.6
            chosen = placer.choose([(p[0], p[1]) for p in middle], width, side, must=not crowded)
            if chosen is None:
                continue
            x, y = middle[chosen]
            colour, group = self.palette.colour(name), f"path-{name}"
            scene.add(
                Disc(
                    float(x), float(y), width / 2, colour, PAPER, 1.6, f"path {name}", group=group
                ),
                Text(
                    float(x), float(y), name, size * 0.92, PAPER, "middle", bold=True, group=group
                ),
            )


def _find_known_corners(grid: Raster) -> Array:
    """Return the corners of the part of a grid where anything is known, metres."""
    known = grid.image != UNKNOWN
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return np.empty((0, 2))
    box = np.array([[columns[0], rows[0]], [columns[-1], rows[-1]]], float)
    return np.asarray(grid.frame.to_metres(box))


def _smooth(points: Array, rounds: int = 2) -> Array:
    """Round the corners of a polyline (Chaikin), its ends kept."""
    for _ in range(rounds):
        if len(points) < 3:
            return points
        a, b = points[:-1], points[1:]
        cut = np.stack([0.75 * a + 0.25 * b, 0.25 * a + 0.75 * b], axis=1).reshape(-1, 2)
        points = np.concatenate([points[:1], cut[1:-1], points[-1:]])
    return points


def _resample(points: Array, step: float) -> Array:
    """Return points along a polyline, a step apart."""
    along = measure_along(points)
    at = np.linspace(0.0, along[-1], max(int(along[-1] / max(step, 1e-9)), 1) + 1)
    return np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
