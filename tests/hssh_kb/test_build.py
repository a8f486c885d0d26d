"""From a log to a knowledge base, on a short drive through the bundled world."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hssh_kb.build import build, build_from_log, settings_for
from hssh_kb.errors import InputError, UsageError
from perception.carmen import write_carmen
from perception.driver import drive, truth_visits
from perception.mapping import mean_distance_m
from perception.scanlog import ScanLog
from perception.world import load_world

LOOP = (
    "south corner east wing",
    "south-east corner",
    "east junction",
    "middle junction",
    "east wing entrance",
    "south corner east wing",
    "south-east corner",
)


@pytest.fixture(scope="module")
def world():
    return load_world()


@pytest.fixture(scope="module")
def log(world):
    return drive(world, tour=LOOP, seed=2, controller="route")


@pytest.fixture(scope="module")
def kb(log):
    return build_from_log(log)


def test_the_loop_is_closed_as_it_was_driven(world, log, kb):
    names = truth_visits(world, log)
    first = {name: names.index(name) for name in names}
    assert kb.hypotheses[0].visits == tuple(first[name] for name in names)


def test_the_trajectory_is_better_than_the_odometry(log, kb):
    ours = mean_distance_m(kb.trajectory.poses, log.truth)
    assert ours < 0.1
    assert ours < 0.5 * mean_distance_m(log.odometry, log.truth)


def test_the_global_map_shows_the_walls_where_they_are(world, log, kb):
    raster = kb.global_map
    free = (raster.image > 205).sum() * raster.frame.resolution_m**2
    assert free > 150  # four corridors of 2.4 m by 9 to 18 m
    columns, rows = np.round(raster.frame.to_pixels(kb.trajectory.poses[:, :2])).astype(int).T
    assert (raster.image[rows, columns] > 205).mean() > 0.98


def test_local_maps_are_stored_around_their_places(kb):
    for raster in kb.lpms.values():
        column, row = np.round(raster.frame.to_pixels(np.zeros(2))).astype(int)
        assert raster.image[row, column] > 205


def test_building_twice_gives_the_same(log, kb):
    again = build_from_log(log)
    assert again.hypotheses == kb.hypotheses
    assert np.array_equal(again.trajectory.poses, kb.trajectory.poses)


def test_a_log_file_gives_the_same_map(log, kb, tmp_path):
    path = tmp_path / "drive.log"
    write_carmen(path, log)
    assert build(path).hypotheses[0].visits == kb.hypotheses[0].visits


def test_corrected_poses_are_taken_as_they_are(log):
    known = replace(log, corrected=log.truth)
    kb = build_from_log(known, poses="corrected")
    assert mean_distance_m(kb.trajectory.poses, log.truth) < 0.15


def test_poses_that_the_log_lacks_are_refused(log):
    with pytest.raises(UsageError, match="no corrected poses"):
        build_from_log(log, poses="corrected")
    with pytest.raises(UsageError, match="no odometry"):
        build_from_log(replace(log, odometry=None), poses="odometry")


def test_a_drive_without_places_says_so():
    angles = np.deg2rad(np.arange(-90.0, 91.0))
    dark = ScanLog(
        "dark.log",
        np.arange(9.0),
        np.full((9, 181), np.nan, np.float32),
        angles,
        odometry=np.zeros((9, 3)),
    )
    with pytest.raises(InputError, match=r"dark\.log: no place was found"):
        build_from_log(dark)


def test_doors_are_kept_or_ignored(log):
    assert settings_for("keep").min_frontier_m < settings_for("ignore").min_frontier_m
    with pytest.raises(UsageError, match="attic"):
        settings_for("attic")
    with pytest.raises(UsageError, match="-1"):
        settings_for("keep", -1.0)


def test_the_level_of_a_map_is_recorded(log, kb):
    narrow = build_from_log(log, doors="keep", min_gateway_m=1.5)
    assert narrow.record.options["doors"] == "keep"
    assert narrow.record.options["min_gateway_m"] == 1.5
    assert kb.record.options["doors"] == "ignore"
    assert narrow.hypotheses[0].visits == kb.hypotheses[0].visits


def test_a_trace_is_built_without_perception(traces):
    kb = build(traces / "office-section5.json")
    assert kb.trajectory is None
    assert kb.record.scans == 0
    assert len(kb.experience) == 2
    assert kb.layouts[0].poses.shape == (2, 3)
    assert np.allclose(kb.layouts[0].poses[1], [4.02, 0.1, 0.02])
    assert json.loads((traces / "office-section5.json").read_text())["schema"] == "hssh.trace/1"
