"""Genus of one finished map, in plain Python: quick enough to be asked at every step of a search.

The axiom itself is ``axioms/14_planarity.lp``; tests hold the two equal.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis

Gate = tuple[int, int]


def joined_gateways(
    experience: Experience, hypothesis: Hypothesis, trusted: Collection[int] | None = None
) -> dict[Gate, Gate]:
    """Return which gateway (place, dlp) each travelled gateway is joined to.

    Parameters
    ----------
    experience, hypothesis : a map in which travel is a reversible function.
    trusted : visits whose star is believed; all by default. Doubted travels join nothing.
    """
    links: dict[Gate, Gate] = {}
    for v in range(1, len(hypothesis.visits)):
        if v in hypothesis.doubted:
            continue
        if trusted is not None and (v not in trusted or v - 1 not in trusted):
            continue
        before, now = hypothesis.reading(experience, v - 1), hypothesis.reading(experience, v)
        if before.depart is None or now.arrive is None:
            continue
        out = hypothesis.place_dlp(experience, v - 1, before.depart)
        into = hypothesis.place_dlp(experience, v, now.star.opposite(now.arrive))
        links[out], links[into] = into, out
    return links


def is_planar(
    experience: Experience, hypothesis: Hypothesis, trusted: Collection[int] | None = None
) -> bool:
    """Return whether the rotation system of a map has genus 0, piece by piece.

    Source
    ------
    Euler's formula V - E + F = 2 for each connected piece, faces traced through the stars;
    Beeson, Modayil & Kuipers 2010, section 6.3 (planarity, after Savelli & Kuipers 2004).
    """
    links = joined_gateways(experience, hypothesis, trusted)
    believed = range(len(hypothesis.visits)) if trusted is None else trusted
    size = {hypothesis.visits[v]: len(hypothesis.reading(experience, v).star) for v in believed}
    pieces = _count_pieces(size, links)
    todo = {(p, k) for p, m in size.items() for k in range(m)}
    faces = 0
    while todo:
        start = gate = todo.pop()
        faces += 1
        while True:
            p, k = links.get(gate, gate)
            gate = (p, (k + 1) % size[p])
            if gate == start:
                break
            todo.discard(gate)
    bare = sum(1 for m in size.values() if m == 0)
    return len(size) - len(links) // 2 + faces + bare == 2 * pieces


def _count_pieces(places: Collection[int], links: dict[Gate, Gate]) -> int:
    root = {p: p for p in places}

    def find(p: int) -> int:
        while root[p] != p:
            p = root[p]
        return p

    for (p, _), (q, _) in links.items():
        root[find(p)] = find(q)
    return sum(1 for p in places if find(p) == p)


def make_planarity_test(
    experience: Experience, count: int
) -> Callable[[Sequence[int], Sequence[int]], bool]:
    """Return a quick test of the maps of the first visits, for experiences with one reading each.

    The test takes ``visits`` and ``offsets`` of a map in which travel is a reversible function,
    and traces faces through travelled gateways only: stubs change no face.
    """
    legs = []
    width = max((len(visit.star) for visit in experience.visits), default=0) + 1
    for v in range(1, count):
        before, now = experience.visits[v - 1], experience.visits[v]
        if before.depart is not None and now.arrive is not None:
            came = now.star.opposite(now.arrive)
            legs.append((v - 1, before.depart, len(before.star), v, came, len(now.star)))

    def test(visits: Sequence[int], offsets: Sequence[int]) -> bool:
        link: dict[int, int] = {}
        for u, depart, m, v, came, n in legs:
            out = visits[u] * width + (depart + offsets[u]) % m
            into = visits[v] * width + (came + offsets[v]) % n
            link[out] = into
            link[into] = out
        if not link:
            return True
        following = _next_clockwise(sorted(link), width)
        todo = set(link)
        faces = 0
        while todo:
            start = gate = todo.pop()
            faces += 1
            while (gate := following[link[gate]]) != start:
                todo.discard(gate)
        return len(set(visits)) - len(link) // 2 + faces == 2

    return test


def _next_clockwise(gates: Sequence[int], width: int) -> dict[int, int]:
    """Return the next travelled gateway at the same place; gateways are place * width + dlp."""
    following: dict[int, int] = {}
    first = last = gates[0]
    place = first // width
    for gate in gates[1:]:
        if gate // width == place:
            following[last] = gate
        else:
            following[last] = first
            first, place = gate, gate // width
        last = gate
    following[last] = first
    return following
