"""Skeletons that are changed: parts, dead ends, small loops; and distances along a branch."""

import numpy as np
import pytest

from perception.grid import classify
from perception.pruning import prune
from perception.region import Region, find_region
from perception.skeleton import Branch, Node, Skeleton
from perception.skeleton_graph import SkeletonGraph

Point = tuple[float, float]


def link(tail: int, head: int, start: Point, end: Point, size: int) -> Branch:
    points = np.linspace(start, end, size)
    wall = np.zeros(size, np.int64)
    return Branch(tail, head, points, np.full(size, 3.0), wall, wall)


def join(*branches: Branch) -> Skeleton:
    nodes = dict[int, Node]()
    for branch in branches:
        for node, k in ((branch.tail, 0), (branch.head, -1)):
            nodes.setdefault(node, Node(tuple(branch.points_px[k].tolist()), 3.0))
    return Skeleton(nodes, list(branches))


def open_room() -> Region:
    image = np.full((120, 120), 255, np.uint8)
    return find_region(classify(image), (60, 60), radius_px=0, min_frontier_px=0, island_px=0)


def test_parts_are_told_apart_and_one_is_kept() -> None:
    far = link(5, 6, (90, 90), (90, 110), 20)
    skeleton = join(link(0, 1, (0, 0), (9, 0), 10), far, link(1, 2, (9, 0), (9, 20), 15))
    graph = SkeletonGraph(skeleton)
    assert sorted(map(sorted, graph.list_parts())) == [[0, 2], [1]]
    assert graph.degrees() == {node: graph.degree(node) for node in skeleton.nodes}
    graph.keep_largest()
    assert sorted(graph.branches) == [0, 2]
    graph = SkeletonGraph(skeleton)
    graph.keep_largest(1)
    assert graph.to_skeleton().branches == [far]


@pytest.mark.parametrize("swap", [False, True])
def test_of_two_dead_ends_the_shorter_goes_first(swap: bool) -> None:
    ends = [link(1, 2, (60, 60), (60, 80), 21), link(1, 3, (60, 60), (60, 30), 31)]
    path = link(0, 1, (0, 60), (60, 60), 61)
    skeleton = join(path, *(ends[::-1] if swap else ends))
    skeleton.nodes[0] = Node((0, 60), 3.0, exit=0)
    (left,) = prune(skeleton, open_room(), min_depth_px=0).branches
    assert {left.tail, left.head} == {0, 3}
    assert len(left.points_px) == 61 + 31


def test_small_loops_go_and_what_they_parted_is_joined() -> None:
    ways = [link(0, 1, (0, 0), (40, 0), 41), link(2, 3, (46, 0), (90, 0), 45)]
    around = [link(1, 2, (40, 0), (46, 0), 7), link(1, 2, (40, 0), (46, 0), 9)]
    graph = SkeletonGraph(join(*ways, *around))
    graph.drop_tiny_loops(8)
    assert len(graph.branches) == 4
    graph.drop_tiny_loops(12)
    (whole,) = graph.branches.values()
    assert {whole.tail, whole.head} == {0, 3}
    assert len(whole.points_px) == 41 + 7 + 45


@pytest.mark.parametrize(("k", "distance", "expected"), [(0, 2.5, 3), (10, 2.5, 3), (19, 100.0, 0)])
def test_points_within_a_distance_of_a_point(k: int, distance: float, expected: int) -> None:
    branch = link(0, 1, (0, 0), (19, 0), 20)
    first, last = branch.within(k, distance)
    assert (
        (first, last) == (max(k - expected + 1, 0), min(k + expected, 20)) if expected else (0, 20)
    )
    turning = np.concatenate([branch.points_px, branch.points_px[::-1]])
    there_and_back = Branch(0, 1, turning, *(np.zeros(40),) * 3)
    assert there_and_back.within(0, 2.5) == (0, 3), (
        "a branch that comes back is not looked at again"
    )


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 90.0, -120.0])
def test_bend_of_a_branch(turn_deg: float) -> None:
    x, y = 20 * np.cos(np.radians(turn_deg)), 20 * np.sin(np.radians(turn_deg))
    bent = link(0, 1, (0, 0), (20, 0), 21).joined(link(1, 2, (20, 0), (20 + x, y), 21))
    bends = bent.measure_bends(np.array([5, 20, 36]), np.full(3, 4.0))
    assert np.degrees(bends).round(6).tolist() == [0.0, abs(turn_deg), 0.0]
