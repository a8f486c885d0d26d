"""The level: which gateways count."""

import numpy as np
import pytest

from perception.errors import InputError
from perception.geometry import compose, transform_points
from perception.level import Level, close_gateways, is_crossed
from perception.lpm import LocalMap
from perception.simulate import Lidar, measure_scans
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


def build_doorway(shift_m, door_m=0.9):
    """Walls (n, 4) of a corridor 2.4 m wide with a room behind a door that begins at the shift."""
    low, high, back = 1.2, 1.35, 4.0
    jambs = shift_m, shift_m + door_m
    rows = [(-9, -low, 9, -low), (-9, low, jambs[0], low), (jambs[1], low, 9, low)]
    rows += [(x, low, x, high) for x in jambs]
    rows += [(-2, high, jambs[0], high), (jambs[1], high, 3, high)]
    rows += [(-2, high, -2, back), (3, high, 3, back), (-2, back, 3, back)]
    return np.array(rows, float)


def test_a_door_is_as_wide_as_it_is_however_it_lies_on_the_cells():
    lidar, found = Lidar(beams=181), []
    settings = {"resolution_m": CELL_M, "robot_radius_m": 0.3, "denoise": False}
    for k, turn in enumerate(np.radians([0, 0, 7, 15, 22, 30, 37, 45])):
        poses = np.column_stack([np.arange(-3.0, 4.0, 0.2), np.zeros((35, 2))])
        walls = build_doorway(shift_m=0.013 * k)
        ranges = measure_scans(walls, poses, lidar, np.random.default_rng(k))
        local = LocalMap(9.0, CELL_M)
        for pose, scan in zip(compose(np.array([0, 0, turn]), poses), ranges, strict=True):
            local.add_scan(pose, scan, lidar.angles_rad)
        middle = transform_points(np.array([0, 0, turn]), np.array([[0.5, 0.0]]))[0]
        at = tuple(local.frame.to_pixels(middle).tolist())
        topology = local_topology(local.image(), robot_px=at, **settings)
        doors = [g for g in topology.gateways if np.sin(-g.outward_rad - turn) > 0.7]
        found += [g.neck_px * CELL_M for g in doors]
    assert len(found) == 8
    assert abs(np.mean(found) - 0.9) < 0.05
    assert max(np.abs(np.array(found) - 0.9)) < 0.13
