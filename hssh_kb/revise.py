"""Revisions of a whole map: merge places that lie on each other, split one, believe a travel.

Best-first search decides visit by visit; a mistake made early is paid for much later, by when
thousands of leaves share it. A revision takes a map that has explained many visits and threads
them anew through a changed assignment of places; every map it makes is an ordinary node of
the tree, judged and scored like all others.

Source: ours.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hssh_kb.map_tree import MapTree
from hssh_kb.node import Decision, Node, Option


@dataclass(frozen=True)
class Change:
    """What to change in a map.

    Attributes
    ----------
    key : name of the change.
    labels : the place wanted for each visit; equal labels, one place.
    believed : travels not to be doubted if they can stand.
    blamed : travels to be doubted.
    stars : reading to take at the first visit of a place, by that visit.
    """

    key: tuple[object, ...]
    labels: Sequence[int]
    believed: frozenset[int] = frozenset()
    blamed: frozenset[int] = frozenset()
    stars: Mapping[int, int] = field(default_factory=dict)


_WORTH_NATS = 3.0
_MOST_MERGERS = 24
_PATIENCE_NATS = 40.0


def revise_map(
    tree: MapTree, node: Node, is_over: Callable[[], bool], known: set[object]
) -> Iterator[Node]:
    """Yield maps of the same visits that beat a map, each better than the one before.

    Parameters
    ----------
    tree, node : the map to revise.
    is_over : tells when to stop (the budget is spent).
    known : what was tried already, so that nothing is tried twice; added to.
    """
    improved = True
    while improved and not is_over():
        improved = False
        for change in _list_changes(tree, node):
            if is_over():
                return
            if (node.serial, change.key) in known:
                continue
            known.add((node.serial, change.key))
            made = _try_change(tree, node, change, is_over)
            if made is not None:
                node, improved = made, True
                yield node
                break


def _try_change(
    tree: MapTree, node: Node, change: Change, is_over: Callable[[], bool]
) -> Node | None:
    """Return the changed map if it is better; first as strictly as the change says."""
    goal = node.score + 1e-9
    for loose in (False, True) if tree.score.slip else (True,):
        if is_over():
            return None
        made = thread_visits(tree, node, change, loose=loose)
        if made is not None and made.score <= goal and change.key[0] == "merge":
            made = _merge_on(tree, made, goal, is_over, loose)
        if made is not None and made.score > goal:
            return made
    return None


def _merge_on(
    tree: MapTree, node: Node, goal: float, is_over: Callable[[], bool], loose: bool
) -> Node | None:
    """Return a map better than the goal by more mergers; None if none is met.

    A stretch of corridor held twice is only worth merging as a whole: the first mergers cost
    more than they save.
    """
    failed: set[tuple[int, int]] = set()
    for _ in range(_MOST_MERGERS):
        if is_over() or node.score < goal - _PATIENCE_NATS:
            return None
        chain = node.chain()[1:]
        labels = [one.decision.place for one in chain]
        first = {label: v for v, label in reversed(list(enumerate(labels)))}
        for pair in _find_near_places(tree, node):
            visits = first[pair[0]], first[pair[1]]
            if visits in failed:
                continue
            if is_over():
                return None
            change = Change(("merge", *pair), merge_labels(labels, [pair]))
            made = thread_visits(tree, node, change, loose=loose)
            if made is not None and made.places < node.places:
                node = made
                break
            failed.add(visits)
        else:
            return None
        if node.score > goal:
            return node
    return None


def merge_labels(labels: list[int], pairs: Sequence[tuple[int, int]]) -> list[int]:
    """Return the labels with pairs of places made one, each place in one pair at most."""
    into: dict[int, int] = {}
    used: set[int] = set()
    for one, other in pairs:
        if one not in used and other not in used:
            used |= {one, other}
            into[other] = one
    return [into.get(label, label) for label in labels]


def _list_changes(tree: MapTree, node: Node) -> Iterator[Change]:
    """Yield what to try, the most promising first."""
    chain = node.chain()[1:]
    labels = [one.decision.place for one in chain]
    doubted = frozenset(one.visit for one in chain if one.decision.doubted)
    pairs = _find_near_places(tree, node)
    if len(pairs) > 1:
        yield Change(("all",), merge_labels(labels, pairs))
    for pair in pairs:
        yield Change(("merge", *pair), merge_labels(labels, [pair]))
    for v in _find_blamed(tree, chain):
        yield Change(("blame", v), labels, doubted - {v}, frozenset((v,)))
    for v in sorted(doubted):
        yield Change(("believe", v), labels, frozenset((v,)))
    touched = {labels[v] for travel in doubted for v in (travel - 1, travel)}
    for one in chain:
        if one.is_new and one.decision.place in touched and labels.count(one.decision.place) > 1:
            for j in range(len(tree.visits[one.visit].readings)):
                if j != one.decision.reading:
                    yield Change(("read", one.visit, j), labels, doubted, stars={one.visit: j})
    for one in chain:
        if not one.is_new and sum(one.addends[:2]) < -4 * _WORTH_NATS:
            split = list(labels)
            split[one.visit] = max(labels) + 1
            yield Change(("split", one.visit), split)


def _find_blamed(tree: MapTree, chain: Sequence[Node]) -> list[int]:
    """Return the travels that keep doubted ones from being believed, the worst first."""
    counts: Counter[int] = Counter()
    for one in chain:
        if one.decision.doubted and one.parent is not None and one.parent.visit >= 0:
            option = tree.weigh(one.parent, one.decision._replace(doubted=False))
            if option is not None and option.refusal is not None:
                counts.update(option.refusal.travels)
    return [v for v, _ in sorted(counts.items(), key=lambda item: (-item[1], item[0]))]


def _find_near_places(tree: MapTree, node: Node) -> list[tuple[int, int]]:
    """Return the pairs of places that may well be one, the likeliest first."""
    filter_ = tree.state_of(node).filter
    n = len(filter_.places)
    blocks = filter_.cov.reshape(n + 1, 3, n + 1, 3)[1:, :2, 1:, :2]
    own = np.einsum("iaib->iab", blocks)
    i, j = np.triu_indices(n, 1)
    cross = blocks[i, :, j, :]
    cov = own[i] + own[j] - cross - cross.transpose(0, 2, 1)
    extra = 2 * tree.score.spread_m**2 + (0.05 * tree.score.length_m) ** 2
    a, b, d = cov[:, 0, 0] + extra, cov[:, 0, 1], cov[:, 1, 1] + extra
    gap = filter_.mean[1:, :2][i] - filter_.mean[1:, :2][j]
    x, y = gap[:, 0], gap[:, 1]
    det = np.maximum(a * d - b * b, 1e-24)
    worth = -0.5 * (d * x * x - 2 * b * x * y + a * y * y) / det
    worth -= 0.5 * np.log(det) + math.log(2 * math.pi)
    good = np.flatnonzero(worth > -math.log(tree.score.area_m2) - _WORTH_NATS)
    good = good[np.argsort(-worth[good], kind="stable")][:_MOST_MERGERS]
    return [(int(filter_.places[i[k]]), int(filter_.places[j[k]])) for k in good]


def thread_visits(
    tree: MapTree,
    donor: Node,
    change: Change,
    *,
    loose: bool = False,
    worse_nats: float = math.inf,
) -> Node | None:
    """Return the map of the donor's visits with a change, None if it cannot stand.

    Readings, offsets and doubts are kept where they can stand and chosen anew, greedily,
    where they cannot.

    Parameters
    ----------
    tree, donor, change : what to make of what.
    loose : where a visit cannot be at the place wanted for it without doubt, it is where it
        fits best, and so are the later visits to that place: what was made one drags its
        neighbours along.
    worse_nats : give up where the map is so much worse [nats] than the donor at the same visit.
    """
    chain = donor.chain()[1:]
    labels, stars = change.labels, change.stars
    changed = _find_changed(chain, labels) | {labels[v] for v in stars}
    number: dict[int, int] = {}
    node = chain[0].parent
    for one in chain:
        if node is None:
            return None
        v, label = one.visit, labels[one.visit]
        place = number.get(label, -1)
        wanted = one.decision._replace(place=place if place >= 0 else node.places)
        if v in change.believed or v in change.blamed:
            wanted = wanted._replace(doubted=v in change.blamed)
        if place < 0 and label in changed:
            read = stars[v] if v in stars else _choose_reading(tree, labels, v)
            wanted = wanted._replace(offset=0, reading=read)
        known = node.children.get(wanted) if node.children else None
        if known is None or (label in changed and node.visit >= 0) or v in change.believed:
            known = _take_best(tree, node, wanted, place, v in change.blamed, loose)
        if known is None or known.score < one.score - worse_nats:
            return None
        number.setdefault(label, known.decision.place)
        if known is not one and node.parent is not None:
            tree.release(node.parent)
        node = known
    return node


def _find_changed(chain: Sequence[Node], labels: Sequence[int]) -> set[int]:
    """Return the labels whose visits are not those of one place of the donor."""
    old: dict[int, set[int]] = {}
    new: dict[int, set[int]] = {}
    for one in chain:
        old.setdefault(one.decision.place, set()).add(one.visit)
        new.setdefault(labels[one.visit], set()).add(one.visit)
    kept = {frozenset(group) for group in old.values()}
    return {label for label, group in new.items() if frozenset(group) not in kept}


def _choose_reading(tree: MapTree, labels: Sequence[int], first: int) -> int:
    """Return the reading of a first visit that the other visits of its place agree with best."""
    group = [v for v in range(first + 1, len(labels)) if labels[v] == labels[first]]
    best, chosen = -math.inf, 0
    for j, reading in enumerate(tree.visits[first].readings):
        worth = math.log(reading.weight)
        for v in group:
            fits = [
                math.log(other.weight)
                for i, other in enumerate(tree.visits[v].readings)
                if tree.isomorphisms(v, i, first, j)
            ]
            worth += max(fits, default=tree.score.floor)
        if worth > best:
            best, chosen = worth, j
    return chosen


def _take_best(
    tree: MapTree, node: Node, wanted: Decision, place: int, blamed: bool, loose: bool
) -> Node | None:
    """Return the best child that takes the next visit as wanted, or else as fits best."""
    if node.visit < 0:
        return None
    v, ways = node.visit + 1, [wanted]
    if place >= 0:
        state = tree.state_of(node)
        first, read_as = state.firsts[place], state.place_readings[place]
        ways = [
            Decision(place, offset, i, False)
            for i in range(len(tree.visits[v].readings))
            for offset in tree.isomorphisms(v, i, first, read_as)
        ]
    options = [option for one in ways for option in _weigh_ways(tree, node, one, blamed)]
    best = _find_best(options)
    if loose and (best is None or (best.decision.doubted and not blamed)):
        # A gateway that is known to lead elsewhere may be better followed than doubted.
        best = _find_best([best, *tree.options(node, lean=True)])
    return None if best is None else tree.child(node, best)


def _weigh_ways(
    tree: MapTree, node: Node, decision: Decision, blamed: bool
) -> Iterator[Option | None]:
    """Yield a decision believed and doubted, as far as either is worth weighing."""
    if not blamed:
        believed = tree.weigh(node, decision._replace(doubted=False))
        yield believed
        stands = believed is not None and believed.refusal is None
        if stands and tree.visits[node.visit + 1].readings[0].headings:
            return  # where headings are known, doubt only costs
    if tree.score.slip:
        yield tree.weigh(node, decision._replace(doubted=True))


def _find_best(options: Sequence[Option | None]) -> Option | None:
    allowed = [option for option in options if option is not None and option.refusal is None]
    return max(allowed, key=lambda option: sum(option.addends), default=None)
