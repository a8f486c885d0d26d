"""The demonstration's comparison with the truth; the demonstration itself is a benchmark."""

import dataclasses

import networkx as nx
import numpy as np
import pytest
from small_kbs import make_kb

from hssh_kb.demo import compare_with_truth
from perception.scanlog import ScanLog
from perception.world import World

PASSES = ["00", "10", "20", "21", "11", "01", "00", "10", "11"]


@pytest.fixture(scope="module")
def kb():
    return make_kb()


def world_of(kb):
    truth = nx.Graph()
    for name, scan in zip(PASSES, kb.trajectory.visit_scans, strict=True):
        x, y = kb.trajectory.poses[scan, :2]
        truth.add_node(name, x=float(x), y=float(y), kind="L")
    return World("grid", (20.0, 20.0), np.zeros((0, 4)), {}, {}, {}, truth, tuple(PASSES))


def log_of(kb):
    poses = kb.trajectory.poses
    count = len(poses)
    ranges = np.ones((count, 2), np.float32)
    return ScanLog("drive", np.arange(count) * 1.0, ranges, np.zeros(2), truth=poses)


def test_the_true_map_is_said_to_be_true(kb):
    truth = compare_with_truth(kb, world_of(kb), log_of(kb))
    assert truth.passed == tuple(PASSES)
    assert truth.visits == tuple(PASSES)
    assert truth.faults == ()


def with_visits(kb, visits):
    wrong = dataclasses.replace(kb.hypothesis(), visits=visits)
    ranked = dataclasses.replace(kb.ranked, maps=(wrong,))
    return dataclasses.replace(kb, ranked=ranked, layouts=())


def test_a_place_held_for_two_is_found(kb):
    right = kb.hypothesis().visits
    wrong = with_visits(kb, (*right[:6], 6, *right[7:]))
    (fault,) = compare_with_truth(wrong, world_of(kb), log_of(kb)).faults
    assert fault == "v6: 00 is P0 and again P6"


def test_two_places_held_for_one_are_found(kb):
    right = kb.hypothesis().visits
    wrong = with_visits(kb, (*right[:8], 3))
    faults = compare_with_truth(wrong, world_of(kb), log_of(kb)).faults
    assert "v8: P3 is 21, but this visit was at 11" in faults


def test_a_missed_pass_and_a_visit_to_no_place_are_found(kb):
    world = world_of(kb)
    world.truth.remove_node("21")
    faults = compare_with_truth(kb, world, log_of(kb)).faults
    assert any("v3 (P3) is at no place" in fault for fault in faults)
    world = world_of(kb)
    x, y = kb.trajectory.poses[4, :2]
    world.truth.add_node("between", x=float(x), y=float(y), kind="T")
    faults = compare_with_truth(kb, world, log_of(kb)).faults
    assert any("2 made no visit" in fault for fault in faults)
