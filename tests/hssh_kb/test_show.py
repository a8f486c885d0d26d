"""Pictures: their structure, and that they show what is there."""

import dataclasses
import math
import xml.etree.ElementTree as ET
from collections import Counter

import cv2
import numpy as np
import pytest
from small_kbs import STEPS_A_TRAVEL, make_kb

from hssh_kb.errors import InputError, UsageError
from hssh_kb.kb import KnowledgeBase
from hssh_kb.labels import LabelPlacer, find_box
from hssh_kb.map_geometry import find_geometry
from hssh_kb.node_layout import place_nodes
from hssh_kb.png import render_png
from hssh_kb.scene import Bitmap, Disc, Line, Scene, Text
from hssh_kb.show import draw_map, show_map
from hssh_kb.svg import render_svg

SVG = "{http://www.w3.org/2000/svg}"
TRACES = ("ring-2x2-l", "block-2x2-plus", "figure8-3x2-lt", "grid-3x3-ltplus")


@pytest.fixture(scope="module")
def kb():
    return make_kb({2: "lift lobby", 4: 'Müller & "Söhne" <R&D>'})


def structure(svg):
    """What is drawn, without where: element counts of each group."""
    root = ET.fromstring(svg)
    return {
        group.get("id"): dict(sorted(Counter(e.tag.removeprefix(SVG) for e in group).items()))
        for group in root.findall(f"{SVG}g")
    }


def test_golden_structure(golden, kb, traces):
    found = {"kb": structure(render_svg(draw_map(kb, route=kb.route("P0", "P3"))))}
    for name in TRACES:
        trace_kb = KnowledgeBase.open(traces / f"{name}.json")
        found[name] = structure(render_svg(draw_map(trace_kb)))
    golden("pictures.json", found)


def test_everything_is_named(kb):
    root = ET.fromstring(render_svg(draw_map(kb)))
    texts = [e.text for e in root.iter(f"{SVG}text")]
    titles = [place.title for place in kb.graph().places.values()]
    for title in titles:
        assert any(title in text for text in texts)
    for path in kb.graph().paths:
        if path.travelled:
            assert path.name in texts
    assert any("map 1 of 2, rank 1: log posterior -3.5" in text for text in texts)
    assert any(text.endswith(" m") for text in texts)  # the scale bar


@pytest.mark.parametrize("name", [None, *TRACES])
def test_every_number_is_finite_and_on_the_canvas(kb, traces, name):
    shown = kb if name is None else KnowledgeBase.open(traces / f"{name}.json")
    scene = draw_map(shown)
    assert math.isfinite(scene.width * scene.height)
    for item in scene.items:
        if isinstance(item, Line):
            assert np.isfinite(item.points).all()
            assert (item.points > -20).all()
            assert (item.points < [scene.width + 20, scene.height + 20]).all()
        if isinstance(item, Disc | Text):
            assert 0 <= item.x <= scene.width
            assert 0 <= item.y <= scene.height


@pytest.mark.parametrize("name", [None, *TRACES])
def test_labels_do_not_cover_each_other(kb, traces, name):
    scene = draw_map(kb if name is None else KnowledgeBase.open(traces / f"{name}.json"))
    boxes = [find_box(i) for i in scene.items if isinstance(i, Text) and i.group == "names"]
    assert boxes
    for i, a in enumerate(boxes):
        for b in boxes[:i]:
            assert min(a[2], b[2]) <= max(a[0], b[0]) or min(a[3], b[3]) <= max(a[1], b[1])


def test_the_grid_lies_under_the_drive(kb):
    """White corridor where the drive goes: grid and drive share one frame."""
    scene = draw_map(kb)
    (bitmap,) = [item for item in scene.items if isinstance(item, Bitmap)]
    (drive,) = [item for item in scene.items if isinstance(item, Line) and item.group == "drive"]
    columns = ((drive.points[:, 0] - bitmap.x) / bitmap.width * bitmap.pixels.shape[1]).astype(int)
    rows = ((drive.points[:, 1] - bitmap.y) / bitmap.height * bitmap.pixels.shape[0]).astype(int)
    assert (bitmap.pixels[rows, columns] == 255).all()


def test_a_stretch_is_drawn_as_driven_never_as_a_chord(kb):
    poses = kb.trajectory.poses.copy()
    first, last = kb.trajectory.visit_scans[2:4]
    count = last - first + 1
    bulge = 3.0 * np.sin(np.linspace(0, np.pi, count))
    chord = poses[last, :2] - poses[first, :2]
    normal = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
    poses[first : last + 1, :2] += bulge[:, None] * normal
    bent = dataclasses.replace(kb, trajectory=dataclasses.replace(kb.trajectory, poses=poses))
    graph = bent.graph()
    edge = next(e for e in graph.undirected_edges if 3 in e.travels)
    curve = find_geometry(bent, graph).curves[edge.start, edge.dlp]
    assert np.abs((curve - poses[first, :2]) @ normal).max() == pytest.approx(3.0, abs=0.3)
    ends = find_geometry(bent, graph).positions
    assert np.allclose(curve[[0, -1]], [ends[edge.start], ends[edge.goal]])


