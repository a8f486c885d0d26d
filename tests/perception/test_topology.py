"""Local topology: stars of shapes, exits, islands, loops, coasts, bad input."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import perception
from perception.draw import draw_topology
from perception.errors import InputError
from perception.topology import local_topology, topology_to_data
from tests.perception.corpus import (
    PLUS,
    SHAPES,
    Shape,
    direction_errors,
    draw_fine,
    flip,
    scale,
)
from tests.perception.disturb import (
    LidarWorld,
    cut_wedge,
    put_box,
    roughen,
    thin_walls,
)

ALL = {shape.name: shape for shape in (PLUS, *SHAPES)}


def blank(side: int = 300, level: int = 0) -> np.ndarray:
    return np.full((side, side), level, np.uint8)


def draw_ring() -> np.ndarray:
    image = blank()
    image[50:250, 50:250] = 255
    image[100:200, 100:200] = 0
    return image


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("turn", [0, 20, 77, 190])
@pytest.mark.parametrize("name", list(ALL))
def test_star_of_every_shape_turned_and_noisy(name: str, turn: int, noise: float) -> None:
    shape = ALL[name]
    image = flip(scale(draw_fine(shape, turn, 897), 299), noise, np.random.default_rng(turn))
    found = local_topology(image)
    assert found.star.isomorphisms(shape.truth), str(found.star)
    assert len(found.gateways) == len(shape.arms_deg)
    assert found.at_place == (name != "straight")
    errors = direction_errors([g.outward_rad for g in found.gateways], shape, turn)
    assert np.abs(errors).mean() < 1.5


@pytest.mark.parametrize("side", [39, 79, 159])
@pytest.mark.parametrize("noise", [0.0, 0.35, 0.5])
def test_small_noisy_crossings(side: int, noise: float) -> None:
    for turn in (0, 20, 45):
        image = flip(scale(draw_fine(PLUS, turn, 597), side), noise, np.random.default_rng(side))
        assert local_topology(image).star.isomorphisms(PLUS.truth), (turn, side, noise)


def test_quarter_turns_keep_the_star_and_mirrors_reverse_it() -> None:
    shape = ALL["psi"]
    image = scale(draw_fine(shape, 13, 900), 180)
    star = local_topology(image).star
    for quarter in (1, 2, 3):
        assert local_topology(np.ascontiguousarray(np.rot90(image, quarter))).star.isomorphisms(
            star
        )
    mirrored = local_topology(np.ascontiguousarray(image[:, ::-1])).star
    backwards = type(star)(star.dlps[::-1])
    assert mirrored.isomorphisms(backwards)


def test_dlps_run_clockwise_as_seen_and_know_their_gateways() -> None:
    found = local_topology(scale(draw_fine(ALL["T"], 0, 900), 150))
    reading = found.readings[0]
    turns = np.diff(np.unwrap([*reading.headings_px, reading.headings_px[0] + 2 * np.pi]))
    assert (turns > 0).all()  # y points down, so a growing angle turns clockwise
    for dlp, number, heading in zip(
        reading.star.dlps, reading.gateway_out, reading.headings_px, strict=True
    ):
        assert (number is not None) == bool(dlp.alpha)
        if number is not None:
            gap = heading - found.gateways[number].outward_rad
            assert abs(np.angle(np.exp(1j * gap))) < 1e-6


def test_gateway_lies_at_the_mouth_of_an_arm() -> None:
    found = local_topology(scale(draw_fine(PLUS, 0, 900), 300))
    right = min(found.gateways, key=lambda g: abs(g.outward_rad))
    assert right.centre_px[0] == pytest.approx(200, abs=4)
    assert right.centre_px[1] == pytest.approx(149.5, abs=1)
    assert right.width_px == pytest.approx(100, abs=2)
    assert right.ends_px[0][1] < right.ends_px[1][1], "the left end comes first, looking outward"
    assert right.frontier_px == pytest.approx(100, abs=4)
    assert right.depth_px == pytest.approx(100, abs=5)


@pytest.mark.parametrize("method", ["anchor", "constriction"])
@pytest.mark.parametrize("continuity", ["angle", "ray"])
@pytest.mark.parametrize("name", ["+", "T", "L", "Y"])
def test_methods_agree_on_clean_shapes(name: str, method: str, continuity: str) -> None:
    shape = ALL[name]
    found = local_topology(
        scale(draw_fine(shape, 10, 900), 200), method=method, continuity=continuity
    )
    assert found.star.isomorphisms(shape.truth)


NAMES = {"X bent 20": "+", "L": "L"}


@pytest.mark.parametrize("name", list(ALL))
def test_shapes_are_called_by_their_names(name: str) -> None:
    for turn in (0, 31, 118):
        found = local_topology(scale(draw_fine(ALL[name], turn, 900), 240))
        assert found.shape == NAMES.get(name, name)


def test_a_door_is_a_narrow_path() -> None:
    image = blank()
    image[120:180, :] = 255
    assert local_topology(image).shape == "straight"
    image[120:140, 147:153] = image[160:180, 147:153] = 0
    assert local_topology(image).shape == "door"
    assert local_topology(image, robot_px=(60, 150)).shape == "straight"


@pytest.mark.parametrize("turn", [0, 24, 71])
@pytest.mark.parametrize("name", list(ALL))
def test_path_types_in_corridors(name: str, turn: int) -> None:
    shape = Shape(name, ALL[name].arms_deg, ALL[name].star, 1 / 6)
    reading = local_topology(scale(draw_fine(shape, turn, 900), 270)).readings[0]
    assert len(reading.types) == len(reading.star)
    for dlp, told in zip(reading.star.dlps, reading.types, strict=True):
        assert told in (("MIDLINE",) if dlp.alpha else ("DEADEND", ""))
    told = [t for t, dlp in zip(reading.types, reading.star.dlps, strict=True) if not dlp.alpha]
    if name in ("T", "L", "dead end"):  # straight on in a Y is a narrow wedge
        assert set(told) == {"DEADEND"}


def draw_turned(boxes: list[tuple[int, int, int, int]], turn: float, level: int) -> np.ndarray:
    """Draw boxes left, top, right, bottom about the middle, turned by some degrees."""
    image = blank(300, 255 - level)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    for left, top, right, bottom in boxes:
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        turned = corners @ np.array([[c, s], [-s, c]]) + 149.5
        cv2.fillConvexPoly(image, np.round(turned).astype(np.int32), level)
    return image


@pytest.mark.parametrize("turn", [0, 17, 90, 200])
def test_path_types_beside_open_space(turn: float) -> None:
    far = 500
    hall = draw_turned([(-far, -far, -10, -20), (-far, 20, -10, far)], turn, 0)
    middle = np.radians(turn)
    reading = local_topology(
        hall, robot_px=(149.5 + 22 * np.cos(middle), 149.5 + 22 * np.sin(middle)), midline_px=50
    ).readings[0]
    assert reading.star.isomorphisms(ALL["T"].truth), "a corridor opens into a hall"
    assert sorted(reading.types) == ["LEFTWALL", "MIDLINE", "NONE", "RIGHTWALL"]
    room = draw_turned([(-far, -far, far, -60), (60, -far, far, far)], turn, 0)
    reading = local_topology(room, robot_px=(150, 150)).readings[0]
    assert reading.star.isomorphisms(ALL["L"].truth), "the corner of a large room"
    assert sorted(reading.types) == ["DEADEND", "DEADEND", "LEFTWALL", "RIGHTWALL"]
    block = draw_turned([(-far, -far, 0, 0)], turn, 0)
    out = np.radians(turn + 45)
    reading = local_topology(
        block, robot_px=(149.5 + 40 * np.cos(out), 149.5 + 40 * np.sin(out))
    ).readings[0]
    assert reading.star.isomorphisms(ALL["L"].truth), "round the corner of a block"
    assert sorted(reading.types) == ["LEFTWALL", "NONE", "NONE", "RIGHTWALL"]


def test_anchors_hold_gateways_where_constrictions_wander() -> None:
    """As published: the base point follows the robot, and nothing is settled in the bend."""
    room = draw_turned([(-500, -500, 500, -70), (70, -500, 500, 500)], 12, 0)
    spread = {}
    for method in ("anchor", "constriction"):
        found = [
            local_topology(room, robot_px=robot, method=method, base="closest")
            for robot in ((150, 150), (140, 148), (150, 165), (160, 175))
        ]
        centres = np.array([[g.centre_px for g in one.gateways] for one in found])
        spread[method] = np.ptp(centres, axis=0).max()
        anchors = [g.anchor_px for one in found for g in one.gateways]
        assert all((a is not None) == (method == "anchor") for a in anchors)
        if method == "anchor":
            assert np.ptp(np.array(anchors), axis=0).max() < 3, "the virtual corner anchors both"
            column, row = np.round(anchors[0]).astype(int)
            assert room[row, column] == 255, "there is no wall there"
    assert spread["anchor"] < 4
    assert spread["constriction"] > 20


@pytest.mark.parametrize("name", ["+", "T", "L", "Y", "X"])
def test_all_as_published_reads_clean_shapes(name: str) -> None:
    shape = Shape(name, ALL[name].arms_deg, ALL[name].star, 1 / 5)
    for method in ("anchor", "constriction"):
        found = local_topology(
            scale(draw_fine(shape, 10, 900), 240),
            method=method,
            direction="heading",
            base="closest",
            continuity="ray",
        )
        assert found.star.isomorphisms(shape.truth), method
        errors = direction_errors([g.outward_rad for g in found.gateways], shape, 10)
        assert np.abs(errors).max() < 12


def test_anchor_of_a_crossing_is_the_corner_of_a_wall() -> None:
    image = blank()
    image[130:170, :] = image[:, 130:170] = 255
    for gateway in local_topology(image).gateways:
        x, y = gateway.anchor_px or (0, 0)
        assert min(abs(x - 130), abs(x - 169)) <= 2
        assert min(abs(y - 130), abs(y - 169)) <= 2


def test_robot_off_the_crossing_is_on_a_path() -> None:
    image = scale(draw_fine(Shape("T", (0, 90, 180), ALL["T"].star, 0.12), 0, 900), 300)
    assert local_topology(image).at_place
    beside = local_topology(image, robot_px=(60, 150))
    assert not beside.at_place
    assert str(beside.star) == "a+1 a-1"


def test_corner_does_not_wander_with_the_robot() -> None:
    image = scale(draw_fine(Shape("L", (0, 90), ALL["L"].star, 0.15), 0, 900), 300)
    bases = [
        local_topology(image, robot_px=place).base_px[0]
        for place in ((150, 150), (140, 160), (165, 150), (150, 168))
    ]
    assert np.ptp(bases, axis=0).max() < 6


def test_dead_end_is_at_its_end_and_on_path_before_it() -> None:
    image = blank()
    image[130:170, :200] = 255
    near = local_topology(image, robot_px=(175, 150))
    assert str(near.star) == "a+1 a-0"
    assert near.at_place
    far = local_topology(image, robot_px=(60, 150))
    assert str(far.star) == "a+1 a-0"
    assert not far.at_place
    assert np.allclose(far.base_px, near.base_px, atol=3)
    assert far.base_px[0] == pytest.approx([180, 149.5], abs=6)


def test_islands_go_and_blocks_stay() -> None:
    image = scale(draw_fine(PLUS, 0, 900), 300)
    image[140:165, 135:160] = 0
    assert local_topology(image).star.isomorphisms(PLUS.truth)
    ring = draw_ring()
    assert str(local_topology(ring, robot_px=(75, 150)).star) == "a+1 a-1"
    ring[:60, 140:160] = 255
    mouth = local_topology(ring, robot_px=(150, 70))
    assert mouth.star.isomorphisms(ALL["T"].truth)


def test_closed_room_has_an_empty_star() -> None:
    image = blank()
    image[20:280, 60:200] = 255
    found = local_topology(image)
    assert (len(found.star), found.at_place, found.gateways) == (0, True, ())
    assert found.closest_px is None


def test_open_field_has_no_gateways() -> None:
    assert len(local_topology(blank(100, 255)).star) == 0


@pytest.mark.parametrize("side", ["concave", "convex", "straight"])
def test_coasts(side: str) -> None:
    image = blank(300, 255)
    if side == "concave":
        image[:100], image[:, 200:] = 0, 0
    elif side == "convex":
        image[:150, :150] = 0
    else:
        image[:, :60] = 0
    found = local_topology(image, robot_px=(150, 160))
    assert {g.kind for g in found.gateways} == {"leftwall", "rightwall"}
    assert found.at_place == (side != "straight")
    expected = ALL["straight"] if side == "straight" else ALL["L"]
    assert found.star.isomorphisms(expected.truth)


def test_robot_beside_a_thin_wall_stays_on_its_side() -> None:
    image = blank(200)
    image[60:97, :] = 255  # a narrow corridor, then a wall of 2 cells, then a wide one
    image[99:190, :] = 255
    found = local_topology(image, robot_px=(100, 95))
    assert found.closest_px is not None
    assert found.closest_px[1] < 97
    assert all(g.width_px < 45 for g in found.gateways)


def test_narrow_frontiers_and_shallow_exits_are_no_exits() -> None:
    image = blank(200)
    image[80:120, :] = 255
    image[60:80, 90:100] = 255  # an opening 10 cells wide, 20 deep, unknown behind
    image[40:60, 60:140] = 205
    assert len(local_topology(image).gateways) == 3
    metric = {"resolution_m": 0.1, "robot_radius_m": 0.2}
    assert len(local_topology(image, **metric, min_frontier_m=0.5).gateways) == 3
    assert len(local_topology(image, **metric, min_frontier_m=1.5).gateways) == 2
    assert len(local_topology(image, **metric, min_frontier_m=0.5, min_depth_m=3).gateways) == 2


def test_a_robot_in_a_wall_is_told_but_not_one_that_touches_it() -> None:
    image = blank(200)
    image[80:120, :] = 255
    for row in (20, 55, 145):
        with pytest.raises(InputError, match=r"stands in a wall, .* cells from free"):
            local_topology(image, robot_px=(100, row))
    assert str(local_topology(image, robot_px=(100, 76)).star) == "a+1 a-1"


def test_unknown_space_is_an_exit_not_a_wall() -> None:
    image = blank(200)
    image[80:120, :] = 255
    image[70:130, :60] = 205
    found = local_topology(image)
    assert str(found.star) == "a+1 a-1"


def test_doubtful_alignment_brings_runner_ups() -> None:
    pentagon = local_topology(scale(draw_fine(ALL["five-armed"], 5, 900), 250))
    assert len(pentagon.readings) > 1
    weights = [reading.weight for reading in pentagon.readings]
    assert sum(weights) == pytest.approx(1)
    assert weights == sorted(weights, reverse=True)
    assert len(local_topology(scale(draw_fine(PLUS, 5, 900), 250)).readings) == 1


@pytest.mark.parametrize("name", ["+", "T"])
def test_disturbed_grids(name: str) -> None:
    shape = Shape(name, ALL[name].arms_deg, ALL[name].star, 1 / 6)
    rng = np.random.default_rng(3)
    for turn in (0, 31, 58):
        image = scale(draw_fine(shape, turn, 900), 240)
        for label, made, options in (
            ("ragged", roughen(image, 3.0, rng), {}),
            ("missing", thin_walls(image, 0.3, rng), {"resolution_m": 0.05}),
            ("box", put_box(image, shape, turn, "wall", rng), {}),
            ("box inside", put_box(image, shape, turn, "crossing", rng), {}),
            ("wedge", cut_wedge(image, rng), {"resolution_m": 0.05}),
        ):
            found = local_topology(made, **options)
            assert found.star.isomorphisms(shape.truth), (label, turn, str(found.star))


@pytest.mark.parametrize("name", ["+", "T", "L", "Y", "straight"])
def test_lpm_of_a_half_circle_lidar(name: str) -> None:
    shape = ALL[name]
    rng = np.random.default_rng(8)
    world = LidarWorld(shape, 24.0, 2.4)
    arm = np.radians(shape.arms_deg[0] + 24.0)
    image, robot = world.drive(np.pi - arm, -6.0, 0.6, rng)
    found = local_topology(
        image, robot_px=robot, resolution_m=0.1, robot_radius_m=0.4, denoise=False
    )
    assert found.star.isomorphisms(shape.truth), str(found.star)
    errors = direction_errors([g.outward_rad for g in found.gateways], shape, 24.0)
    assert np.abs(errors).max() < 8


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (np.zeros((50, 50, 3), np.uint8), {}, "rows x columns"),
        (np.zeros((50, 50)), {}, "uint8"),
        (np.full((1, 50), 255, np.uint8), {}, "at least 3 x 3"),
        (blank(50), {}, "no free space"),
        (blank(50, 205), {}, "no free space"),
        (blank(50, 255), {"robot_px": (70, 3)}, "outside the image of 50 x 50"),
        (blank(50, 255), {"robot_px": (float("nan"), 3)}, "outside the image"),
        (blank(50, 255), {"resolution_m": 0.0}, "more than zero"),
        (blank(50, 255), {"resolution_m": -1.0}, "more than zero"),
        (blank(50, 255), {"robot_radius_m": 0.3}, "resolution_m"),
        (blank(50, 255), {"resolution_m": 0.1, "min_depth_m": -1}, "zero or more"),
        (draw_ring(), {"robot_px": (75, 150), "method": "guess"}, "'anchor' or 'constriction'"),
        (draw_ring(), {"robot_px": (75, 150), "continuity": "luck"}, "'angle' or 'ray'"),
        (draw_ring(), {"robot_px": (75, 150), "direction": "up"}, "'fit' or 'heading'"),
        (draw_ring(), {"robot_px": (75, 150), "base": "here"}, "'settled' or 'closest'"),
        (blank(50, 255), {"resolution_m": float("nan")}, "more than zero"),
        (blank(50, 255), {"resolution_m": 0.1, "robot_radius_m": float("inf")}, "zero or more"),
        (np.full((50, 1), 255, np.uint8), {}, "at least 3 x 3"),
        (np.zeros((0, 0), np.uint8), {}, "at least 3 x 3"),
    ],
)
def test_bad_input_is_told(image: np.ndarray, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        local_topology(image, **options)


@given(
    arrays(
        np.uint8,
        st.tuples(st.integers(1, 40), st.integers(1, 40)),
        elements=st.sampled_from([0, 127, 254]),
    ),
    st.sampled_from([None, 0.05, 0.3]),
    st.sampled_from(["anchor", "constriction"]),
)
@settings(max_examples=80, deadline=None)
def test_any_grid_is_read_or_told(image: np.ndarray, resolution: float, method: str) -> None:
    told = None
    try:
        found = local_topology(image, resolution_m=resolution, robot_radius_m=None, method=method)
    except InputError as error:
        told = str(error)
    if told is None:
        assert sum(reading.weight for reading in found.readings) == pytest.approx(1)
        for reading in found.readings:
            assert len(reading.types) == len(reading.gateway_out) == len(reading.star)
        assert json.dumps(topology_to_data(found, "x.png"))
        assert draw_topology(image, found, side_px=200).size
    else:
        assert "\n" not in told


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
def test_grids_of_blocks_at_random_are_read_or_told(share: float) -> None:
    rng = np.random.default_rng(int(100 * share))
    for side in (30, 61, 150):
        for _ in range(8):
            blocks = rng.random((side // 6 + 1, side // 6 + 1))
            image = np.kron(blocks, np.ones((6, 6)))[:side, :side]
            image = np.where(image < share, np.where(image < share / 3, 127, 0), 254)
            grid = image.astype(np.uint8)
            free = np.argwhere(grid == 254)
            row, column = free[rng.integers(len(free))]
            for options in ({}, {"resolution_m": 0.1, "robot_radius_m": 0.2}):
                try:
                    found = local_topology(grid, robot_px=(column, row), **options)
                except InputError:
                    continue
                every = set(range(len(found.gateways)))
                for reading in found.readings:
                    out = [g for g in reading.gateway_out if g is not None]
                    assert len(set(out)) == len(out) == sum(reading.star.alpha)
                    assert set(out) <= every


def test_data_can_be_written_as_json() -> None:
    found = perception.local_topology(scale(draw_fine(ALL["T"], 30, 900), 150))
    data = json.loads(json.dumps(topology_to_data(found, "t.png")))
    assert data["file"] == "t.png"
    assert len(data["gateways"]) == 3
    assert data["star"] == [str(dlp) for dlp in found.star.dlps]
    assert data["at_place"] is True
    assert {"centre", "ends", "outward", "anchor"} <= set(data["gateways"][0])
    assert sorted(data["types"]) == ["DEADEND", "MIDLINE", "MIDLINE", "MIDLINE"]
    assert data["readings"][0]["weight"] == 1


def test_gap_in_a_wall_along_a_path_is_no_exit_but_the_dead_end_stays() -> None:
    image = np.full((150, 150), 205, np.uint8)
    image[20:150, 60:85] = 255
    image[19:150, 59], image[19:150, 85], image[19, 59:86] = 0, 0, 0
    image[100:111, 85] = 205  # eleven cells of the wall were never seen
    metric = {"resolution_m": 0.1, "robot_radius_m": 0.4, "robot_px": (72, 40)}
    found = local_topology(image, **metric)
    assert str(found.star) == "a+1 a-0"
    assert found.base_px[0] == pytest.approx([72, 33], abs=4)
    assert found.gateways[0].outward_rad == pytest.approx(np.pi / 2, abs=0.05)


def test_best_reading_may_lack_a_doubtful_gateway() -> None:
    image = blank(200)
    image[80:120, :] = 255
    image[58:80, 90:100] = 255
    image[40:58, 60:140] = 205
    found = local_topology(image, resolution_m=0.1, robot_radius_m=0.2, min_depth_m=2.0)
    assert len(found.gateways) == 3
    assert {sum(reading.star.alpha) for reading in found.readings} == {2, 3}


@pytest.mark.parametrize("row", [50, 80, 100])
def test_a_dead_end_lies_at_the_end_though_the_way_is_wider_before(row):
    plain = np.full((150, 150), 127, np.uint8)
    plain[:120, 58:92] = 0
    plain[:117, 62:88] = 255
    bulged = plain.copy()
    bulged[68:84, 60:90] = 255
    ends = [
        local_topology(image, robot_px=(75, row), resolution_m=0.1).base_px[0]
        for image in (plain, bulged)
    ]
    assert 98 < ends[0][1] < 110
    assert np.hypot(*(ends[0] - ends[1])) < 2
