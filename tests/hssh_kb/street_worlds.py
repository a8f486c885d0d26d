"""Street graphs and floor graphs as symbolic worlds with true angles.

Places are the nodes where one can choose or must turn; what lies between two of them is one
corridor with its true length. Arms that go on straight enough are opposite ends of one local
path. The world must be one that the theory allows, so what it cannot say is left out: streets
over or under each other (the drawing would not lie in the plane), and the straightest-through
reading of a street that would meet itself (the path ends at its sharpest bend).
"""

from __future__ import annotations

import json
import lzma
import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import networkx as nx
import numpy as np
from networkx.utils import UnionFind
from scipy.spatial import Delaunay
from symbolic_walks import World

from hssh_kb.consistency import MapState
from perception.star import Dlp, Star

Node = Hashable
_STRAIGHT_RAD = math.radians(35.0)
_EARTH_M = 6.371e6


@dataclass(frozen=True)
class Arm:
    """One end of a corridor at a place: corridor, which end, heading [rad] away from the place."""

    corridor: int
    end: int
    heading_rad: float


@lru_cache(maxsize=1)
def read_manhattan(folder: Path) -> World:
    """The street graph of lower and mid Manhattan; every street may be walked both ways."""
    spots, graph = {}, nx.Graph()
    for line in _read_lines(folder / "nodes.txt.xz"):
        name, _, lat, lon = line.split(",")
        spots[name] = math.radians(float(lon)), math.radians(float(lat))
    east, north = (sum(p[k] for p in spots.values()) / len(spots) for k in (0, 1))
    for name, (lon, lat) in sorted(spots.items()):
        spot = _EARTH_M * math.cos(north) * (lon - east), _EARTH_M * (lat - north)
        graph.add_node(name, spot=spot)
    for line in _read_lines(folder / "links.txt.xz"):
        start, _, goal = line.split(",")
        graph.add_edge(start, goal)
    return make_world(graph, merge_m=5.0, corners=False, look_m=12.0)


def _read_lines(path: Path) -> list[str]:
    return lzma.decompress(path.read_bytes()).decode().splitlines()


def read_floor(path: Path) -> World:
    """The largest piece of a navigation graph of one floor; corners are places too."""
    document, graph = json.loads(path.read_text()), nx.Graph()
    for node in document["nodes"]:
        graph.add_node(node["id"], spot=(node["loc"]["x"], node["loc"]["y"]))
    for edge in document["edges"]:
        graph.add_edge(edge["s0_id"], edge["s1_id"])
    return make_world(graph, merge_m=0.0, corners=True, look_m=0.0)


def make_town(crossings: int, seed: int, *, block_m: float = 80.0, shut: float = 0.2) -> World:
    """A town that nobody planned: streets between crossings strewn about, a share of them shut.

    Two crossings are joined if no other lies in the circle over the street between them, which
    leaves a plane graph (Gabriel & Sokal 1969) with corridors of many lengths.
    """
    rng = np.random.default_rng(seed)
    side = math.ceil(math.sqrt(crossings))
    spots = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    spots = block_m * (spots[:crossings] + rng.uniform(-0.4, 0.4, (crossings, 2)))
    graph = nx.Graph()
    for name, spot in enumerate(spots.tolist()):
        graph.add_node(name, spot=tuple(spot))
    triangles = Delaunay(spots).simplices.tolist()
    others: dict[tuple[int, int], list[int]] = {}
    for one in triangles:
        for k in range(3):
            a, b, c = one[k], one[(k + 1) % 3], one[(k + 2) % 3]
            others.setdefault((min(a, b), max(a, b)), []).append(c)
    for (a, b), apexes in sorted(others.items()):
        corners = [np.dot(spots[a] - spots[c], spots[b] - spots[c]) for c in apexes]
        if min(corners) > 0 and rng.random() > shut:
            graph.add_edge(a, b)
    return make_world(graph, merge_m=5.0, corners=False, look_m=12.0)


