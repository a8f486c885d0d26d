"""A place is the same from whichever side it is entered; a corridor has none."""

import numpy as np
import pytest

from perception.grid import FREE
from perception.places import PlaceSettings, detect_places
from tests.perception.corridor_worlds import draw_corridor, draw_grid, draw_radial
from tests.perception.place_drives import (
    disturb,
    drive_corridor,
    enter_by_all,
    follow,
    judge,
    simulate,
)


@pytest.mark.parametrize("kind", ["+", "L", "dead end"])
def test_a_place_has_the_same_star_from_every_gateway(kind):
    world = draw_radial(kind, seed=4)
    verdict = judge(world, 0, enter_by_all(world, 0, PlaceSettings(), seed=4))
    assert verdict.found == verdict.same == verdict.true == verdict.entries
    assert verdict.right_way == verdict.entries


def test_the_turn_on_the_spot_shows_what_lies_behind():
    world = draw_radial("psi", seed=3)
    verdict = judge(world, 0, enter_by_all(world, 0, PlaceSettings(), seed=3, look=True))
    assert verdict.same == verdict.true == verdict.entries == 4


def test_a_corner_among_open_doors_is_the_same_once_doors_are_ignored():
    world = draw_radial("L", seed=2, rooms=True)
    doors = len(world.segments) > len(draw_radial("L", seed=2).segments)
    assert doors
    settings = PlaceSettings(min_gateway_m=1.05)
    verdict = judge(world, 0, enter_by_all(world, 0, settings, seed=2))
    assert verdict.same == verdict.true == verdict.entries


def test_walking_about_in_a_place_is_one_visit():
    world = draw_radial("T", seed=4)
    ahead = [np.array([np.cos(h), np.sin(h)]) for h, _, _ in world.arms(0)]
    way = np.array([7 * ahead[0], 0 * ahead[0], ahead[1], -0.2 * ahead[1], ahead[2], 6 * ahead[2]])
    rng = np.random.default_rng(5)
    truth = follow(way)
    visits = detect_places(simulate(world.segments, truth, rng), disturb(truth, rng))
    (visit,) = visits
    assert np.hypot(*visit.centre_m) < 1.0
    row, column = np.array(visit.tile.shape) // 2
    at = visit.tile_frame.to_pixels(visit.centre_m)
    assert np.abs(at - [column, row]).max() < 15  # the stored map was taken near the centre
    assert visit.tile[tuple(np.round(at[::-1]).astype(int))] == FREE


def test_a_long_corridor_has_no_place():
    world = draw_corridor(3, 40.0)
    length, strays, entry = drive_corridor(world, PlaceSettings(), seed=3)
    assert length > 25
    assert strays == ()
    assert np.isfinite(entry.log.ranges_m).mean() > 0.9


def test_worlds_are_the_same_for_the_same_seed_and_differ_for_others():
    one, again, other = (draw_grid(seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.segments, again.segments)
    assert one.segments.shape != other.segments.shape or (one.segments != other.segments).any()
    assert all(one.arms(k) for k in range(len(one.nodes)))


def test_a_corner_seen_in_a_bend_beside_it_is_one_place():
    world = draw_grid(10)  # coming from one side, the bend of the skeleton is seen 2 m too early
    entries = enter_by_all(world, 0, PlaceSettings(), seed=10, look=True)
    assert [len(entry.visits) for entry in entries] == [1, 1]
