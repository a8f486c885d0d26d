"""Reading image files as grids, mending noise, drawing."""

import itertools
import lzma
import struct
import time
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from perception.denoise import estimate_noise, remove_noise
from perception.draw import draw_topology, place_labels, plan_arrows
from perception.errors import InputError
from perception.grid import UNKNOWN, classify
from perception.image_header import read_image_header
from perception.images import read_grey_image
from perception.topology import local_topology
from tests.perception.corpus import PLUS, SHAPES, Shape, draw_fine, flip, scale

ENDINGS = ("png", "pgm", "jpg", "bmp", "tiff", "webp")
RNG = np.random.default_rng(2)


@pytest.mark.parametrize("ending", ENDINGS)
def test_grey_files(tmp_path: Path, ending: str) -> None:
    image = scale(draw_fine(PLUS, 10, 300), 90)
    path = tmp_path / f"plus.{ending}"
    cv2.imwrite(str(path), image)
    found = read_grey_image(path)
    assert found.shape == (90, 90)
    assert found.dtype == np.uint8
    assert np.abs(found.astype(int) - image).mean() < 8


def test_colour_sixteen_bits_and_alpha(tmp_path: Path) -> None:
    grey = scale(draw_fine(PLUS, 0, 300), 60)
    deep = tmp_path / "deep.png"
    cv2.imwrite(str(deep), grey.astype(np.uint16) * 257)
    assert (read_grey_image(deep) == grey).all()
    colour = tmp_path / "colour.png"
    cv2.imwrite(str(colour), np.dstack([grey] * 3))
    assert (read_grey_image(colour) == grey).all()
    alpha = np.full_like(grey, 255)
    alpha[:20] = 0
    veiled = tmp_path / "alpha.png"
    cv2.imwrite(str(veiled), np.dstack([grey] * 3 + [alpha]))
    found = read_grey_image(veiled)
    assert (found[:20] == UNKNOWN).all()
    assert (found[20:] == grey[20:]).all()


def test_packed_images_are_read(tmp_path: Path) -> None:
    image = scale(draw_fine(PLUS, 10, 300), 60)
    path = tmp_path / "plus.pgm.xz"
    path.write_bytes(lzma.compress(cv2.imencode(".pgm", image)[1].tobytes()))
    assert (read_grey_image(path) == image).all()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gone.png", None, "no such file"),
        ("empty.png", b"", "is empty"),
        ("text.png", b"this is no image at all", "is not an image"),
        ("cut.png", b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "is not an image"),
        ("nothing.pgm", b"P5\n0 10\n255\n", "image"),
        ("huge.pgm", b"P5\n20000 20000\n255\n", "20000 x 20000 cells would need about .* GB"),
        ("folder", "dir", "is a folder"),
    ],
)
def test_bad_files_are_told(tmp_path: Path, name: str, content: object, message: str) -> None:
    path = tmp_path / name
    if content == "dir":
        path.mkdir()
    elif isinstance(content, bytes):
        path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_grey_image(path)
    assert name in str(caught.value)


def test_too_large_an_image_is_refused_with_its_need(tmp_path: Path) -> None:
    path = tmp_path / "large.png"
    cv2.imwrite(str(path), np.zeros((200, 300), np.uint8))
    with pytest.raises(InputError, match=r"300 x 200 cells would need .* GB of memory; .*--force"):
        read_grey_image(path, most_cells=10_000)
    assert read_grey_image(path, most_cells=None).shape == (200, 300)


