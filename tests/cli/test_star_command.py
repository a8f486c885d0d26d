"""``hssh star``: methods by name, doubts and types in the answer, bad images and places."""

import struct

import cv2
import numpy as np
import pytest


@pytest.fixture
def crossing(tmp_path):
    return draw(tmp_path / "crossing.png", (slice(85, 115), slice(None)), (slice(None), [85, 115]))


def draw(path, *free, level=254):
    image = np.zeros((200, 200), np.uint8)
    for rows, columns in free:
        image[rows, slice(*columns) if isinstance(columns, list) else columns] = level
    cv2.imwrite(str(path), image)
    return path


def assert_told(answer, *words):
    assert answer.code == 3
    assert answer.out == ""
    (sentence,) = answer.err.splitlines()
    assert sentence.startswith("hssh: ")
    for word in words:
        assert str(word) in sentence


@pytest.mark.parametrize("method", ["anchor", "constriction"])
@pytest.mark.parametrize("direction", ["fit", "heading"])
def test_methods_are_chosen_by_name(hssh, crossing, method, direction):
    answer = hssh("star", crossing, "--json", "--method", method, "--direction", direction)
    (image,) = answer.document["images"]
    assert image["star"] == ["a+1", "b+1", "a-1", "b-1"]
    assert image["types"] == ["MIDLINE"] * 4
    assert image["shape"] == "+"
    assert all((g["anchor"] is not None) == (method == "anchor") for g in image["gateways"])


def test_published_base_and_continuity(hssh, crossing):
    answer = hssh("star", crossing, "--base", "closest", "--continuity", "ray")
    assert "4 gateways, at a place, +" in answer.out
    assert "a+1 MIDLINE, b+1 MIDLINE, a-1 MIDLINE, b-1 MIDLINE" in answer.out
    assert hssh("star", crossing, "--method", "guess").code == 2


def test_a_closed_room_is_the_whole_world(hssh, tmp_path):
    room = draw(tmp_path / "room.png", (slice(40, 160), slice(40, 160)))
    answer = hssh("star", room)
    assert answer.code == 0
    assert "0 gateways, at a place" in answer.out
    assert "(empty: no way leads out)" in answer.out
    (image,) = hssh("star", room, "--json").document["images"]
    assert (image["star"], image["types"], image["gateways"]) == ([], [], [])
    assert hssh("star", room, "-o", tmp_path / "drawn.png").code == 0


@pytest.mark.parametrize("level", [0, 127, 205, 255])
def test_images_of_one_colour(hssh, tmp_path, level):
    path = tmp_path / "plain.png"
    cv2.imwrite(str(path), np.full((60, 60), level, np.uint8))
    answer = hssh("star", path)
    if level == 255:
        assert answer.code == 0
        assert "0 gateways" in answer.out
    else:
        assert_told(answer, path, "no free space")


@pytest.mark.parametrize("shape", [(1, 50), (50, 1), (2, 2)])
def test_images_one_cell_wide(hssh, tmp_path, shape):
    path = tmp_path / "thin.png"
    cv2.imwrite(str(path), np.full(shape, 255, np.uint8))
    assert_told(hssh("star", path), path, "too small")


@pytest.mark.parametrize(
    ("robot", "words"), [("20,20", "in a wall"), ("900,5", "outside"), ("-3,5", "outside")]
)
def test_robots_in_walls_and_outside(hssh, tmp_path, robot, words):
    path = tmp_path / "wall.png"
    image = np.zeros((200, 200), np.uint8)
    image[150:160, 150:160] = 254
    cv2.imwrite(str(path), image)
    assert_told(hssh("star", path, f"--robot={robot}"), path, words)


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "wide"])
def test_resolutions_that_are_none(hssh, crossing, value):
    answer = hssh("star", crossing, f"--resolution={value}")
    assert answer.code == 2
    assert "is not a positive number of metres" in answer.err


def test_an_image_too_large_needs_force(hssh, tmp_path):
    path = tmp_path / "large.pgm"
    path.write_bytes(b"P5\n20000 20000\n255\n" + bytes(100))
    assert_told(hssh("star", path), path, "20000 x 20000 cells", "GB of memory", "--force")
    assert_told(hssh("star", path, "--force"), path, "get a whole copy")


def test_deep_levels_and_alpha(hssh, tmp_path, crossing):
    grey = cv2.imread(str(crossing), 0)
    deep, veiled = tmp_path / "deep.png", tmp_path / "veiled.png"
    cv2.imwrite(str(deep), grey.astype(np.uint16) * 257)
    alpha = np.full_like(grey, 255)
    alpha[:, 120:] = 0  # never seen
    cv2.imwrite(str(veiled), np.dstack([grey] * 3 + [alpha]))
    for path in (deep, veiled):
        (image,) = hssh("star", path, "--json").document["images"]
        assert image["star"] == ["a+1", "b+1", "a-1", "b-1"], "what is not seen may be free"


def test_all_faults_of_many_images_at_once(hssh, tmp_path, crossing):
    cut = tmp_path / "cut.png"
    cut.write_bytes(crossing.read_bytes()[:-20])
    lies = tmp_path / "lies.bmp"
    lies.write_bytes(b"BM" + struct.pack("<I", 99) + bytes(60))
    assert_told(hssh("star", crossing, cut, lies), cut, lies)
