"""The level: which gateways count."""

import numpy as np
import pytest

from perception.errors import InputError
from perception.level import Level, close_gateways, is_crossed
from perception.topology import local_topology

CELL_M = 0.1


def draw_crossing(side_m=0.8):
    """A corridor 2.4 m wide from west to east, a way south as wide, an opening to the north."""
    image = np.zeros((150, 150), np.uint8)
    image[63:87, :] = 255
    image[87:, 63:87] = 255
    half = round(side_m / CELL_M / 2)
    image[30:63, 75 - half : 75 + half] = 255
    image[:31, 40:110] = 255
    return image


def read(image, level, way_px=None):
    settings = {"resolution_m": CELL_M, "robot_radius_m": 0.3, "min_frontier_m": 0.5}
    topology = local_topology(image, **settings)
    closed = close_gateways(image, topology, level, CELL_M, way_px)
    return topology if closed is None else local_topology(closed, **settings)


def test_a_narrow_opening_counts_only_where_doors_do():
    image = draw_crossing()
    assert sum(read(image, Level()).star.alpha) == 4
    corridors = read(image, Level(min_width_m=1.2))
    assert sum(corridors.star.alpha) == 3
    assert len(corridors.gateways) == 3
    assert len(corridors.star) == 4  # the way south ends here: a T
    assert corridors.at_place


def test_what_is_left_may_be_a_bare_path():
    image = draw_crossing()
    image[87:, :] = 0
    door = read(image, Level())
    assert door.at_place
    path = read(image, Level(min_width_m=1.2))
    assert path.star.alpha == (1, 1)
    assert not path.at_place


def test_a_gateway_that_the_robot_went_through_counts():
    image = draw_crossing()
    north = np.column_stack([np.full(9, 75.0), np.linspace(75, 35, 9)])
    assert sum(read(image, Level(min_width_m=1.2), north).star.alpha) == 4
    east = np.column_stack([150 - north[:, 1], north[:, 0]])
    assert sum(read(image, Level(min_width_m=1.2), east).star.alpha) == 3


def test_nothing_left_is_no_way_out():
    topology = read(draw_crossing(), Level(min_width_m=99.0))
    assert topology.gateways == ()
    assert len(topology.star) == 0


def test_a_dead_end_is_found_behind_a_door_that_is_shut():
    image = draw_crossing()
    image[87:, :] = 0
    image[:, 105:] = 0  # the corridor ends three metres beyond the door
    assert len(read(image, Level()).gateways) == 2
    shut = read(image, Level(min_width_m=1.2))
    assert len(shut.gateways) == 1
    assert shut.base_px[0, 0] > 85


def test_a_level_without_limits_shuts_nothing():
    image = draw_crossing()
    before = image.copy()
    topology = local_topology(image)
    assert Level().admits_all
    assert close_gateways(image, topology, Level(), CELL_M) is None
    assert close_gateways(image, topology, Level(min_width_m=9.0), CELL_M) is not None
    assert (image == before).all()


def test_a_way_crosses_a_gateway_between_its_ends_only():
    topology = local_topology(draw_crossing(1.6), resolution_m=CELL_M)
    north = min(topology.gateways, key=lambda g: g.centre_px[1])
    x, y = north.centre_px
    assert is_crossed(north, [(x, y + 5), (x + 1, y - 5)])
    assert not is_crossed(north, [(x + 30, y + 5), (x + 30, y - 5)])
    assert not is_crossed(north, [(x, y + 9), (x, y + 5)])
    assert not is_crossed(north, np.zeros((0, 2)))


@pytest.mark.parametrize(
    "limits",
    [{"min_width_m": -1.0}, {"min_depth_m": np.nan}, {"min_frontier_m": np.inf}, {"doors": "shut"}],
)
def test_limits_that_mean_nothing_are_refused(limits):
    with pytest.raises(InputError):
        Level(**limits)


@pytest.mark.parametrize(("side_m", "ways"), [(0.8, 3), (1.6, 4)])
def test_a_door_is_narrower_than_half_the_corridor_driven(side_m, ways):
    along = np.column_stack([np.linspace(40, 110, 15), np.full(15, 75.0)])
    seen = read(draw_crossing(side_m), Level(door_share=0.5), along)
    assert sum(seen.star.alpha) == ways
    # Of a corridor whose width nobody knows no opening is too narrow.
    assert sum(read(draw_crossing(side_m), Level(door_share=0.5)).star.alpha) == 4