@pytest.mark.parametrize("ending", ENDINGS)
def test_size_is_known_before_decoding(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"x.{ending}"
    cv2.imwrite(str(path), np.full((20, 31), 255, np.uint8))
    header = read_image_header(path.read_bytes())
    assert header is not None
    assert (header.width, header.height) == (31, 20)


def test_a_header_that_promises_too_much_is_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "huge.png"
    cv2.imwrite(str(path), np.zeros((20, 30), np.uint8))
    data = bytearray(path.read_bytes())
    data[16:24] = struct.pack(">II", 20_000, 20_000)
    data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
    path.write_bytes(bytes(data))
    started = time.process_time()
    with pytest.raises(InputError, match=r"20000 x 20000 cells would need about 14\.0 GB"):
        read_grey_image(path)
    assert time.process_time() - started < 0.1


@pytest.mark.parametrize("ending", ENDINGS)
def test_cut_off_images_are_told_and_nothing_is_printed(
    tmp_path: Path, ending: str, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = tmp_path / f"whole.{ending}"
    cv2.imwrite(str(whole), flip(scale(draw_fine(PLUS, 10, 300), 90), 0.2, RNG))
    data, path = whole.read_bytes(), tmp_path / f"cut.{ending}"
    for share in (0.0, 0.02, 0.2, 0.5, 0.9, 0.99):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(InputError, match="cut"):
            read_grey_image(path)
    if ending != "tiff":  # its library writes to the terminal by itself
        assert capfd.readouterr().err == ""


def assert_read_or_told(path: Path) -> None:
    told = None
    try:
        found = read_grey_image(path, most_cells=10**6)
    except InputError as error:
        told = str(error)
    if told is None:
        assert found.dtype == np.uint8
        assert found.ndim == 2
    else:
        assert str(path) in told


@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_images_are_read_or_told(tmp_path: Path, ending: str) -> None:
    whole = tmp_path / f"whole.{ending}"
    cv2.imwrite(str(whole), scale(draw_fine(PLUS, 10, 300), 90))
    data, path = whole.read_bytes(), tmp_path / f"damaged.{ending}"
    rng = np.random.default_rng(4)
    for _ in range(60):
        torn = bytearray(data)
        for place in rng.integers(0, min(len(torn), 400), rng.integers(1, 4)):
            torn[place] = rng.integers(256)
        path.write_bytes(bytes(torn))
        assert_read_or_told(path)


@given(
    st.binary(max_size=200), st.sampled_from([b"", b"P5\n3 3\n255\n", b"BM", b"II*\x00", b"GIF89a"])
)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_are_read_or_told(tmp_path: Path, data: bytes, start: bytes) -> None:
    path = tmp_path / "any"
    path.write_bytes(start + data)
    assert_read_or_told(path)


def test_levels_of_a_pgm_are_those_of_its_header(tmp_path: Path) -> None:
    path = tmp_path / "levels.pgm"
    path.write_bytes(b"P5\n2 1\n1000\n" + struct.pack(">HH", 1000, 500))
    assert read_grey_image(path).tolist() == [[255, 128]]
    path.write_bytes(b"P2\n2 1\n9\n9 3\n")
    assert read_grey_image(path).tolist() == [[255, 85]]
    path.write_bytes(b"P1\n2 1\n1 0\n")
    assert read_grey_image(path).tolist() == [[0, 255]]


def test_noise_is_estimated_and_clean_grids_are_left_alone() -> None:
    image = scale(draw_fine(PLUS, 20, 900), 300)
    clean = classify(image)
    assert estimate_noise(clean) == (0.0, 0.0)
    assert remove_noise(clean) is clean
    for share in (0.1, 0.3, 0.5):
        noisy = classify(flip(image, share, np.random.default_rng(1)))
        flipped, holed = estimate_noise(noisy)
        assert flipped == pytest.approx(share, abs=0.05)
        assert holed == 0
        mended = remove_noise(noisy)
        assert (mended.free != clean.free).mean() < 0.02


def test_thin_walls_are_not_taken_for_noise() -> None:
    image = np.full((150, 150), 255, np.uint8)
    image[::20] = 0
    image[:, ::30] = 0
    cells = classify(image)
    assert remove_noise(cells) is cells


def test_picture_shows_gateways_and_names() -> None:
    image = scale(draw_fine(PLUS, 20, 300), 120)
    found = local_topology(image)
    picture = draw_topology(image, found, side_px=360)
    assert picture.shape == (432, 432, 3)
    assert picture.dtype == np.uint8
    moved = draw_topology(image, local_topology(image, robot_px=(50, 70)), side_px=360)
    assert (picture != moved).any(), "the robot is drawn where it stands"
    for gateway in found.gateways:
        x, y = ((np.array(gateway.ends_px[0]) + 0.5) * 3 + 36).round().astype(int)
        patch = picture[y - 2 : y + 3, x - 2 : x + 3].reshape(-1, 3)
        assert (np.ptp(patch.astype(int), axis=1) > 60).any(), "an end of a gateway is in colour"


@pytest.mark.parametrize("shape", [PLUS, *SHAPES], ids=lambda shape: shape.name)
def test_names_in_a_picture_do_not_lie_on_each_other(shape: Shape) -> None:
    for turn, side in ((0, 60), (25, 120)):
        found = local_topology(scale(draw_fine(shape, turn, 300), side))
        arrows = plan_arrows(found)
        labels = place_labels(arrows, 360 / side)
        assert [label.text for label in labels] == [
            f"{k}: {dlp}" for k, dlp in enumerate(found.star.dlps, 1)
        ]
        for one, other in itertools.combinations(labels, 2):
            assert not one.overlaps(other)


def test_picture_grows_for_arrows_and_captions_beyond_the_grid() -> None:
    image = scale(draw_fine(PLUS, 20, 300), 120)
    beside = draw_topology(image, local_topology(image, robot_px=(10, 70)), side_px=360)
    assert beside.shape[1] > 432
    narrow = draw_topology(image, local_topology(image), side_px=150)
    assert narrow.shape[0] > 150 + 72, "captions take several lines"


def test_picture_of_another_grid_is_refused() -> None:
    image = scale(draw_fine(PLUS, 20, 300), 120)
    with pytest.raises(InputError, match="was found in a grid"):
        draw_topology(image[:100], local_topology(image))


def test_picture_of_a_closed_room() -> None:
    image = np.zeros((60, 60), np.uint8)
    image[10:50, 10:50] = 255
    assert draw_topology(image, local_topology(image)).shape[2] == 3
