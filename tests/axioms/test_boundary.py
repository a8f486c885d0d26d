"""Left and right of a path against the geometry of the world that was driven through."""

import random
from itertools import pairwise

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


def regions_by_geometry(world, route, line):
    """Cells left and right (west, east or north, south) reached without meeting a line of cells."""
    driven = {frozenset(pair) for pair in pairwise(route)}

    def neighbours(cell):
        return [next(iter(edge - {cell})) for edge in driven if cell in edge]

    heading = (line[1][0] - line[0][0], line[1][1] - line[0][1])
    sides = {"left": set(), "right": set()}
    for cell in line:
        for other in neighbours(cell):
            if other in line:
                continue
            dx, dy = other[0] - cell[0], other[1] - cell[1]
            turn = heading[0] * dy - heading[1] * dx
            if turn:
                sides["left" if turn > 0 else "right"].add(other)
    for region in sides.values():
        todo = list(region)
        while todo:
            for other in neighbours(todo.pop()):
                if other not in line and other not in region:
                    region.add(other)
                    todo.append(other)
    both = sides["left"] & sides["right"]
    return sides["left"] - both, sides["right"] - both, both


@pytest.mark.parametrize("seed", range(12))
def test_regions_are_those_of_the_plane(seed):
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
        left, right, both = regions_by_geometry(world, route, line)
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
        assert sum(map(len, groups)) == len(set.union(*groups))
