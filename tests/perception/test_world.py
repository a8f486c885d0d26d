"""Floor plans, the bundled world, and its true place graph."""

import json
from importlib.resources import files

import cv2
import networkx as nx
import numpy as np
import pytest

from perception.errors import InputError
from perception.grid import FREE, OCCUPIED
from perception.simulate import cast_rays
from perception.world import draw_world, load_world


@pytest.fixture(scope="module")
def world():
    return load_world()


@pytest.fixture
def plan():
    return json.loads((files("perception") / "worlds/office.json").read_text())


def load(tmp_path, plan, **more):
    path = tmp_path / "plan.json"
    path.write_text(plan if isinstance(plan, str) else json.dumps(plan))
    return load_world(path, **more)


def test_the_bundled_floor_has_what_it_must_have(world):
    assert world.size_m == (60.0, 40.0)
    kinds = [kind for _, kind in world.truth.nodes(data="kind")]
    assert {k: kinds.count(k) for k in set(kinds)} == {"L": 7, "T": 7, "+": 3, "dead end": 1}
    assert nx.is_connected(world.truth)
    assert world.truth.number_of_edges() - world.truth.number_of_nodes() + 1 == 7  # loops
    assert nx.check_planarity(world.truth)[0]
    assert {"kitchen", "print room", "robot lab", "library"} <= set(world.rooms)
    assert "lift lobby" in world.corridors
    assert set(world.doors.values()) == {"open", "ajar", "closed"}


def test_kinds_agree_with_the_edges(world):
    for place, kind in world.truth.nodes(data="kind"):
        here = world.position(place)
        out = [np.sign((world.position(n) - here).round(6)) for n in world.truth[place]]
        straight = any(np.array_equal(a, -b) for a in out for b in out)
        degree = len(out)
        found = {1: "dead end", 2: "other" if straight else "L", 3: "T", 4: "+"}[degree]
        assert kind == found, place


def test_places_are_far_enough_apart_to_be_told_apart(world):
    assert min(length for *_, length in world.truth.edges(data="length_m")) >= 7


def test_corridors_are_as_wide_as_in_an_office_and_leave_room_to_pass(world):
    for a, b in world.truth.edges:
        start, end = world.position(a), world.position(b)
        heading = np.arctan2(*(end - start)[::-1])
        share = np.linspace(0.15, 0.85, 40)[:, None]
        poses = np.column_stack([start + share * (end - start), np.full(40, heading)])
        sides = cast_rays(world.segments, poses, np.array([-np.pi / 2, np.pi / 2]))
        width = sides.sum(axis=1)
        usual = (width >= 2.0) & (width <= 2.6)  # the lobby and furniture apart
        assert usual.mean() > 0.4
        assert width.min() > 1.3
        assert sides.min() >= 0.45


def test_the_tour_drives_every_corridor_and_comes_back_to_most_junctions(world):
    driven = {frozenset(pair) for pair in zip(world.tour, world.tour[1:], strict=False)}
    assert driven == {frozenset(edge) for edge in world.truth.edges}
    again = [p for p, d in world.truth.degree if d >= 3 and world.tour.count(p) >= 2]
    assert len(again) >= 8


def test_no_door_lets_a_robot_out_of_the_corridors(world):
    """What is open towards a corridor is narrower than a robot; rooms open only to rooms."""
    image, frame = draw_world(world, 0.05)
    free = (image == FREE).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (15, 15))  # 0.75 m
    _, labels = cv2.connectedComponents(cv2.erode(free, kernel))
    column, row = np.rint(frame.to_pixels(world.position("second crossing"))).astype(int)
    rows, columns = np.nonzero(labels == labels[row, column])
    points = frame.to_metres(np.column_stack([columns, rows]))
    names = {world.name_at(x, y) for x, y in points[::50]}
    assert not names & set(world.rooms)


