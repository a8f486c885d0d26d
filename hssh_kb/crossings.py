"""Two closed ways in the plane cross an even number of times.

A map whose rotation system has genus 0 is one in which any two cycles cross evenly. Where two
cross oddly, some place of the one and some place of the other must be one place that is not yet:
so an odd pair tells all ways to go on towards a planar map, and if there is none, why there is no
planar map.

Source: ours; the crossing number modulo 2 is the intersection form of a surface, which is not
degenerate, so it vanishes exactly on the sphere.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

from hssh_kb.merging import Link, Merging


class Corner(NamedTuple):
    """How a cycle passes through a place.

    Attributes
    ----------
    visit : a visit to the place. between : gateways passed on one side, as bits. used : the two
        gateways used, as bits.
    """

    visit: int
    between: int
    used: int


class Cycle:
    """A simple closed way over links.

    Attributes
    ----------
    chain : its links in order. corners : how it passes through each of its places.
    sides, uses : gateways on one side of it, and used by it, as bits over all gateways.
    """

    def __init__(self, merging: Merging, chain: Sequence[Link]) -> None:
        walk = merging.walk
        self.chain = list(chain)
        self.corners: dict[int, Corner] = {}
        self.sides = self.uses = 0
        for before, after in zip([self.chain[-1], *self.chain[:-1]], self.chain, strict=True):
            place, came = divmod(before.far, walk.width)
            out = merging.links[after.far].far - place * walk.width
            size = walk.sizes[place]
            between = 0
            k = (came + 1) % size
            while k != out:
                between |= 1 << k
                k = (k + 1) % size
            used = 1 << came | 1 << out
            self.corners[place] = Corner(after.here, between, used)
            self.sides |= between << (place * walk.width)
            self.uses |= used << (place * walk.width)

    def crosses(self, other: Cycle) -> bool:
        """Return whether the two cross an odd number of times."""
        return bool((self.sides & other.uses).bit_count() & 1)


class Candidate(NamedTuple):
    """Two places that may be one: gateway k of the place of ``one`` is k + turn of ``other``."""

    one: int
    other: int
    turn: int


def find_cycles(merging: Merging) -> list[Cycle]:
    """Return cycles from which all others are made: one for each link outside a spanning forest."""
    width = merging.walk.width
    around: dict[int, list[Link]] = {}
    for gate, link in merging.links.items():
        around.setdefault(gate // width, []).append(link)
    came: dict[int, Link | None] = {}
    depth: dict[int, int] = {}
    tree: set[int] = set()
    for root in sorted(around):
        if root in came:
            continue
        came[root], depth[root] = None, 0
        queue = [root]
        for p in queue:
            for link in around[p]:
                q = link.far // width
                if q not in came:
                    came[q], depth[q] = link, depth[p] + 1
                    tree |= {link.far, merging.links[link.far].far}
                    queue.append(q)
    cycles = []
    for gate, link in merging.links.items():
        if gate < link.far and gate not in tree:
            cycles.append(Cycle(merging, _close(merging, link, came, depth)))
    return cycles


def _close(
    merging: Merging, link: Link, came: dict[int, Link | None], depth: dict[int, int]
) -> list[Link]:
    """Return the cycle of a link and the ways in the tree from its ends to where they meet."""
    width, links = merging.walk.width, merging.links
    start, end = links[link.far].far // width, link.far // width
    there, back = list[Link](), list[Link]()  # down to the start; up from the end
    while start != end:
        if depth[start] >= depth[end]:
            step = came[start]
            if step is None:
                break
            there.append(step)
            start = links[step.far].far // width
        else:
            step = came[end]
            if step is None:
                break
            up = links[step.far]
            back.append(up)
            end = up.far // width
    return [*reversed(there), link, *back]


def find_odd_pairs(cycles: Sequence[Cycle]) -> list[tuple[Cycle, Cycle]]:
    """Return the pairs of cycles that cross an odd number of times, short ones first."""
    odd = [pair for pair in combinations(cycles, 2) if pair[0].crosses(pair[1])]
    return sorted(odd, key=lambda pair: len(pair[0].chain) * len(pair[1].chain))


def measure_oddness(cycles: Sequence[Cycle]) -> int:
    """Return twice the genus: the rank, modulo 2, of which cycles cross oddly."""
    rows = [
        sum(1 << j for j, other in enumerate(cycles) if one is not other and one.crosses(other))
        for one in cycles
    ]
    rank = 0
    while rows:
        row = rows.pop()
        if row:
            rank += 1
            low = row & -row
            rows = [r ^ row if r & low else r for r in rows]
    return rank


def find_candidates(merging: Merging, one: Cycle, other: Cycle) -> list[Candidate]:
    """Return all mergers of two places that change how two cycles cross from odd to even.

    In any planar map that comes of a merging, one of these holds.
    """
    walk, seen = merging.walk, set[tuple[int, int]]()
    found = list[Candidate]()
    for p, q in product(one.corners, other.corners):
        if p == q or (p, q) in seen:
            continue
        seen |= {(p, q), (q, p)}
        size = walk.sizes[p]
        found += [
            Candidate(p, q, turn)
            for turn in walk.turns(p, q)
            if _changes(one, other, p, q, turn, size) and not merging.is_refused(p, q, turn)
        ]
    return found


def _changes(one: Cycle, other: Cycle, p: int, q: int, turn: int, size: int) -> bool:
    """Return whether gateway k of p being k + turn of q makes an odd number of crossings more."""
    odd = False
    for a, b, r in ((p, q, turn), (q, p, -turn % size)):
        mine, theirs = one.corners.get(a), other.corners.get(b)
        if mine is not None and theirs is not None:
            moved = (mine.between << r | mine.between >> (size - r)) & ((1 << size) - 1)
            odd ^= bool((moved & theirs.used).bit_count() & 1)
    return odd


def explain_odd_pair(merging: Merging, one: Cycle, other: Cycle) -> int:
    """Return why two cycles cross oddly and no candidate but those found is left."""
    reason = merging.explain_cycle(one.chain) | merging.explain_cycle(other.chain)
    for place, corner in one.corners.items():
        if place in other.corners:
            reason |= merging.explain(corner.visit, other.corners[place].visit)
    for held in merging.refused:
        for a, b, r in ((held.one, held.other, held.turn), (held.other, held.one, -held.turn)):
            p, q = merging.place[a], merging.place[b]
            if p == q or p not in one.corners or q not in other.corners:
                continue
            size = merging.walk.sizes[p]
            turn = (r + merging.turn[b] - merging.turn[a]) % size
            if _changes(one, other, p, q, turn, size):
                reason |= held.reason | merging.explain(a, one.corners[p].visit)
                reason |= merging.explain(b, other.corners[q].visit)
    return reason
