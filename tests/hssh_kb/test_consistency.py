"""The incremental judge against the logic program, the reference counts, and by hand."""

import numpy as np
import pytest
from symbolic_walks import Eyes, follow_route, make_grid, observe, walk_randomly

from hssh_kb.consistency import MapState, judge_hypothesis
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.maps import enumerate_maps
from hssh_kb.trace import make_experience
from perception.star import Dlp, Star

RING = [(0, 0), (1, 0), (1, 1), (0, 1)] * 2 + [(0, 0)]
EIGHT = "(0,0)(1,0)(2,0)(2,1)(1,1)(0,1)(0,0)(1,0)(1,1)(2,1)(2,0)(1,0)(0,0)"
NINE = [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1), (0, 2), (1, 2), (2, 2)]
BACK = [(2, 1), (2, 0), (1, 0), (1, 1), (1, 2), (0, 2), (0, 1), (0, 0)]


def grow_all(experience, *, order=True, planarity=True):
    """All maps by growing MapState, as sorted (visits, offsets, readings)."""
    layer = []
    for i, reading in enumerate(experience.visits[0].readings):
        layer.append((MapState.start(reading.star), 0, (0,), (0,), (i,), (0,)))
    for v in range(1, len(experience)):
        grown = []
        for state, place, visits, offsets, readings, firsts in layer:
            before = experience.visits[v - 1].readings[readings[-1]]
            depart = (before.depart + offsets[-1]) % len(before.star)
            for i, now in enumerate(experience.visits[v].readings):
                gateway = now.star.opposite(now.arrive)
                fresh = state.add_place(now.star)
                ways = [(fresh, len(state.stars), 0, v, (*firsts, v))]
                for q, star in enumerate(state.stars):
                    ways += [(state, q, r, firsts[q], firsts) for r in now.star.isomorphisms(star)]
                for base, q, r, first, known in ways:
                    ends = place, depart, q, (gateway + r) % len(now.star)
                    if base.find_refusal(*ends, order=order, planarity=planarity) is None:
                        grown.append(
                            (
                                base.join(*ends, v),
                                q,
                                (*visits, first),
                                (*offsets, r),
                                (*readings, i),
                                known,
                            )
                        )
        layer = grown
    return sorted((visits, offsets, readings) for _, _, visits, offsets, readings, _ in layer)


def _route(width, cells):
    return [y * width + x for x, y in cells]


@pytest.mark.parametrize(
    ("world", "cells", "counts"),
    [
        (make_grid(2, 2), RING, (9, 8, 8)),
        (make_grid(2, 2, stubs=True), RING, (12827, 1623, 444)),
        (
            make_grid(3, 2),
            [tuple(map(int, c.split(","))) for c in EIGHT[1:-1].split(")(")],
            (11, 11, 11),
        ),
        (make_grid(3, 3), NINE + BACK, (129, 88, 62)),
    ],
    ids=["ring of L", "block of +", "figure-8", "3x3"],
)
def test_reference_counts(world, cells, counts):
    width = max(x for x, _ in cells) + 1
    walk = follow_route(world, _route(width, cells))
    truth = observe(world, walk, Eyes(), np.random.default_rng(0))
    found = [
        len(grow_all(truth.experience, order=order, planarity=planarity))
        for order, planarity in ((False, False), (True, False), (True, True))
    ]
    assert tuple(found) == counts


@pytest.mark.parametrize("seed", range(24))
def test_maps_are_those_of_the_logic_program_on_random_walks(seed):
    rng = np.random.default_rng(seed)
    size = [(2, 2), (3, 2), (3, 3)][seed % 3]
    world = make_grid(*size, stubs=seed % 4 == 3, holes=0.2 * (seed % 2), rng=rng)
    walk = walk_randomly(world, 5 if seed % 4 == 3 else 8, rng)
    eyes = Eyes(wrong=0.15 if seed % 5 == 4 else 0.0)
    truth = observe(world, walk, eyes, rng)
    for order, planarity in ((True, True), (True, False), (False, True)):
        solved = enumerate_maps(truth.experience, order=order, planarity=planarity)
        asserted = sorted(
            (m.visits, m.offsets, m.readings or (0,) * len(m.visits)) for m in solved.maps
        )
        if solved.inconsistent_from is None:
            assert grow_all(truth.experience, order=order, planarity=planarity) == asserted
        else:
            assert grow_all(truth.experience, order=order, planarity=planarity) == []


def test_the_true_map_is_consistent_on_long_walks():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        world = make_grid(6, 6, stubs=seed % 2 == 0, holes=0.15, rng=rng)
        truth = observe(world, walk_randomly(world, 200, rng), Eyes(), rng)
        assert judge_hypothesis(truth.experience, truth.hypothesis()).consistent


def test_what_planarity_alone_forbids_is_refused_by_it_with_travels_around_a_face():
    rng = np.random.default_rng(0)
    world = make_grid(2, 2, stubs=True)
    truth = observe(world, follow_route(world, [0, 1, 3, 2, 0, 1, 3]), Eyes(), rng)
    forbidden = set(grow_all(truth.experience, planarity=False)) - set(grow_all(truth.experience))
    assert forbidden
    for claim in forbidden:
        verdict = judge_hypothesis(truth.experience, Hypothesis(*claim))
        assert verdict.refusal.axiom == "planarity"
        assert set(verdict.refusal.travels) <= set(range(1, verdict.visit))


