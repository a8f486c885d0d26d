from __future__ import annotations

import lzma
import math
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from floor_plans import draw_office, write_ros_map

from perception.errors import InputError
from perception.grid import FREE, OCCUPIED, UNKNOWN
from perception.rooms import read_rooms
from perception.rosmap import read_ros_map
from perception.rosmap_kind import looks_like_ros_map

LEVELS = np.repeat(np.array([[0, 80, 100, 205, 210, 254]], np.uint8), 4, axis=0)


def read(folder: Path, levels: np.ndarray, **changes: object):
    return read_ros_map(write_ros_map(folder, levels, **changes))


def test_reads_cells_resolution_and_origin(tmp_path):
    found = read(tmp_path, LEVELS, origin=[1.0, 2.0, 0.0])
    assert found.image[0].tolist() == [OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN, FREE, FREE]
    assert np.allclose(found.frame.to_metres(np.array([0.0, 3.0])), [1.025, 2.025])
    assert found.notices == ()


def test_negate_swaps_dark_and_light(tmp_path):
    plain = read(tmp_path, LEVELS).image
    assert (read(tmp_path, 255 - LEVELS, negate=1).image == plain).all()


def test_thresholds_are_those_of_the_file(tmp_path):
    found = read(tmp_path, LEVELS, occupied_thresh=0.95, free_thresh=0.01)
    assert found.image[0].tolist() == [OCCUPIED, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN, FREE]


def test_raw_levels_are_percent(tmp_path):
    levels = np.repeat(np.array([[0, 19, 50, 70, 100, 255]], np.uint8), 4, axis=0)
    found = read(tmp_path, levels, mode="raw")
    assert found.image[0].tolist() == [FREE, FREE, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN]


def test_scale_reads_graded_cells_too(tmp_path):
    thresholds = {"occupied_thresh": 0.9, "free_thresh": 0.1}
    levels = np.repeat(np.array([[0, 60, 128, 210, 250]], np.uint8), 4, axis=0)
    graded = read(tmp_path, levels, mode="scale", **thresholds).image[0].tolist()
    plain = read(tmp_path, levels, **thresholds).image[0].tolist()
    assert graded == [OCCUPIED, OCCUPIED, UNKNOWN, FREE, FREE]
    assert plain == [OCCUPIED, UNKNOWN, UNKNOWN, UNKNOWN, FREE]


@pytest.mark.parametrize("yaw", [math.pi / 2, -0.7, 3.0])
def test_a_turned_map_stands_upright_in_the_map_frame(tmp_path, yaw):
    image = np.full((60, 90), 254, np.uint8)
    image[10:14, 70:76] = 0  # a block, to be found again
    found = read(tmp_path, image, origin=[3.0, -2.0, yaw])
    block = found.pixels_to_metres(np.array([[73.0, 12.0]]))[0]
    rows, columns = np.nonzero(found.image == OCCUPIED)
    middle = found.frame.to_metres(np.array([columns.mean(), rows.mean()]))
    assert np.hypot(*(middle - block)) < 0.06
    assert abs((found.image == FREE).sum() - (image == 254).sum()) < 0.03 * image.size


def test_16_bits_and_alpha_are_read_and_told(tmp_path):
    deep = (LEVELS.astype(np.uint16)) * 257
    found = read(tmp_path, deep)
    assert (found.image == read(tmp_path, LEVELS).image).all()
    assert "16 bits" in found.notices[0]
    alpha = np.dstack([LEVELS] * 3 + [np.full_like(LEVELS, 255)])
    alpha[0, 5, 3] = 0
    found = read(tmp_path, alpha)
    assert found.image[0, 5] == UNKNOWN
    assert found.image[1, 5] == FREE
    assert "transparent" in found.notices[0]


def test_finds_a_packed_image(tmp_path):
    path = write_ros_map(tmp_path, LEVELS)
    image = tmp_path / "floor.png"
    (tmp_path / "floor.png.xz").write_bytes(lzma.compress(image.read_bytes()))
    image.unlink()
    assert (read_ros_map(path).image[:, 5] == FREE).all()


BAD = {
    "no resolution": ({"resolution": None}, ("'resolution' is missing",)),
    "resolution 0": ({"resolution": 0}, ("'resolution'", "more than 0")),
    "resolution below 0": ({"resolution": -0.05}, ("'resolution'", "more than 0")),
    "resolution in words": ({"resolution": "fine"}, ("'resolution'", "'fine'")),
    "origin of one number": ({"origin": [1.0]}, ("'origin'",)),
    "origin not finite": ({"origin": [1.0, float("nan"), 0]}, ("'origin'",)),
    "negate 2": ({"negate": 2}, ("'negate'",)),
    "threshold 65": ({"occupied_thresh": 65}, ("'occupied_thresh'",)),
    "thresholds crossed": ({"free_thresh": 0.7}, ("must be below",)),
    "mode": ({"mode": "ternary"}, ("'mode'", "trinary")),
    "image is a number": ({"image": 5}, ("'image'",)),
    "image missing": ({"image": "other.png"}, ("no such file",)),
    "image outside": ({"image": "../floor.png"}, ("outside the folder",)),
    "image absolute": ({"image": "/etc/hostname"}, ("outside the folder",)),
}


@pytest.mark.parametrize("name", BAD)
def test_says_what_is_wrong(tmp_path, name):
    changes, words = BAD[name]
    path = write_ros_map(tmp_path, LEVELS, **changes)
    with pytest.raises(InputError) as caught:
        read_ros_map(path)
    assert str(path) in str(caught.value)
    assert all(word in str(caught.value) for word in words)


