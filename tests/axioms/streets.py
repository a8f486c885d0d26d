"""Witnesses for the sides of a street: what lies left and right of it, by brute force."""

from __future__ import annotations

import random

import worlds
from asking import Witness, find_sides, make_witness
from test_boundary import regions_by_force, true_map

from hssh_kb.finished import claim_to_facts

STREETS = ((0, 4), (5, 8), (6, 12))


def make_street(walk: tuple[int, int]) -> Witness:
    """The sides of a street that ends in the middle of a grid, so that one can go round its end."""
    seed, length = walk
    rng = random.Random(seed)
    edges = worlds.grid(3, 3).edges - {frozenset(((1, 1), (2, 1)))}
    world = worlds.World(map(tuple, edges))
    line = [(0, 1), (1, 1)]
    about = worlds.random_walk(rng, world, length)
    route = [*line, *_go(world, line[-1], about[0]), *about[1:]]
    rotations = [rng.randrange(4) for _ in route]
    hypothesis, first = true_map(world, route, rotations)
    left, right, both, choices = regions_by_force(world, route, line)
    sides = [sorted(first[cell] for cell in cells) for cells in (left, right)]
    texts, index = world.star((0, 1), rotations[0])
    forth = index[1]
    other = next(k for k, t in enumerate(texts) if k != forth and t[0] == texts[forth][0])
    if other < forth:  # the path is then named after its other direction
        sides.reverse()
    return make_witness(
        f"sides of a street, walk {seed}",
        ["experience", "map", "named", "boundary"],
        f"{claim_to_facts(world.drive(route, rotations), hypothesis)} "
        f"asked(path(0,{min(forth, other)})). #show. #show beside/3. #show abnormal/2.",
        (*sides, sorted(first[cell] for cell in both), choices),
        find_sides,
    )


def _go(world: worlds.World, start: worlds.Cell, goal: worlds.Cell) -> list[worlds.Cell]:
    """A shortest way, the start left out, the goal in; none if one is there."""
    ways = [[start]]
    while True:
        way = ways.pop(0)
        if way[-1] == goal:
            return way[1:]
        ways += [[*way, cell] for cell in world.neighbours(way[-1])]
