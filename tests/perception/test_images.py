"""Reading image files as grids, mending noise, drawing."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.denoise import estimate_noise, remove_noise
from perception.draw import draw_topology
from perception.errors import InputError
from perception.grid import UNKNOWN, classify
from perception.images import read_grey_image
from perception.topology import local_topology
from tests.perception.corpus import PLUS, draw_fine, flip, scale


@pytest.mark.parametrize("ending", ["png", "pgm", "jpg", "bmp"])
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


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gone.png", None, "no such file"),
        ("empty.png", b"", "is empty"),
        ("text.png", b"this is no image at all", "is not an image"),
        ("cut.png", b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "image"),
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
    with pytest.raises(InputError, match="300 x 200 cells would need"):
        read_grey_image(path, most_cells=10_000)


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
    plain = draw_topology(image, local_topology(image, robot_px=(10, 70)), side_px=360)
    assert (picture != plain).any()
    for gateway in found.gateways:
        x, y = ((np.array(gateway.ends_px[0]) + 0.5) * 3 + 36).round().astype(int)
        patch = picture[y - 2 : y + 3, x - 2 : x + 3].reshape(-1, 3)
        assert (np.ptp(patch.astype(int), axis=1) > 60).any(), "an end of a gateway is in colour"


def test_picture_of_another_grid_is_refused() -> None:
    image = scale(draw_fine(PLUS, 20, 300), 120)
    with pytest.raises(InputError, match="was found in a grid"):
        draw_topology(image[:100], local_topology(image))


def test_picture_of_a_closed_room() -> None:
    image = np.zeros((60, 60), np.uint8)
    image[10:50, 10:50] = 255
    assert draw_topology(image, local_topology(image)).shape[2] == 3
