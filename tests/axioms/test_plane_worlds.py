"""The theory against its twin in worlds in general position: Y, K, psi, five ways and the rest."""

import math

import pytest
from comparing import PlaneWalk, find_differences
from plane_worlds import SHAPES, PlaneWorld

from hssh_kb.maps import enumerate_maps
from perception.star import Star

FAST = {"most": 200, "longest": 7}
# Beeson 2008, section 5.1, and the ways of such a place: degrees counter-clockwise from east.
PUBLISHED = {
    "+": ((0, 90, 180, 270), "a+1 b+1 a-1 b-1"),
    "X": ((20, 80, 200, 260), "a+1 b+1 a-1 b-1"),
    "T": ((0, 180, 270), "a-0 b+1 a+1 b-1"),
    "L": ((0, 90), "a+1 b+1 a-0 b-0"),
    "Y": ((30, 150, 270), "a-0 b+1 c-0 a+1 b-0 c+1"),
    "K": ((90, 270, 45, 320), "a+1 b+1 c+1 a-1 b-0 c-0"),
    "psi": ((90, 270, 45, 135), "a+1 b+1 c-0 a-1 b-0 c+1"),
    "straight": ((0, 180), "a+1 a-1"),
    "dead end": ((0,), "a+1 a-0"),
}


def place(degrees):
    ends = [(math.cos(math.radians(d)), math.sin(math.radians(d))) for d in degrees]
    return PlaneWorld([(0.0, 0.0), *ends], [(0, i + 1) for i in range(len(ends))])


@pytest.mark.parametrize("shape", PUBLISHED)
def test_stars_are_the_published_ones(shape):
    degrees, star = PUBLISHED[shape]
    world = place(degrees)
    assert world.shape(0) == shape
    assert Star.parse(world.star(0)[0]).isomorphisms(Star.parse(star.split()))


def test_five_ways_are_told_by_which_lead_on():
    stars = [place(d) for d in ((0, 72, 144, 216, 288), (0, 60, 120, 180, 250))]
    assert [world.shape(0) for world in stars] == ["5-armed", "5-armed"]
    sizes = [len(world.star(0)[0]) for world in stars]
    assert sizes == [10, 8]


@pytest.mark.parametrize("chunk", range(6))
def test_maps_equal_those_of_the_twin(chunk):
    for seed in range(chunk * 10, chunk * 10 + 10):
        walk = PlaneWalk(seed, **FAST)
        assert list(find_differences(walk.experience, (seed % 3,))) == [], f"seed {seed}"


def test_the_true_map_is_among_them():
    for seed in range(100, 160):
        walk = PlaneWalk(seed, **FAST)
        true = walk.true_map()
        found = {(h.visits, h.offsets) for h in enumerate_maps(walk.experience).maps}
        assert (true.visits, true.offsets) in found or walk.world.has_circular_path()


def test_every_shape_occurs():
    seen = {shape for seed in range(60) for shape in PlaneWalk(seed, **FAST).shapes}
    assert seen == set(SHAPES)
