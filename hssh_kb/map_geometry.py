"""Where to draw what: positions of places, directions of dlps, curves of travelled stretches.

Where something was measured, it decides. A trace without measurements is laid out as if every
star had equal angles and every travel unit length; if that does not fit, as a plain graph.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hssh_kb.errors import HsshError
from hssh_kb.node_layout import place_nodes
from hssh_kb.place_graph import Edge, Place, PlaceGraph
from perception.geometry import Array

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase

_FITS_CHI2 = 0.05
_APART = 0.4


@dataclass(frozen=True)
class MapGeometry:
    """Geometry of one map.

    Attributes
    ----------
    metric : True if units are metres in the map frame; else they mean nothing.
    positions : (2,) of each place, by label.
    headings_rad : of each dlp in the frame of the drawing, by (label, index).
    curves : (n, 2) of each stretch, by (start, dlp) of its first direction.
    drive : (n, 2) the drive; None if unknown.
    doubted : (n, 2) of each doubted stretch, by its two ends.
    """

    metric: bool
    positions: dict[str, Array]
    headings_rad: dict[tuple[str, int], float]
    curves: dict[tuple[str, int], Array]
    drive: Array | None
    doubted: dict[tuple[str, str], Array]


def find_geometry(kb: KnowledgeBase, graph: PlaceGraph, number: int = 1) -> MapGeometry:
    """Return the geometry of a map of a knowledge base."""
    layout = kb.layout(number)
    labels = list(graph.places)
    if layout is not None:
        positions = {label: layout.poses[i, :2] for i, label in enumerate(labels)}
        known = {
            (label, k): float(layout.poses[i, 2] + heading)
            for i, label in enumerate(labels)
            for k, heading in enumerate(graph.places[label].headings_rad)
        }
    else:
        positions, known = place_symbols(graph)
    travels = _bend_travels(kb, graph, positions) if layout is not None else {}
    curves = {}
    for edge in graph.undirected_edges:
        driven = [travels[v] for v in edge.travels if v in travels]
        if driven:
            best = min(driven, key=_length)
            against = np.linalg.norm(best[0] - positions[edge.start]) > 1e-6
            curves[edge.start, edge.dlp] = best[::-1] if against else best
    drawn = curves | _draw_curves(graph, positions, known, set(curves))
    headings = {
        key: heading
        for place in graph.places.values()
        for key, heading in _fill_headings(graph, place, known, drawn).items()
    }
    drive = np.concatenate([travels[v] for v in sorted(travels)]) if travels else None
    if number == 1 and kb.trajectory is not None and layout is not None:
        drive = kb.trajectory.poses[:, :2]
    doubted = {
        (edge.start, edge.goal): travels.get(
            edge.travels[0], np.array([positions[edge.start], positions[edge.goal]])
        )
        for edge in graph.doubted[::2]
    }
    return MapGeometry(layout is not None, positions, headings, drawn, drive, doubted)


def place_symbols(
    graph: PlaceGraph,
) -> tuple[dict[str, Array], dict[tuple[str, int], float]]:
    """Lay out a graph of which nothing was measured: positions, and headings where they fit."""
    from hssh_kb.layout import lay_out

    labels = list(graph.places)
    index = {label: i for i, label in enumerate(labels)}
    if len(labels) > 1 and graph.edges:
        rows = graph.undirected_edges
        ahead = [_even_heading(graph.places[e.start], e.dlp) for e in rows]
        facing = [_even_heading(graph.places[e.goal], e.arrive) for e in rows]
        z = np.column_stack([np.cos(ahead), np.sin(ahead), np.subtract(ahead, facing)])
        information = np.repeat(np.eye(3)[None], len(rows), axis=0)
        ends = [index[e.start] for e in rows], [index[e.goal] for e in rows]
        try:
            laid = lay_out(len(labels), *ends, z, information)
        except HsshError:
            laid = None
        if laid is not None and laid.chi2 <= _FITS_CHI2 * len(rows):
            gaps = np.linalg.norm(laid.poses[:, None, :2] - laid.poses[None, :, :2], axis=2)
            if (gaps + 9 * np.eye(len(labels))).min() > _APART:
                headings = {
                    (label, k): float(
                        laid.poses[index[label], 2] + _even_heading(graph.places[label], k)
                    )
                    for label in labels
                    for k in range(len(graph.places[label].star))
                }
                return {label: laid.poses[i, :2] for label, i in index.items()}, headings
    return place_nodes(graph), {}


def _even_heading(place: Place, k: int) -> float:
    return -2 * np.pi * k / len(place.star)


def _bend_travels(
    kb: KnowledgeBase, graph: PlaceGraph, positions: dict[str, Array]
) -> dict[int, Array]:
    """Return the driven curve of each travel, its ends moved onto the places of this map."""
    drive = kb.trajectory
    if drive is None or len(drive.visit_scans) != len(kb.experience):
        return {}
    place_of = {v: place.label for place in graph.places.values() for v in place.visits}
    curves = {}
    for v in range(1, len(kb.experience)):
        if v not in place_of:
            continue
        first, last = int(drive.visit_scans[v - 1]), int(drive.visit_scans[v])
        points = drive.poses[first : last + 1, :2]
        start, goal = positions[place_of[v - 1]], positions[place_of[v]]
        if len(points) > 1:
            curves[v] = _move_ends(points, start, goal)
        else:
            curves[v] = np.array([start, goal])
    return curves


def _move_ends(points: Array, start: Array, goal: Array) -> Array:
    """Carry a curve so that it starts and ends at given points, turned and stretched if far."""
    z = points[:, 0] + 1j * points[:, 1]
    a, b = complex(*start), complex(*goal)
    span = z[-1] - z[0]
    if abs(span) > 1.0 and max(abs(z[0] - a), abs(z[-1] - b)) > 2.0:
        ratio = (b - a) / span
        if 0.3 < abs(ratio) < 3:
            z = a + (z - z[0]) * ratio
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(z)))])
    share = along / along[-1] if along[-1] > 0 else np.linspace(0, 1, len(z))
    z = z + (1 - share) * (a - z[0]) + share * (b - z[-1])
    return np.column_stack([z.real, z.imag])


def _draw_curves(
    graph: PlaceGraph,
    positions: dict[str, Array],
    headings: dict[tuple[str, int], float],
    done: set[tuple[str, int]],
) -> dict[tuple[str, int], Array]:
    """Return curves for the stretches whose drive is unknown: along the dlps, or bowed apart."""
    curves = {}
    pairs = Counter(frozenset((e.start, e.goal)) for e in graph.undirected_edges)
    seen = Counter[frozenset[str]]()
    for edge in graph.undirected_edges:
        key = edge.start, edge.dlp
        if key in done:
            continue
        pair = frozenset((edge.start, edge.goal))
        bow = seen[pair] - (pairs[pair] - 1) / 2
        seen[pair] += 1
        back = graph.places[edge.goal].star.opposite(edge.arrive)
        ends = headings.get(key), headings.get((edge.goal, back))
        curves[key] = _bow(edge, positions, ends, bow)
    return curves


def _bow(
    edge: Edge,
    positions: dict[str, Array],
    ends: tuple[float | None, float | None],
    bow: float,
) -> Array:
    p, q = positions[edge.start], positions[edge.goal]
    t = np.linspace(0, 1, 25)[:, None]
    if edge.start == edge.goal:
        turn = 2 * np.pi * t + (ends[0] or 0.0) + np.pi
        radius = 0.25
        centre = p + radius * np.array([np.cos(ends[0] or 0.0), np.sin(ends[0] or 0.0)])
        return np.asarray(centre + radius * np.hstack([np.cos(turn), np.sin(turn)]))
    reach = float(np.linalg.norm(q - p))
    if ends[0] is not None and ends[1] is not None:
        out = 0.4 * reach * np.array([np.cos(ends[0]), np.sin(ends[0])])
        back = 0.4 * reach * np.array([np.cos(ends[1]), np.sin(ends[1])])
        a, b = p + out, q + back
    else:
        side = np.array([-(q - p)[1], (q - p)[0]]) * 0.28 * bow
        if edge.start > edge.goal:  # the same side, whichever way the stretch was first travelled
            side = -side
        a, b = p + (q - p) / 3 + side, q - (q - p) / 3 + side
    return np.asarray(
        (1 - t) ** 3 * p + 3 * t * (1 - t) ** 2 * a + 3 * t**2 * (1 - t) * b + t**3 * q
    )


def _fill_headings(
    graph: PlaceGraph,
    place: Place,
    known: dict[tuple[str, int], float],
    curves: dict[tuple[str, int], Array],
) -> dict[tuple[str, int], float]:
    """Return a heading for every dlp of a place: measured, else along its curve, else between."""
    size = len(place.star)
    found = {k: known[place.label, k] for k in range(size) if (place.label, k) in known}
    if len(found) < size:
        found = {}
        for edge in graph.undirected_edges:
            curve = curves[edge.start, edge.dlp]
            n = max(len(curve) // 6, 1)
            if edge.start == place.label:
                found[edge.dlp] = _direction(curve[0], curve[n])
            if edge.goal == place.label:
                found[place.star.opposite(edge.arrive)] = _direction(curve[-1], curve[-1 - n])
    if not found:
        return {(place.label, k): np.pi / 2 - 2 * np.pi * k / size for k in range(size)}
    keys = sorted(found)
    headings = {}
    for i, k in enumerate(keys):
        following = keys[(i + 1) % len(keys)]
        count = (following - k - 1) % size + 1
        clockwise = (found[k] - found[following]) % (2 * np.pi) or 2 * np.pi
        for step in range(count):
            headings[place.label, (k + step) % size] = found[k] - clockwise * step / count
    return headings


def _direction(a: Array, b: Array) -> float:
    return float(np.arctan2(b[1] - a[1], b[0] - a[0]))


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