def make_world(graph: nx.Graph, *, merge_m: float, corners: bool, look_m: float) -> World:
    """Make a world of the largest piece of a graph whose nodes have a ``spot`` (metres).

    Nodes at most ``merge_m`` apart are one place. With ``corners`` a node of two arms is a
    place if they are not opposite. The heading of an arm is where it leads in ``look_m``.
    """
    graph = nx.Graph(graph)
    graph.remove_edges_from(list(nx.selfloop_edges(graph)))
    pieces = sorted(nx.connected_components(graph), key=lambda piece: (-len(piece), min(piece)))
    graph = nx.Graph(graph.subgraph(sorted(pieces[0])))
    _merge_close(graph, merge_m)
    while True:
        corridors = list(_find_corridors(graph, corners))
        looped = [c for c in corridors if c[0] == c[-1]]
        crossing = looped or _find_crossing(graph, corridors, look_m)
        if not crossing:
            return _build(graph, corridors, look_m)
        for corridor in crossing:
            graph.remove_edge(*corridor[:2])
            if len(corridor) > 2:
                graph.remove_nodes_from(corridor[1:-1])


def check_world(world: World) -> tuple[str, ...]:
    """Return the axioms that the finished world breaks; none should be."""
    stars = [Star(tuple(Dlp(n, d, a) for _, n, d, a in dlps)) for dlps in world.dlps]
    state, broken = MapState.start(stars[0]), []
    for star in stars[1:]:
        state = state.add_place(star)
    for (p, k), (q, j) in world.corridors.items():
        refusal = state.find_refusal(p, k, q, j)
        if refusal is None:
            state = state.join(p, k, q, j, 1)
        else:
            broken.append(refusal.axiom)
    return tuple(broken)


def _merge_close(graph: nx.Graph, merge_m: float) -> None:
    def length(edge):
        return math.dist(graph.nodes[edge[0]]["spot"], graph.nodes[edge[1]]["spot"])

    for a, b in sorted(graph.edges, key=length):
        if a in graph and b in graph and length((a, b)) <= merge_m:
            if graph.degree(a) == 2 and graph.degree(b) == 2:
                continue  # both are inside one corridor
            keep, gone = (a, b) if graph.degree(a) >= graph.degree(b) else (b, a)
            graph.add_edges_from((keep, c) for c in list(graph[gone]) if c != keep)
            graph.remove_node(gone)


def _find_corridors(graph: nx.Graph, corners: bool) -> Iterator[list[Node]]:
    """Yield the chains of nodes between places, each once."""
    inner = {n for n in graph if graph.degree(n) == 2 and not (corners and _bends(graph, n))}
    seen = set()
    for node in graph:
        if node in inner:
            continue
        for start in graph[node]:
            chain = [node, start]
            while chain[-1] in inner:
                one, two = graph[chain[-1]]
                chain.append(two if one == chain[-2] else one)
            if (chain[0], chain[1]) not in seen:
                seen |= {(chain[0], chain[1]), (chain[-1], chain[-2])}
                yield chain


def _bends(graph: nx.Graph, node: Node) -> bool:
    one, two = (_look(graph, [node, other], 0.0) for other in graph[node])
    return abs(_turn(one + math.pi, two)) > _STRAIGHT_RAD


def _turn(start: float, goal: float) -> float:
    return (goal - start + math.pi) % (2 * math.pi) - math.pi


def _look(graph: nx.Graph, chain: Sequence[Node], look_m: float) -> float:
    spots = [graph.nodes[n]["spot"] for n in chain]
    gone = 0.0
    for a, b in pairwise(spots):
        gone += math.dist(a, b)
        if gone >= look_m and b != spots[0]:
            break
    return math.atan2(b[1] - spots[0][1], b[0] - spots[0][0])


def _length(graph: nx.Graph, chain: Sequence[Node]) -> float:
    spots = [graph.nodes[n]["spot"] for n in chain]
    return sum(math.dist(a, b) for a, b in pairwise(spots))


def _gather_arms(graph, corridors, look_m) -> dict[Node, list[Arm]]:
    """The arms of each place, clockwise."""
    arms: dict[Node, list[Arm]] = {}
    for e, chain in enumerate(corridors):
        for end, way in ((0, chain), (1, chain[::-1])):
            arms.setdefault(way[0], []).append(Arm(e, end, _look(graph, way, look_m)))
    for at in arms.values():
        at.sort(key=lambda arm: (-arm.heading_rad, arm.corridor, arm.end))
    return arms


