"""The map of a passage: a crossing looks the same from whichever side it was entered."""

from types import SimpleNamespace

import numpy as np
import pytest
from segment_world import HALF_TURN, cast, follow

from perception.lpm import HIGHEST, LocalMap
from perception.places import (
    PlaceSettings,
    _Candidate,
    _drop_glimpses,
    _is_walled_off,
    _Passage,
    _passage,
)
from perception.revisit import REACH_M, find_walled_off, look_again, map_passage, touches_wall
from perception.scanlog import ScanLog
from perception.sightings import Sighting


def wall(*corners):
    corners = np.array(corners, float)
    return np.stack([corners[:-1], corners[1:]], axis=1)


TEE = np.concatenate(
    [
        wall((-15, 1), (15, 1)),
        wall((-15, -1), (-1, -1), (-1, -12)),
        wall((15, -1), (1, -1), (1, -12)),
    ]
)
"""A corridor along x, another that joins it from the south."""

ROOM = np.concatenate(
    [
        wall((-15, 1), (15, 1)),
        wall((-15, -1), (-0.8, -1)),
        wall((0.8, -1), (15, -1)),
        wall((-0.8, -1), (-3, -1.2), (-3, -7), (3, -7), (3, -1.2), (0.8, -1)),
    ]
)
"""A corridor along x, with a room to the south."""
ROUND = [(-9, 0), (0, 0), (0, -5), (2, -5), (2, -3), (-2, -3), (-2, -5), (0, -5), (0, 0), (9, 0)]
"""A drive into the room, round it, and on."""


def record(corners, walls=TEE) -> ScanLog:
    poses = follow(corners)
    ranges = np.array([cast(walls, pose, HALF_TURN) for pose in poses], np.float32)
    ranges[~np.isfinite(ranges)] = np.nan
    return ScanLog("drive", np.arange(len(poses), dtype=float), ranges, HALF_TURN, corrected=poses)


@pytest.mark.parametrize("way", [[(-9, 0), (9, 0)], [(9, 0), (-9, 0)], [(-9, 0), (0, 0), (0, -9)]])
def test_the_star_is_the_same_from_whichever_side_a_crossing_is_entered(way):
    log = record(way)
    poses, centre = log.corrected, np.zeros(2)
    away = np.hypot(*poses[:, :2].T)
    nearest = int(np.argmin(away))
    inside = np.flatnonzero(away < 1.5)
    local = map_passage(log, poses, centre, nearest, PlaceSettings())
    span = int(inside[0]), nearest, int(inside[-1])
    seen = look_again(local, poses, centre, span, PlaceSettings())
    assert len(seen) >= 5
    for sighting in seen:
        assert str(sighting.topology.star) == "a+1 b+1 a-1 b-0"
        assert np.hypot(*sighting.centre_m) < 0.5


@pytest.mark.parametrize("way", [[(-9, 0), (9, 0)], ROUND])
def test_a_room_is_a_way_whether_it_was_passed_by_or_seen_to_its_end(way):
    log = record(way, ROOM)
    poses, centre = log.corrected, np.zeros(2)
    nearest = int(np.argmin(np.hypot(*poses[:, :2].T)))
    local = map_passage(log, poses, centre, nearest, PlaceSettings())
    seen = look_again(local, poses, centre, (nearest - 2, nearest, nearest + 2), PlaceSettings())
    assert {str(sighting.topology.star) for sighting in seen} == {"a+1 b+1 a-1 b-0"}


def test_scans_from_farther_away_do_not_count():
    log = record([(-13, 0), (13, 0)])
    far = np.flatnonzero(np.hypot(*log.corrected[:, :2].T) > REACH_M)
    assert len(far) > 1
    log.ranges_m[far] = 0.2  # as if somebody stood before the robot
    local = map_passage(log, log.corrected, np.zeros(2), len(log) // 2, PlaceSettings())
    column, row = np.rint(local.frame.to_pixels(np.array([6.8, 0.0]))).astype(int)
    assert local.log_odds[row, column] < 0


def test_a_place_seen_from_afar_only_is_not_visited():
    log = record([(-9, 0), (-3.5, 0)])
    poses = log.corrected
    for centre, visited in (((5.0, 0.0), False), ((-4.0, 0.2), True)):
        sighting = Sighting(len(log) - 2, poses[-2], np.array(centre), 0.9, None, 1.0, None, None)
        passage = _passage(_Candidate([sighting]), poses, PlaceSettings())
        assert (passage is not None) is visited


@pytest.mark.parametrize(("gap_m", "parted"), [(0.4, True), (1.6, False)])
def test_what_lies_behind_a_row_of_pillars_is_walled_off(gap_m, parted):
    local = LocalMap()
    pillars = np.arange(-6.0, 6.0, gap_m + 0.2) + gap_m / 2 + 0.1
    for x in pillars:
        column, row = np.rint(local.frame.to_pixels(np.array([x, 1.0]))).astype(int)
        local.log_odds[row - 1 : row + 1, column - 1 : column + 1] = HIGHEST
    middle = (pillars[len(pillars) // 2] + pillars[len(pillars) // 2 - 1]) / 2
    pose = np.array([middle, 0.0, 0.0])
    points = np.array([[middle, 2.0], [middle, -2.0]])
    assert find_walled_off(local, pose, points, 0.8).tolist() == [parted, False]
    assert touches_wall(local, np.array([pillars[0], 1.2]), 0.4)
    assert not touches_wall(local, np.array([pillars[0], 1.7]), 0.4)


def test_a_place_read_once_gives_way_to_its_neighbour_but_not_to_a_later_visit():
    poses = np.zeros((60, 3))
    poses[:, 0] = np.concatenate([np.arange(30.0), np.arange(29.0, -1.0, -1.0)])

    def passage(scan, centre, times):
        sighting = Sighting(scan, poses[scan], np.array(centre), 1.0, None, 1.0, None, None)
        candidate = _Candidate([sighting] * times)
        return _Passage(candidate, candidate.centre_m, 1.0, scan - 1, scan + 1, scan)

    once, beside = passage(10, (10.0, 0.0), 1), passage(12, (12.0, 0.0), 3)
    later = passage(49, (10.0, 0.0), 3)
    assert _drop_glimpses([once, beside], poses) == [beside]
    assert _drop_glimpses([once, later], poses) == [once, later]


def test_a_large_place_whose_middle_is_a_pillar_is_visited():
    local, robot = LocalMap(), np.array([-1.5, 0.0, 0.0])
    column, row = np.rint(local.frame.to_pixels(np.zeros(2))).astype(int)
    local.log_odds[row - 4 : row + 5, column - 4 : column + 5] = HIGHEST

    def seen(*base):
        topology = SimpleNamespace(base_px=local.frame.to_pixels(np.array(base)))
        return Sighting(0, robot, np.zeros(2), 2.0, None, 1.0, topology, local.frame)

    settings = PlaceSettings()
    for around, walled in (([(-1.0, 1.0), (1.0, 0.0)], False), ([(1.0, 0.0)], True)):
        assert _is_walled_off(_Candidate([seen(*around)]), local, robot, settings) is walled
