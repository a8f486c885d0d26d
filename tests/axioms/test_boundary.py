"""Left and right of a path against the geometry of the world that was driven through."""

import random
from itertools import combinations, pairwise, permutations

import pytest
import worlds

from hssh_kb.boundary import find_boundaries
from hssh_kb.hypothesis import Hypothesis


def true_map(world, route, rotations):
    """The map in which each cell is one place."""
    first = {}
    visits = [first.setdefault(cell, v) for v, cell in enumerate(route)]
    offsets = []
    for v, cell in enumerate(route):
        size = len(world.star(cell)[0])
        offsets.append((rotations[v] - rotations[visits[v]]) % size)
    return Hypothesis(tuple(visits), tuple(offsets)), first


def expose(world, route, line):
    """Cells to which one steps off a line of cells to its left and right, and the ways beyond."""
    driven = {frozenset(pair) for pair in pairwise(route)}
    heading = (line[1][0] - line[0][0], line[1][1] - line[0][1])
    sides = {"left": set(), "right": set()}
    beyond = {}
    for one, other in (pair for edge in driven for pair in permutations(edge, 2)):
        if other in line:
            continue
        if one not in line:
            beyond.setdefault(one, set()).add(other)
            continue
        turn = heading[0] * (other[1] - one[1]) - heading[1] * (other[0] - one[0])
        if turn:
            sides["left" if turn > 0 else "right"].add(other)
    return sides, beyond


def spread(start, beyond, abnormal):
    """Cells reached from the first ones, none of them abnormal."""
    region = set(start) - abnormal
    todo = list(region)
    while todo:
        for other in beyond.get(todo.pop(), set()) - abnormal - region:
            region.add(other)
            todo.append(other)
    return region


def regions_by_force(world, route, line):
    """Try every set of abnormal cells, small ones first; keep the minimal ones that do."""
    sides, beyond = expose(world, route, line)
    cells = sorted(spread(sides["left"] | sides["right"], beyond, set()))
    minimal = []
    for count in range(len(cells) + 1):
        for some in combinations(cells, count):
            abnormal = set(some)
            if any(kept <= abnormal for kept, _, _ in minimal):
                continue
            left = spread(sides["left"], beyond, abnormal)
            right = spread(sides["right"], beyond, abnormal)
            if not left & right:
                minimal.append((abnormal, left, right))
    abnormal, left, right = zip(*minimal, strict=True)
    return set.intersection(*left), set.intersection(*right), set.union(*abnormal), len(minimal)


@pytest.mark.parametrize("seed", range(12))
def test_regions_are_those_of_brute_force_in_the_plane(seed):
    rng = random.Random(seed)
    world = worlds.grid(3, 3) if seed % 2 else worlds.random_world(rng)
    route = worlds.random_walk(rng, world, 24)
    rotations = [rng.randrange(4) for _ in route]
    experience = world.drive(route, rotations)
    hypothesis, first = true_map(world, route, rotations)
    cells = {v: cell for cell, v in first.items()}
    checked = 0
    for boundary in find_boundaries(experience, hypothesis):
        line = [cells[p] for p in boundary.on]
        place, k = boundary.path
        arms = world.star(cells[place], rotations[place])[1]
        arm = next(a for a, index in arms.items() if index == k)
        line.sort(key=lambda c, d=world.arms[arm]: c[0] * d[0] + c[1] * d[1])
        if len(line) < 2:
            continue
        left, right, both, choices = regions_by_force(world, route, line)
        assert boundary.complete
        assert boundary.choices == choices
        assert {cells[p] for p in boundary.left} == left
        assert {cells[p] for p in boundary.right} == right
        assert {cells[p] for p in boundary.abnormal} == both
        checked += bool(left or right)
    assert checked or seed % 2 == 0


def test_no_place_lies_on_a_path_and_beside_it():
    world, route = worlds.REFERENCES["grid-3x3-ltplus"][:2]
    hypothesis, _ = true_map(world, route, [0] * len(route))
    for boundary in find_boundaries(world.drive(route), hypothesis):
        groups = [set(boundary.on), set(boundary.left), set(boundary.right)]
        groups.append(set(boundary.abnormal))
        assert sum(map(len, groups)) == len(set.union(*groups))