def _find_crossing(graph, corridors, look_m) -> list[list[Node]]:
    """The corridors that do not fit in the plane, the short ones having been laid first."""
    arms = _gather_arms(graph, corridors, look_m)
    after, opens = {}, {}
    for at in arms.values():
        ends = [(arm.corridor, arm.end) for arm in at]
        after |= dict(zip(ends, ends[1:] + ends[:1], strict=True))
    pieces = UnionFind(arms)
    crossing = []
    for e in sorted(range(len(corridors)), key=lambda e: _length(graph, corridors[e])):
        start, goal = corridors[e][0], corridors[e][-1]
        if pieces[start] != pieces[goal] or _share_face(after, opens, (e, 0), (e, 1)):
            opens |= {(e, 0): (e, 1), (e, 1): (e, 0)}
            pieces.union(start, goal)
        else:
            crossing.append(corridors[e])
    return crossing


def _share_face(after, opens, start, goal) -> bool:
    """Whether two arms not laid yet open into one face; ``opens`` are the ends of those laid."""
    one = two = None
    while one != start and two != goal:
        # From both at once: the two parts of a face are seldom of one size.
        one = _step_round(after, opens, start if one is None else one)
        two = _step_round(after, opens, goal if two is None else two)
        if one == goal or two == start:
            return True
    return False


def _step_round(after, opens, arm):
    """The next arm round a face, clockwise from an arm or from the far end of its corridor."""
    return after[opens.get(arm, arm)]


def _build(graph, corridors, look_m) -> World:
    arms = _gather_arms(graph, corridors, look_m)
    through = {node: _pair_arms(at) for node, at in arms.items()}
    places = list(arms)
    number = {node: p for p, node in enumerate(places)}
    _cut_paths(corridors, arms, through)
    dlps, slot = [], {}
    for node in places:
        rows, taken = [], set()
        for arm in arms[node]:
            far = through[node].get(arm)
            if arm in taken:
                continue
            taken |= {arm, far}
            name = chr(ord("a") + len(rows) // 2)
            back = arm.heading_rad + math.pi if far is None else far.heading_rad
            rows += [(arm.heading_rad, name, "+", 1, arm), (back, name, "-", int(bool(far)), far)]
        rows.sort(key=lambda row: (-_turn(0.0, row[0]), row[1], row[2]))
        for k, row in enumerate(rows):
            if row[4] is not None:
                slot[row[4].corridor, row[4].end] = number[node], k
        dlps.append(tuple((_turn(0.0, h), name, way, alpha) for h, name, way, alpha, _ in rows))
    joins, lengths = {}, {}
    for e, chain in enumerate(corridors):
        for end in (0, 1):
            joins[slot[e, end]] = slot[e, 1 - end]
            lengths[slot[e, end]] = _length(graph, chain)
    spots = tuple(graph.nodes[node]["spot"] for node in places)
    return World(spots, tuple(dlps), joins, lengths)


def _pair_arms(at: Sequence[Arm]) -> dict[Arm, Arm]:
    """Opposite arms, the straightest pairs first."""
    pairs = sorted(
        (abs(_turn(a.heading_rad + math.pi, b.heading_rad)), i, j)
        for i, a in enumerate(at)
        for j, b in enumerate(at[:i])
    )
    out: dict[Arm, Arm] = {}
    for bend, i, j in pairs:
        if bend <= _STRAIGHT_RAD and at[i] not in out and at[j] not in out:
            out[at[i]], out[at[j]] = at[j], at[i]
    return out


def _cut_paths(corridors, arms, through) -> None:
    """End a path at its sharpest bend wherever it would pass one place twice."""
    where = {(arm.corridor, arm.end): (n, arm) for n in arms for arm in arms[n]}
    again = True
    while again:
        again = False
        for e in range(len(corridors)):
            for end in (0, 1):
                again = _cut_one(where, through, e, end) or again


def _cut_one(where, through, e, end) -> bool:
    """Follow a path from one corridor on; cut it if it meets itself. Returns whether it did."""
    passed = [(where[e, end][0], None)]
    spots = {passed[0][0]: 0}
    while True:
        node, arm = where[e, 1 - end]
        if node in spots:
            loop = passed[spots[node] + 1 :]
            here, came = max(
                loop,
                key=lambda one: abs(
                    _turn(one[1].heading_rad + math.pi, through[one[0]][one[1]].heading_rad)
                ),
            )
            out = through[here].pop(came)
            del through[here][out]
            return True
        on = through[node].get(arm)
        if on is None:
            return False
        spots[node] = len(passed)
        passed.append((node, arm))
        e, end = on.corridor, on.end
