"""Genus of one finished map, in plain Python: quick enough to be asked at every step of a search.

The axiom itself is ``axioms/14_planarity.lp``; tests hold the two equal.
"""

from __future__ import annotations

from collections.abc import Collection

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
