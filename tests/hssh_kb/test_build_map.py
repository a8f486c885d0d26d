from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from hssh_kb.build import build
from hssh_kb.consistency import judge_hypothesis
from hssh_kb.errors import InputError
from hssh_kb.floor_walk import walk_floor
from hssh_kb.kb import KnowledgeBase
from perception.continuity import StarReading
from perception.floor_graph import FloorEdge, FloorGateway, FloorMap, FloorPlace
from perception.star import Star

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "perception"))

from floor_plans import draw_office, write_ros_map


@pytest.fixture(scope="module")
def office(tmp_path_factory):
    folder = tmp_path_factory.mktemp("office")
    path = write_ros_map(folder, draw_office().image())
    rooms = {
        f"room {k}": [[3 + 6 * k, 10.3], [8 + 6 * k, 10.3], [8 + 6 * k, 14.4]] for k in range(3)
    }
    for k, corners in enumerate(rooms.values()):
        corners.append([3 + 6 * k, 14.4])
    rooms["roof"] = [[28, 1], [30, 1], [30, 3]]
    names = folder / "rooms.yaml"
    names.write_text(yaml.safe_dump({"rooms": rooms}))
    return path, names


@pytest.fixture(scope="module")
def kb(office):
    return build(office[0], names=office[1])


def test_the_map_is_the_place_graph(kb):
    graph = kb.graph()
    assert len(graph.places) == 10
    assert len(graph.undirected_edges) == 9
    assert not any(path.circular for path in graph.paths)
    assert not any(place.frontiers for place in graph.places.values())


def test_corridor_is_one_path_past_all_doors(kb):
    longest = max(kb.graph().paths, key=lambda path: len(path.places))
    assert len(longest.places) == 5  # west end, three doors, the corner


def test_the_walk_is_consistent(kb):
    assert judge_hypothesis(kb.experience, kb.hypotheses[0]).consistent
    assert kb.check().consistent


def test_places_lie_where_they_are(kb):
    layout = kb.layout()
    for first, pose in zip(kb.hypotheses[0].places, layout.poses, strict=True):
        assert np.allclose(kb.experience.visits[first].pose[:2], pose[:2])
    drive = kb.trajectory
    for v, scan in enumerate(drive.visit_scans):
        place = kb.hypotheses[0].places.index(kb.hypotheses[0].visits[v])
        assert np.allclose(drive.poses[scan, :2], layout.poses[place, :2])
    assert np.hypot(*np.diff(drive.poses[:, :2], axis=0).T).max() < 0.45


def test_rooms_are_called_by_their_names(kb):
    assert {kb.place(f"room {k}").label for k in range(3)} <= set(kb.graph().places)
    assert any("roof" in notice for notice in kb.record.notices)


def test_routes_lead_from_room_to_room(kb):
    route = kb.route("room 0", "room 2")
    assert [step.action for step in route.steps][-1] == "arrive"
    assert route.edges[0].start == kb.place("room 0").label


def test_it_can_be_saved_shown_and_exported(kb, tmp_path):
    kb.save(tmp_path / "office.hssh")
    again = KnowledgeBase.open(tmp_path / "office.hssh")
    assert again.hypotheses == kb.hypotheses
    assert again.record.notices == kb.record.notices
    again.show(tmp_path / "office.svg", route=("room 0", "room 1"))
    again.export(tmp_path / "office.json")
    pgm, sheet = again.export(tmp_path / "office.pgm")
    turned_back = build(sheet)
    assert pgm.exists()
    assert len(turned_back.graph().places) == 10


def test_start_is_where_the_walk_begins(office):
    kb = build(office[0], start_m=(15.0, 3.0))
    assert np.hypot(*(np.array(kb.experience.visits[0].pose[:2]) - [15, 3])) < 1.5


def test_names_of_another_map_are_refused(office, tmp_path):
    names = tmp_path / "rooms.yaml"
    names.write_text("rooms: {a: [[500, 0], [501, 0], [501, 1]]}\n")
    with pytest.raises(InputError, match="none of the 1 named rooms"):
        build(office[0], names=names)


def _reading(texts: list[str], out: list[int | None], weight: float) -> StarReading:
    headings = tuple(float(k) for k in range(len(texts)))
    return StarReading(Star.parse(texts), tuple(out), headings, weight)


def _ring(readings: list[StarReading]) -> FloorMap:
    """Return a ring of three places, each with two gateways."""
    gateway = FloorGateway((0.0, 0.0), ((0.0, 0.0), (0.0, 1.0)), 0.0, 1.0, "mouth")
    centres = [(0.0, 0.0), (4.0, 0.0), (2.0, 3.0)]
    places = tuple(
        FloorPlace(centre, 1.0, "corner", (gateway, gateway), tuple(readings)) for centre in centres
    )
    edges = tuple(
        FloorEdge(k, 1, (k + 1) % 3, 0, np.array([centres[k], centres[(k + 1) % 3]]), ())
        for k in range(3)
    )
    return FloorMap(places, edges, (), (), np.zeros((0, 2)))


STRAIGHT = _reading(["a+1", "a-1"], [1, 0], 0.9)
BENT = _reading(["a+1", "b+1", "a-0", "b-0"], [1, 0, None, None], 0.1)


def test_a_path_that_bites_its_tail_is_broken_and_told():
    walk = walk_floor(_ring([STRAIGHT, BENT]))
    assert judge_hypothesis(walk.experience, walk.hypothesis).consistent
    assert walk.hypothesis.doubted == ()
    assert len(walk.notices) == 2  # one break would not do: the path would end where it begins
    assert all("order" in notice for notice in walk.notices)
    stars = [len(visit.star) for visit in walk.experience.visits]
    assert stars.count(2) == 1


def test_what_no_star_explains_is_doubted_and_told():
    walk = walk_floor(_ring([STRAIGHT]))
    assert judge_hypothesis(walk.experience, walk.hypothesis).consistent
    assert walk.hypothesis.doubted
    assert "left out" in walk.notices[0]


def test_a_real_floor_can_be_asked_and_walked(tmp_path):
    root = Path(os.environ.get("HSSH_DATA", Path(__file__).resolve().parents[3] / "shared/data"))
    folder = root / "maps" / "utexas_gdc" / "1"
    if not folder.exists():
        pytest.skip("the floors of the GDC building are not in the data folder (set HSSH_DATA)")
    kb = build(folder / "1.yaml", names=folder / "locations.yaml")
    assert kb.check().consistent
    assert len(kb.graph().places) > 50
    assert "--start=" in kb.record.notices[0]
    assert kb.route("l1_310", "l1_elev_east").edges
