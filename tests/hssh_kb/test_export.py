"""Exports: what goes out can be read back, by us or by others."""

import json
import re

import cv2
import numpy as np
import pytest
from small_kbs import make_kb

from hssh_kb.errors import NoAnswerError, UsageError
from hssh_kb.export import document_kb, export_kb
from hssh_kb.kb import KnowledgeBase
from hssh_kb.trace import experience_from_data


@pytest.fixture(scope="module")
def kb():
    return make_kb({2: "lift lobby"})


def test_json_holds_all_but_images(kb, tmp_path):
    (path,) = export_kb(kb, tmp_path / "kb.json")
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["schema"] == "hssh.kb/1"
    assert experience_from_data(document["experience"]).visits == kb.experience.visits
    best = document["maps"]["maps"][0]
    assert [f"P{p}" for p in kb.hypothesis().visits] == best["visits"]
    assert best["layout"]["places"] == [place["place"] for place in best["places"]]
    layout = kb.layout(1)
    assert np.allclose(best["layout"]["poses"], layout.poses, atol=1e-6)
    assert np.allclose(best["layout"]["covariances"], layout.covariances)
    assert {edge["path"] for edge in best["edges"]} <= {path["name"] for path in best["paths"]}
    assert document["maps"]["maps"][1]["layout"] is None
    assert np.allclose(document["trajectory"]["poses"], kb.trajectory.poses, atol=1e-6)
    assert document["trajectory"]["corrected"] is None
    assert document["names"] == {"v2": "lift lobby"}
    assert document["record"]["seconds"] == {"read": 0.25}


def test_the_exported_trace_gives_the_same_maps(traces):
    kb = KnowledgeBase.open(traces / "grid-3x3-ltplus.json")
    experience = experience_from_data(document_kb(kb)["experience"])
    assert KnowledgeBase.from_experience(experience).hypotheses == kb.hypotheses


def test_ros_map(kb, tmp_path):
    path, description = export_kb(kb, tmp_path / "office.pgm")
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(image, kb.global_map.image)
    entries = dict(line.split(": ", 1) for line in description.read_text().splitlines())
    assert json.loads(entries["image"]) == "office.pgm"
    assert float(entries["resolution"]) == kb.global_map.frame.resolution_m
    left, bottom, yaw = map(float, re.findall(r"-?[\d.]+", entries["origin"]))
    # The lower left corner of the lower left pixel, half a cell from that pixel's centre.
    corner = kb.global_map.frame.to_metres(np.array([-0.5, image.shape[0] - 0.5]))
    assert (left, bottom, yaw) == pytest.approx((*corner, 0.0), abs=1e-6)
    assert entries["negate"] == "0"


def test_logic_program(kb, tmp_path):
    (path,) = export_kb(kb, tmp_path / "kb.lp")
    text = path.read_text(encoding="utf-8")
    assert len(re.findall(r"\bvisit\(\d+\)", text)) == len(kb.experience)


def test_faults(kb, traces, tmp_path):
    with pytest.raises(UsageError, match=r"\.json, \.lp, \.pgm"):
        export_kb(kb, tmp_path / "kb.xml")
    with pytest.raises(NoAnswerError, match="no global map"):
        export_kb(KnowledgeBase.open(traces / "ring-2x2-l.json"), tmp_path / "x.pgm")
    assert list(tmp_path.iterdir()) == []