def test_a_stretch_driven_back_more_straightly_is_drawn_as_then(kb):
    there_and_back = make_kb(cells=(0, 1, 0))
    poses = there_and_back.trajectory.poses.copy()
    poses[1:STEPS_A_TRAVEL, 1] += 1.0  # the way there was no straight line
    drive = dataclasses.replace(there_and_back.trajectory, poses=poses)
    kb = dataclasses.replace(there_and_back, trajectory=drive)
    geometry = find_geometry(kb, kb.graph())
    (curve,) = geometry.curves.values()
    assert np.allclose(curve[0], geometry.positions["P0"])
    assert np.allclose(curve[-1], geometry.positions["P1"])
    assert np.abs(curve[:, 1]).max() < 0.1


def test_labels_in_a_crowd_step_aside():
    placer = LabelPlacer((0, 0, 400, 400))
    labels = [placer.place(200 + 9 * i, 200, f"P{i}", 12, 10) for i in range(6)]
    boxes = [find_box(label) for label in labels]
    for i, a in enumerate(boxes):
        for b in boxes[:i]:
            assert min(a[2], b[2]) <= max(a[0], b[0]) or min(a[3], b[3]) <= max(a[1], b[1])
    inside = placer.place(399, 1, "at the corner", 12, 10)
    left, top, right, bottom = find_box(inside)
    assert left >= 0
    assert top >= 0
    assert right <= 400
    assert bottom <= 400


def test_another_map_without_layout_is_drawn_as_a_graph(kb):
    scene = draw_map(kb, number=2)
    assert not any(isinstance(item, Bitmap) for item in scene.items)
    assert "map 2 of 2, rank 2" in scene.title


def test_a_grid_world_is_drawn_as_a_grid(traces):
    kb = KnowledgeBase.open(traces / "figure8-3x2-lt.json")
    geometry = find_geometry(kb, kb.graph(2), 2)
    spots = np.array([geometry.positions[f"P{i}"] for i in range(6)])
    distances = np.linalg.norm(spots[:, None] - spots[None], axis=2)
    assert sorted(distances[np.triu_indices(6, 1)].round(6)) == pytest.approx(
        sorted([1] * 7 + [2**0.5] * 4 + [2] * 2 + [5**0.5] * 2), abs=1e-6
    )


def test_a_planar_graph_is_drawn_without_crossings(traces):
    from hssh_kb.node_layout import _price

    kb = KnowledgeBase.open(traces / "grid-3x3-ltplus.json")
    crossings, disordered, _ = _price(kb.graph(), place_nodes(kb.graph()))
    assert (crossings, disordered) == (0, 0)


def test_png_and_svg_have_one_size_and_the_same_colours(kb, tmp_path):
    scene = draw_map(kb)
    image = cv2.imdecode(np.frombuffer(render_png(scene), np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (round(2 * scene.height), round(2 * scene.width), 3)
    for path in ("A", "B"):
        line = next(
            i
            for i in scene.items
            if isinstance(i, Line) and i.group == f"path-{path}" and i.opacity == 1
        )
        wanted = tuple(int(line.colour[i : i + 2], 16) for i in (5, 3, 1))
        assert (image == wanted).all(axis=2).any()


def test_plain_strokes_where_opencv_has_no_type_face(kb, monkeypatch):
    monkeypatch.delattr(cv2, "FontFace", raising=False)
    scene = Scene(100, 40, "")
    scene.add(Text(50, 20, "Müller", 12, anchor="middle", halo="#ffffff"))
    image = cv2.imdecode(np.frombuffer(render_png(scene), np.uint8), cv2.IMREAD_GRAYSCALE)
    columns = np.flatnonzero((image < 128).any(axis=0))
    assert 50 < columns.min() < 100 < columns.max() < 150


def test_dashes():
    scene = Scene(100, 10, "")
    scene.add(Line(np.array([[0.0, 5.0], [100.0, 5.0]]), "#000000", 2, dash=10))
    image = cv2.imdecode(np.frombuffer(render_png(scene, 1), np.uint8), cv2.IMREAD_GRAYSCALE)
    dark = image[5] < 128
    assert np.count_nonzero(np.diff(dark.astype(int))) >= 8
    assert 'stroke-dasharray="10"' in render_svg(scene)


def test_the_same_knowledge_base_gives_the_same_picture(kb, tmp_path):
    for name in ("a.svg", "b.svg"):
        show_map(kb, tmp_path / name, route=("P0", "P3"))
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_faults(kb, tmp_path):
    with pytest.raises(UsageError, match=r"\.svg or \.png"):
        show_map(kb, tmp_path / "a.gif")
    with pytest.raises(InputError, match="no map 3"):
        show_map(kb, tmp_path / "a.svg", number=3)
    with pytest.raises(InputError, match="no place"):
        show_map(kb, tmp_path / "a.svg", route=("P0", "nowhere"))
    assert list(tmp_path.iterdir()) == []


def test_doubted_stretches_are_dashed_and_a_route_may_use_them(kb):
    torn = dataclasses.replace(kb.hypothesis(), doubted=tuple(range(2, 9)))
    ranked = dataclasses.replace(kb.ranked, maps=(torn,))
    apart = dataclasses.replace(kb, ranked=ranked, layouts=kb.layouts[:1])
    scene = draw_map(apart, route=apart.route("P2", "P0"))
    dashed = [i for i in scene.items if isinstance(i, Line) and i.group == "doubted"]
    assert len(dashed) == len(apart.graph().doubted) // 2 > 0
    assert any(isinstance(i, Text) and "place may be missing" in i.text for i in scene.items)
    assert any(isinstance(i, Line) and i.group == "route" for i in scene.items)
