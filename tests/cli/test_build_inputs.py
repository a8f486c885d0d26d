"""``hssh build`` on floor maps and bags, and its options by kind of input."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "perception"))

from floor_plans import draw_office, write_ros_map


@pytest.fixture
def office(tmp_path):
    return write_ros_map(tmp_path, draw_office().image())


def test_a_floor_map_is_built_and_questioned(hssh, office, tmp_path):
    names = tmp_path / "rooms.yaml"
    names.write_text(
        "rooms:\n  lab: [[3, 10], [8, 10], [8, 15], [3, 15]]\n"
        "  library: [[15, 10], [20, 10], [20, 15], [15, 15]]\n"
    )
    kb = tmp_path / "office.hssh"
    built = hssh("build", office, "--names", names, "-o", kb, "--json")
    assert built.code == 0
    assert built.document["places"] == 10
    assert built.document["scans"] == 0
    route = hssh("route", kb, "lab", "library")
    assert route.code == 0
    assert "library" in route.out
    assert hssh("check", kb).code == 0
    assert hssh("show", kb, "-o", tmp_path / "office.png").code == 0


def test_what_is_left_out_is_told_with_a_start_that_works(hssh, tmp_path):
    office = write_ros_map(tmp_path, draw_office().carve(2, 0.5, 6, 2).image())
    kb = tmp_path / "office.hssh"
    answer = hssh("build", office, "-o", kb)
    assert answer.code == 0
    start = answer.err.split("--start=")[1].split(")")[0]
    other = hssh("build", office, "-o", kb, f"--start={start}", "--json")
    assert other.document["places"] == 2


IDLE = {
    "poses of a floor map": ["MAP", "--poses", "odometry"],
    "maps of a floor map": ["MAP", "--best", "3"],
    "budget of a floor map": ["MAP", "--budget", "3"],
    "scan of a floor map": ["MAP", "--scan", "/scan"],
    "names of a trace": ["TRACE", "--names", "rooms.yaml"],
    "start of a trace": ["TRACE", "--start", "1,2"],
    "odometry topic of a trace": ["TRACE", "--odom", "/odom"],
    "force on a trace": ["TRACE", "--force"],
}


@pytest.mark.parametrize("case", IDLE)
def test_options_without_effect_are_usage_errors(hssh, office, traces, tmp_path, case):
    stands = {"MAP": office, "TRACE": traces / "ring-2x2-l.json"}
    words = [stands.get(word, word) for word in IDLE[case]]
    answer = hssh("build", *words, "-o", tmp_path / "x.hssh")
    assert answer.code == 2
    assert "no effect" in answer.err
    assert not (tmp_path / "x.hssh").exists()


def test_bad_maps_are_bad_input(hssh, office, tmp_path):
    office.write_text(office.read_text().replace("resolution: 0.05", "resolution: -1"))
    answer = hssh("build", office, "-o", tmp_path / "x.hssh")
    assert answer.code == 3
    assert "'resolution'" in answer.err
    assert len(answer.err.splitlines()) == 1