CROSS = ["a+1", "b+1", "a-1", "b-1"]


def make_star(arms):
    """A star whose arms are all paths of their own."""
    dlps = [Dlp(f"p{k}", "+", 1) for k in range(arms)]
    return Star((*dlps, *(Dlp(f"p{k}", "-", 0) for k in range(arms))))


@pytest.mark.parametrize("seed", range(6))
def test_faces_are_those_of_the_whole_rotation_system(seed):
    """Wild maps, grown at random: gateways share a face exactly if tracing all faces says so."""
    rng = np.random.default_rng(seed)
    stars = [make_star(int(rng.integers(1, 5))) for _ in range(8)]
    state = MapState.start(stars[0])
    for star in stars[1:]:
        state = state.add_place(star)
    gates = [(p, k) for p, star in enumerate(stars) for k in range(len(star))]
    for visit in range(1, 17):
        free = [gate for gate in gates if state.follow(*gate) is None]
        if len(free) < 2:
            break
        _compare_with_faces(state, gates, free)
        fits = [
            (a, b) for a in free for b in free if state.find_refusal(*a, *b, order=False) is None
        ]
        if not fits:
            break
        one, other = fits[int(rng.integers(len(fits)))]
        state = state.join(*one, *other, visit)


def _compare_with_faces(state, gates, free):
    """Hold refusals by planarity against the faces and pieces traced from scratch."""
    size = [len(star) for star in state.stars]
    piece = list(range(len(size)))
    for p, k in gates:
        far = state.follow(p, k)
        if far is not None:
            old = piece[far[0]]
            piece = [piece[p] if c == old else c for c in piece]
    face, around = {}, {}
    for gate in gates:
        at, ring = gate, []
        while at not in face:
            face[at] = gate
            ring.append(at)
            p, k = state.follow(*at) or at
            at = p, (k + 1) % size[p]
        around.setdefault(face[gate], set()).update(
            state.find_travel(*g) for g in ring if state.follow(*g)
        )
    for a in free:
        for b in free:
            refusal = state.find_refusal(*a, *b, order=False)
            if a == b:
                assert refusal.axiom == "reversibility"
            elif piece[a[0]] != piece[b[0]] or face[a] == face[b]:
                assert refusal is None
            else:
                assert refusal.axiom == "planarity"
                assert refusal.travels == tuple(sorted(around[face[a]]))


def test_refusals_name_the_axiom_and_the_travels_it_rests_on():
    # North, back south to the first place, north again.
    experience = make_experience([(CROSS, None, 0), (CROSS, 0, 2), (CROSS, 2, 0), (CROSS, 0, None)])
    verdict = judge_hypothesis(experience, Hypothesis((0, 1, 0, 3), (0, 0, 0, 0)))
    assert (verdict.visit, verdict.refusal.axiom) == (3, "travel_function")
    assert verdict.refusal.travels == (1,)
    verdict = judge_hypothesis(experience, Hypothesis((0, 1, 2, 2), (0, 0, 0, 0)))
    assert verdict.visit == 2
    straight = make_experience([(CROSS, None, 0), (CROSS, 0, 0), (CROSS, 0, None)])
    verdict = judge_hypothesis(straight, Hypothesis((0, 1, 0), (0, 0, 0)))
    assert (verdict.visit, verdict.refusal.axiom) == (2, "order")
    assert verdict.refusal.travels == (1,)
    assert judge_hypothesis(straight, Hypothesis((0, 1, 0), (0, 0, 0)), order=False).consistent


def test_a_doubted_travel_asserts_nothing():
    experience = make_experience([(CROSS, None, 0), (CROSS, 0, 2), (CROSS, 2, 0), (CROSS, 0, None)])
    claim = Hypothesis((0, 1, 0, 3), (0, 0, 0, 0), doubted=(3,))
    verdict = judge_hypothesis(experience, claim)
    assert verdict.consistent
    assert verdict.state.follow(0, 0) == (1, 2)
    one, two, three = verdict.state.component
    assert one == two != three


def test_stars_that_do_not_match_are_no_one_place():
    experience = make_experience(
        [(CROSS, None, 0), (["a+1", "b+1", "a-1", "b-0"], 0, 1), (CROSS, 0, None)]
    )
    verdict = judge_hypothesis(experience, Hypothesis((0, 0, 2), (0, 0, 0)))
    assert (verdict.visit, verdict.refusal.axiom) == (1, "star_isomorphism")


def test_states_are_not_changed_by_growing_them():
    star = make_experience([(CROSS, None, None)]).visits[0].star
    state = MapState.start(star).add_place(star)
    grown = state.join(0, 0, 1, 2, 1)
    assert state.joined == {}
    assert state.component == (0, 1)
    assert grown.component == (0, 0)
    assert grown.follow(1, 2) == (0, 0)
    assert grown.find_travel(0, 0) == 1
    assert grown.find_travel(0, 1) == -1
