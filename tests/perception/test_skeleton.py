"""Regions, skeletons and their pruning."""

import numpy as np

from perception.core import find_core
from perception.grid import classify
from perception.pruning import find_closest, prune
from perception.region import Region, find_region
from perception.skeleton import OPEN, build_skeleton
from tests.perception.corpus import PLUS, SHAPES, draw_fine, scale


def region_of(image: np.ndarray, robot: tuple[float, float], radius: float = 0) -> Region:
    return find_region(
        classify(image), robot, radius_px=radius, min_frontier_px=0, island_px=len(image) / 5
    )


def corridor(height: int = 101, walls: tuple[int, int] = (30, 70)) -> np.ndarray:
    image = np.zeros((height, 200), np.uint8)
    image[walls[0] + 1 : walls[1]] = 255
    return image


def test_corridor_has_two_walls_two_exits_one_straight_branch() -> None:
    region = region_of(corridor(), (100, 50))
    assert len(region.exits) == 2
    assert sorted(exit_.width_px for exit_ in region.exits) == [39, 39]
    assert set(region.arc) == {0, 1}
    skeleton = build_skeleton(region, midline_px=40)
    (branch,) = skeleton.branches
    assert np.abs(branch.points_px[:, 1] - 50).max() < 1e-9
    assert np.abs(branch.radius_px - 19.5).max() < 1e-9
    assert {skeleton.nodes[branch.tail].exit, skeleton.nodes[branch.head].exit} == {0, 1}


def test_left_and_right_wall_are_told_apart_in_both_directions() -> None:
    region = region_of(corridor(), (100, 50))
    (branch,) = build_skeleton(region, midline_px=40).branches
    for one in (branch, branch.reversed()):
        eastward = one.points_px[-1, 0] > one.points_px[0, 0]
        left = region.walls[one.left[len(one.left) // 2]]
        assert (left[1] < 50) == eastward  # looking east in an image, left is up


def test_rough_walls_make_no_branches() -> None:
    rng = np.random.default_rng(2)
    image = corridor()
    for column in range(0, 200, 3):
        image[30 : 31 + rng.integers(0, 9), column : column + 3] = 0
    skeleton = build_skeleton(region_of(image, (100, 50)), midline_px=40)
    assert len(skeleton.branches) == 1
    assert not skeleton.junctions()


def test_crossing_has_one_place_and_four_arms() -> None:
    region = region_of(scale(draw_fine(PLUS, 17, 900), 201), (100, 100))
    skeleton = prune(build_skeleton(region, midline_px=40), region, min_depth_px=0)
    core = find_core(skeleton, region)
    assert core.at_junction
    assert len(core.arms) == 4
    assert np.hypot(*(core.base_px - 100).T).max() < 3


def test_wide_space_is_followed_along_its_walls() -> None:
    image = np.zeros((300, 300), np.uint8)
    image[:, 50:250] = 255
    skeleton = build_skeleton(region_of(image, (150, 150)), midline_px=60)
    columns = sorted({round(float(b.points_px[:, 0].mean())) for b in skeleton.branches})
    assert len(columns) == 2
    assert abs(columns[0] - 109) <= 1
    assert abs(columns[1] - 190) <= 1
    for branch in skeleton.branches:
        assert (branch.left == OPEN).all() != (branch.right == OPEN).all()


def test_dead_end_branches_go_and_loops_stay() -> None:
    image = corridor()
    image[60:95, 90:110] = 255  # a closed alcove
    region = region_of(image, (50, 50))
    pruned = prune(build_skeleton(region, midline_px=40), region, min_depth_px=0)
    assert len(pruned.branches) == 1
    image = np.zeros((300, 300), np.uint8)
    image[50:250, 50:250] = 255
    image[100:200, 100:200] = 0
    image[140:160, :50] = 255
    region = region_of(image, (60, 150))
    pruned = prune(build_skeleton(region, midline_px=60), region, min_depth_px=0)
    assert len(pruned.junctions()) == 1
    assert len(pruned.branches) == 2


def test_exit_of_one_contour_is_found_though_one_wall_surrounds_it() -> None:
    shape = next(s for s in SHAPES if s.name == "dead end")
    region = region_of(scale(draw_fine(shape, 0, 900), 151), (75, 75))
    assert len(region.exits) == 1
    assert set(region.arc) == {0, 1}
    assert build_skeleton(region, midline_px=30).branches


def test_robot_radius_closes_gaps() -> None:
    image = corridor()
    image[:, 150:153] = 0
    image[48:53, 150:153] = 255  # a gap of five cells
    assert len(region_of(image, (80, 50)).exits) == 2
    assert len(region_of(image, (80, 50), radius=4).exits) == 1


def test_closest_point_is_reached_through_free_space() -> None:
    image = np.zeros((120, 300), np.uint8)
    image[10:50, :] = 255
    image[52:110, :] = 255
    image[50:52, 280:] = 255  # the two corridors meet at the far right only
    region = region_of(image, (60, 47))
    skeleton = build_skeleton(region, midline_px=200)
    index, k = find_closest(skeleton, region, (60, 47))
    assert skeleton.branches[index].points_px[k, 1] < 50
