import numpy as np
import pytest

from perception.errors import InputError
from perception.geometry import wrap_angle
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame
from perception.lpm import LocalMap, OccupancyGrid

ANGLES = np.deg2rad(np.arange(-180.0, 180.0, 1.0))


def square_room_ranges(pose, half_m=3.0):
    """Ranges to the walls of the square |x|, |y| <= half_m."""
    direction = ANGLES + pose[2]
    c, s = np.cos(direction), np.sin(direction)
    c, s = np.where(np.abs(c) < 1e-9, 1e-9, c), np.where(np.abs(s) < 1e-9, 1e-9, s)
    to_x, to_y = (np.sign(c) * half_m - pose[0]) / c, (np.sign(s) * half_m - pose[1]) / s
    return np.minimum(to_x, to_y).astype(np.float32)


def test_room_is_free_inside_walls_occupied_outside_unknown():
    grid = OccupancyGrid(Frame(-5, 5, 0.1), (100, 100))
    grid.add_scan(np.zeros(3), square_room_ranges((0, 0, 0)), ANGLES)
    image = grid.image()

    def at(x, y):
        column, row = np.round(grid.frame.to_pixels(np.array([x, y]))).astype(int)
        return image[row, column]

    assert at(0.5, -0.5) == FREE
    assert at(2.5, 2.0) == FREE
    assert at(3.0, 0.5) == OCCUPIED
    assert at(4.0, 0.0) == UNKNOWN


def test_up_in_the_image_is_y():
    grid = OccupancyGrid(Frame(-5, 5, 0.1), (100, 100))
    ranges = np.full(len(ANGLES), np.nan, np.float32)
    ranges[np.abs(wrap_angle(ANGLES - np.pi / 2)) < 0.1] = 2.0  # one wall ahead of +y only
    grid.add_scan(np.zeros(3), ranges, ANGLES)
    rows, _ = np.nonzero(grid.image() == OCCUPIED)
    assert rows.max() < 50


def test_beam_without_return_clears_nothing():
    grid = OccupancyGrid(Frame(-5, 5, 0.1), (100, 100))
    grid.add_scan(np.zeros(3), np.full(len(ANGLES), np.nan, np.float32), ANGLES)
    assert (grid.image() == UNKNOWN).mean() > 0.999


def test_return_beyond_the_cap_clears_up_to_it():
    grid = OccupancyGrid(Frame(-15, 15, 0.1), (300, 300), range_cap_m=5.0)
    grid.add_scan(np.zeros(3), np.full(len(ANGLES), 9.0, np.float32), ANGLES)
    assert not (grid.image() == OCCUPIED).any()
    assert abs((grid.image() == FREE).sum() * 0.01 - np.pi * 25) < 1.5


def test_scrolling_keeps_the_world_in_place():
    still, moving = LocalMap(8.0), LocalMap(8.0)
    for _ in range(3):
        still.update(np.zeros(3), square_room_ranges((0, 0, 0)), ANGLES)
        moving.update(np.zeros(3), square_room_ranges((0, 0, 0)), ANGLES)
    moving.scroll_to(np.array([1.03, -0.68]))
    assert np.allclose(moving.centre_m, [1.0, -0.7])
    d = np.array([10, 7])
    assert np.array_equal(moving.log_odds[:-7, :-10], still.log_odds[d[1] :, d[0] :])
    moving.scroll_to(np.array([100.0, 0.0]))
    assert not moving.log_odds.any()


def test_overlapping_scans_from_a_moving_robot_agree():
    local = LocalMap(8.0)
    for x in np.linspace(-2, 2, 20):
        pose = np.array([x, 0.3 * x, x])
        local.update(pose, square_room_ranges(pose), ANGLES)
    rows, columns = np.nonzero(local.image() == OCCUPIED)
    points = local.frame.to_metres(np.column_stack([columns, rows]))
    off_wall = np.abs(np.abs(points).max(1) - 3.0)
    assert off_wall.max() < 0.16


def corridor_scan(lost):
    """A scan straight down a corridor of 2 m, the far end out of reach of the lidar."""
    angles = np.deg2rad(np.arange(-90.0, 91.0))
    with np.errstate(divide="ignore"):
        ranges = 1.0 / np.abs(np.sin(angles))
    ranges[ranges > lost] = np.nan
    return ranges.astype(np.float32), angles


def test_a_long_corridor_stays_open_where_the_lidar_does_not_reach_its_end():
    grid = OccupancyGrid(Frame(-15, 15, 0.1), (300, 300))
    grid.add_scan(np.zeros(3), *corridor_scan(lost=30.0))
    row, column = 150, 150 + 100  # ten metres ahead
    assert grid.image()[row, column] == FREE


def test_a_gap_between_near_walls_stays_unknown():
    grid = OccupancyGrid(Frame(-15, 15, 0.1), (300, 300))
    grid.add_scan(np.zeros(3), *corridor_scan(lost=5.0))
    assert grid.image()[150, 150 + 80] == UNKNOWN


def test_the_middle_of_the_window_is_an_lpm_of_its_own():
    whole = LocalMap(15.0)
    whole.scroll_to(np.array([3.0, -2.0]))
    whole.add_scan(np.array([3.0, -2.0, 0.3]), np.full(360, 4.0, np.float32), ANGLES)
    part = whole.shrink_to(6.0)
    assert part.log_odds.shape == LocalMap(6.0).log_odds.shape
    assert np.allclose(part.centre_m, whole.centre_m)
    for point in np.array([(3.0, -2.0), (4.5, -1.0), (2.0, -4.0)]):
        (x, y), (column, row) = (
            np.rint(m.frame.to_pixels(point)).astype(int) for m in (whole, part)
        )
        assert whole.log_odds[y, x] == part.log_odds[row, column]
    part.log_odds += 1  # a copy
    assert whole.log_odds.max() < part.log_odds.max()
    with pytest.raises(InputError, match="smaller than 20"):
        whole.shrink_to(20.0)