def test_a_door_can_be_opened(tmp_path, world):
    opened = load_world(doors={"door of kitchen": "open"})
    assert opened.doors["door of kitchen"] == "open"
    assert not np.array_equal(opened.segments, world.segments)
    with pytest.raises(InputError, match="no door 'gate'"):
        load_world(doors={"gate": "open"})
    with pytest.raises(InputError, match="'wide' is none of"):
        load_world(doors={"door of kitchen": "wide"})


def test_names_and_positions(world):
    assert world.name_at(1.0, 1.0) == "stair S"
    assert world.name_at(5.0, 20.0) == "west corridor"
    assert world.name_at(30.0, 25.0) == ""
    with pytest.raises(InputError, match="no place 'moon'"):
        world.position("moon")


def test_drawing(world):
    image, frame = draw_world(world, 0.1)
    assert image.shape == (401, 601)
    column, row = np.rint(frame.to_pixels(np.array([5.0, 20.0]))).astype(int)
    assert image[row, column] == FREE
    column, row = np.rint(frame.to_pixels(np.array([3.9, 18.0]))).astype(int)
    assert (image[row - 1 : row + 2, column - 1 : column + 2] == OCCUPIED).any()
    with pytest.raises(InputError, match="resolution"):
        draw_world(world, 0.0)


def set_in(plan, key, index, field, value):
    plan[key][index][field] = value
    return plan


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda p: "{", "not a JSON document"),
        (lambda p: "[1]", "expected a JSON object with"),
        (lambda p: p | {"schema": "hssh.world/9"}, "hssh.world/1"),
        (lambda p: p | {"size_m": [60]}, '"size_m": expected two numbers'),
        (lambda p: p | {"wall_m": 0}, '"wall_m"'),
        (lambda p: p | {"rooms": None}, '"rooms": expected a list'),
        (lambda p: set_in(p, "rooms", 3, "rect", [1, 2, 1, 4]), r'rooms\[3\]: "rect"'),
        (lambda p: set_in(p, "rooms", 3, "rect", [1, 2, float("nan"), 4]), r'rooms\[3\]: "rect"'),
        (lambda p: set_in(p, "rooms", 3, "rect", [4, 4, 7, 7]), "leaves no wall to"),
        (lambda p: set_in(p, "rooms", 3, "rect", [50, 1, 70, 2]), "reaches beyond the plan"),
        (lambda p: set_in(p, "doors", 0, "room", "attic"), "'attic', which is no room"),
        (lambda p: set_in(p, "doors", 0, "state", "locked"), r'doors\[0\]: "state"'),
        (lambda p: set_in(p, "doors", 0, "wall", "z"), r"doors\[0\]: expected"),
        (lambda p: set_in(p, "furniture", 0, "disc", [1, 2]), r'furniture\[0\]: "disc"'),
        (lambda p: set_in(p, "places", 0, "kind", "X"), r'places\[0\]: "kind"'),
        (lambda p: set_in(p, "places", 0, "name", "dead end"), "'dead end' occurs twice"),
        (lambda p: set_in(p, "places", 0, "at", [5, 7.5]), "runs into something"),
        (lambda p: set_in(p, "edges", 0, "ends", ["a"]), r'edges\[0\]: "ends"'),
        (lambda p: set_in(p, "edges", 0, "ends", ["a", "dead end"]), "edges: 'a' is no place"),
        (lambda p: p | {"tour": ["dead end", "lobby corner"]}, "no edge between 'dead end'"),
        (lambda p: p | {"tour": "all"}, '"tour": expected a list'),
    ],
)
def test_faulty_plans_are_refused(tmp_path, plan, spoil, message):
    with pytest.raises(InputError, match=message) as caught:
        load(tmp_path, spoil(plan))
    assert "plan.json" in str(caught.value)


def test_all_faults_are_told_at_once(tmp_path, plan):
    plan["wall_m"] = -1
    plan["rooms"][0] = 7
    plan["edges"][2] = {}
    with pytest.raises(InputError) as caught:
        load(tmp_path, plan)
    for part in ("wall_m", "rooms[0]", "edges[2]"):
        assert part in str(caught.value)
