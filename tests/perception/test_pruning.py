"""Which exits count: those the robot can follow so far, or only see through."""

import numpy as np
import pytest

from perception.grid import OCCUPIED, UNKNOWN, classify
from perception.region import close_exits, find_region
from perception.sight import look_along, measure_looks
from perception.topology import local_topology

FREE = 255


def draw_strip() -> np.ndarray:
    """A corridor from west to east; of a way south one sees little but for a strip, too narrow."""
    image = np.full((120, 120), UNKNOWN, np.uint8)
    image[48:72] = OCCUPIED
    image[50:70] = FREE
    image[70:, 48:74] = UNKNOWN
    image[70:, 47] = image[70:, 74] = OCCUPIED
    image[70:75, 48:74] = FREE
    image[75:100, 58:63] = FREE
    return image


@pytest.mark.parametrize(("by_sight", "ways"), [(False, 2), (True, 3)])
def test_a_way_seen_to_go_on_counts_where_the_robot_could_not_pass(by_sight: bool, ways: int):
    found = local_topology(
        draw_strip(), resolution_m=0.1, robot_radius_m=0.4, denoise=False, by_sight=by_sight
    )
    assert len(found.gateways) == ways


def test_a_niche_is_no_way_by_sight_either():
    image = draw_strip()
    image[76:, 47:75] = OCCUPIED
    found = local_topology(
        image, resolution_m=0.1, robot_radius_m=0.4, denoise=False, by_sight=True
    )
    assert len(found.gateways) == 2


def test_what_one_sees_through_outlasts_exits_that_are_closed():
    cells = classify(draw_strip())
    how = {"radius_px": 4.0, "min_frontier_px": 9.0, "island_px": 24.0}
    region = find_region(cells, (60.0, 60.0), **how, by_sight=True)
    assert close_exits(region, [0]).seen is cells.free
    assert find_region(cells, (60.0, 60.0), **how).seen is None


def test_looks_end_at_the_first_cell_that_is_not_free():
    free = np.ones((9, 9), bool)
    free[4, 7] = False
    starts = np.array([[2.0, 4.0], [5.0, 4.0]])
    x, y, on = look_along(starts, np.array([[0.0], [np.pi / 2]]), free)
    assert x.shape == y.shape == on.shape == (2, 1, 9)
    assert measure_looks(on).tolist() == [[5.0], [9.0]]
