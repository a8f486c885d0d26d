"""Stars from the skeletons of scikit-image, by way of the graphs that sknw makes of them.

Neither package knows gateways or stars, so this adapter gives them what they lack, and means well:
junctions closer together than their clearance are one place (as Beeson 2008, 6.1, does), the place
nearest to the robot is taken, an arm is an edge out of it, its direction the main axis of its cells
between one and three clearances, and the star is read from the arms by our own path continuity.
*pruned* drops the arms that reach no border, which is not in the packages either.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import networkx as nx
import numpy as np
from scipy.spatial import cKDTree

from perception.continuity import read_stars
from perception.gateways import Gateway
from perception.star import Star

Skeletonize = Callable[[np.ndarray], np.ndarray]


def read_peer_star(free: np.ndarray, skeletonize: Skeletonize, *, pruned: bool) -> Star:
    """Return the star at the middle of a grid, True where free, by a peer's skeleton."""
    import sknw

    graph = sknw.build_sknw(skeletonize(free).astype(np.uint16), multi=True)
    clearance = cv2.distanceTransform(free.astype(np.uint8), cv2.DIST_L2, 5)
    place = _find_place(graph, clearance)
    if not place:
        return _read_path(graph, clearance)
    centre = np.mean([graph.nodes[n]["o"][::-1] for n in place], axis=0)
    gateways = []
    for tail, head, key, data in graph.edges(keys=True, data=True):
        for base, far in ((tail, head), (head, tail)):
            if base not in place or far in place:
                continue
            if pruned and not _reaches_border(graph, far, place, clearance):
                continue
            gateways.append(_as_gateway(graph.nodes[base]["o"], data["pts"], clearance))
        del key
    return read_stars(gateways, (float(centre[0]), float(centre[1])))[0].star


def _find_place(graph: Any, clearance: np.ndarray) -> set[int]:
    """Return the junctions of the place nearest to the middle."""
    junctions = [n for n in graph.nodes if graph.degree(n) >= 3]
    if not junctions:
        return set()
    spots = np.array([graph.nodes[n]["o"] for n in junctions], float)
    radii = np.array([clearance[tuple(spot.astype(int))] for spot in spots], float)
    middle = (np.array(clearance.shape) - 1) / 2
    tree = cKDTree(spots)
    place = {int(np.hypot(*(spots - middle).T).argmin())}
    stack, most = list(place), float(radii.max())
    while stack:
        i = stack.pop()
        for j in tree.query_ball_point(spots[i], most):
            if j not in place and math.dist(spots[i], spots[j]) <= max(radii[i], radii[j]):
                place.add(j)
                stack.append(j)
    return {junctions[i] for i in place}


def _read_path(graph: Any, clearance: np.ndarray) -> Star:
    """Return the star of a skeleton without junctions: the two ways along its longest edge."""
    edges = [data["pts"] for _, _, data in graph.edges(data=True) if len(data["pts"]) > 2]
    if not edges:
        return Star(())
    points = max(edges, key=len)
    middle = (np.array(clearance.shape) - 1) / 2
    k = int(np.hypot(*(points - middle).T).argmin())
    ways = [points[k:], points[: k + 1][::-1]]
    height, width = clearance.shape
    gateways = []
    for way in ways:
        y, x = way[-1]
        if min(y, x, height - 1 - y, width - 1 - x) <= 3 and len(way) > 2:
            gateways.append(_as_gateway(points[k], way, clearance))
    return read_stars(gateways, (float(points[k][1]), float(points[k][0])))[0].star


def _reaches_border(graph: Any, start: int, place: set[int], clearance: np.ndarray) -> bool:
    """Tell whether an arm comes as near to the border as a corridor that leads out does."""
    rest = nx.Graph(graph.subgraph(set(graph.nodes) - place))
    height, width = clearance.shape
    for node in nx.node_connected_component(rest, start):
        y, x = (int(v) for v in graph.nodes[node]["o"])
        if min(y, x, height - 1 - y, width - 1 - x) <= max(3.0, 1.2 * clearance[y, x]):
            return True
    return False


def _as_gateway(base: np.ndarray, cells: np.ndarray, clearance: np.ndarray) -> Gateway:
    """Return the gateway on an edge, one clearance away from its base."""
    points = cells[:, ::-1].astype(float)
    start = base[::-1].astype(float)
    if math.dist(points[0], start) > math.dist(points[-1], start):
        points = points[::-1]
    radius = float(clearance[tuple(base.astype(int))])
    gap = np.hypot(*(points - start).T)
    part = points[(gap >= radius) & (gap <= 3 * radius)]
    part = part if len(part) > 2 else points
    centred = part - part.mean(axis=0)
    dx, dy = np.linalg.svd(centred, full_matrices=False)[2][0]
    if (part[-1] - part[0]) @ (dx, dy) < 0:
        dx, dy = -dx, -dy
    x, y = (part[0] if len(part) else start).tolist()
    ends = ((x + dy * radius, y - dx * radius), (x - dy * radius, y + dx * radius))
    return Gateway((x, y), ends, math.atan2(dy, dx), 2 * radius)