def test_all_faults_in_one_message(tmp_path):
    path = write_ros_map(tmp_path, LEVELS, resolution=0, negate=7, origin="left")
    with pytest.raises(InputError, match=r"(?s)'resolution'.*'origin'.*'negate'"):
        read_ros_map(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "empty"), ("- 1\n- 2\n", "expected the keys"), ("image: [\n", "not valid yaml")],
)
def test_other_yaml_is_refused(tmp_path, text, words):
    path = tmp_path / "floor.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_ros_map(path)


@pytest.mark.parametrize("level", [0, 205])
def test_one_colour_is_refused(tmp_path, level):
    with pytest.raises(InputError, match="every cell"):
        read(tmp_path, np.full((40, 40), level, np.uint8))


@pytest.mark.parametrize("shape", [(1, 50), (50, 1), (2, 2)])
def test_one_cell_wide_is_refused(tmp_path, shape):
    with pytest.raises(InputError, match="at least 3 x 3"):
        read(tmp_path, np.full(shape, 254, np.uint8))


def test_not_an_image(tmp_path):
    path = write_ros_map(tmp_path, LEVELS)
    (tmp_path / "floor.png").write_bytes(b"no picture at all")
    with pytest.raises(InputError, match="is not an image"):
        read_ros_map(path)


def test_a_damaged_image_is_told(tmp_path):
    path = write_ros_map(tmp_path, LEVELS)
    whole = (tmp_path / "floor.png").read_bytes()
    (tmp_path / "floor.png").write_bytes(whole[: len(whole) - 20])
    with pytest.raises(InputError, match="is broken"):
        read_ros_map(path)


def _write_blank_png(path: Path, side: int) -> None:
    """Write a png header that announces a large image; the rest does not matter."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + crc

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IEND", b""))


@pytest.mark.parametrize("kind", ["png", "pgm"])
def test_a_huge_image_is_refused_unread_with_its_need(tmp_path, kind, monkeypatch):
    path = write_ros_map(tmp_path, LEVELS, image=f"big.{kind}")
    if kind == "png":
        _write_blank_png(tmp_path / "big.png", 20_000)
    else:
        (tmp_path / "big.pgm").write_bytes(b"P5\n# a comment\n20000 20000\n255\n")
    with monkeypatch.context() as patch:
        patch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded all the same"))
        with pytest.raises(InputError, match=r"12\.0 GB.*--force"):
            read_ros_map(path)
    with pytest.raises(InputError, match=r"is not an image|cannot be read"):
        read_ros_map(path, force=True)  # goes on, and finds no levels in it


def test_tells_a_ros_map_by_content(tmp_path):
    path = write_ros_map(tmp_path, LEVELS)
    renamed = path.rename(tmp_path / "floor.map")
    assert looks_like_ros_map(renamed)
    log = tmp_path / "drive.log"
    log.write_text("PARAM robot_width 0.5\nFLASER 3 1 2 3 0 0 0 0 0 0 1.0 host 1.0\n")
    assert not looks_like_ros_map(log)
    assert not looks_like_ros_map(tmp_path / "nothing.log")
    assert not looks_like_ros_map(tmp_path / "floor.png")


def test_reads_rooms_in_pixels_and_in_metres(tmp_path):
    ros_map = read(tmp_path, draw_office().image(), origin=[10.0, 20.0, 0.0])
    path = tmp_path / "rooms.yaml"
    path.write_text("locations: [a]\npolygons:\n- [0, 360, 20, 360, 20, 340]\n")
    assert np.allclose(read_rooms(path, ros_map)["a"][0], [[10, 20], [11, 20], [11, 21]])
    path.write_text("rooms:\n  b: [[0, 0], [1, 0], [1, 2.5]]\n")
    assert np.allclose(read_rooms(path, ros_map)["b"][0], [[0, 0], [1, 0], [1, 2.5]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rooms: [1, 2]\n", "expected 'locations'"),
        ("locations: [a, b]\npolygons: [[1, 2, 3, 4, 5, 6]]\n", "same length"),
        ("locations: [a]\npolygons: [[1, 2, 3, 4, 5]]\n", "at least 3 corners"),
        ("rooms: {a: [[0, 0], [1, .nan], [1, 1]]}\n", "at least 3 corners"),
        ("rooms: {a: [[0, 0], [1, 1]], b: 7}\n", "room 2"),
    ],
)
def test_broken_rooms_are_told(tmp_path, text, words):
    ros_map = read(tmp_path, LEVELS)
    path = tmp_path / "rooms.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_rooms(path, ros_map)


def test_reads_what_opencv_writes_as_pgm(tmp_path):
    path = write_ros_map(tmp_path, LEVELS, image="floor.pgm")
    cv2.imwrite(str(tmp_path / "floor.pgm"), LEVELS)
    assert (read_ros_map(path).image[:, 0] == OCCUPIED).all()


def test_any_bytes_are_read_or_refused(tmp_path):
    rng = np.random.default_rng(3)
    sheet = write_ros_map(tmp_path, LEVELS)
    image = next(path for path in tmp_path.iterdir() if path != sheet)
    good = {path: path.read_bytes() for path in (sheet, image)}
    refused = 0
    for path in [sheet, image] * 60:
        data = bytearray(good[path])
        for _ in range(int(rng.integers(1, 5))):
            at = int(rng.integers(len(data)))
            data[at : at + int(rng.integers(0, 4))] = rng.bytes(int(rng.integers(0, 4)))
        path.write_bytes(bytes(data))
        try:
            found = read_ros_map(sheet)
        except InputError:
            refused += 1
        else:
            assert found.image.ndim == 2
        path.write_bytes(good[path])
    assert 0 < refused < 120
