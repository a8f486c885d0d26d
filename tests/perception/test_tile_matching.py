"""Matching of stored LPMs: the same place fits, another does not, a bare corridor says little."""

import cv2
import numpy as np
import pytest

from perception.geometry import compose
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame
from perception.tile_matching import LEAST_NATS, MOST_NATS, Tile, rate_match, weigh_match

FRAME = Frame(-7.5, 7.5, 0.1)


def draw_tile(halls, pose=(0.0, 0.0, 0.0)) -> Tile:
    """Draw rectangles (x, y, half width, half height) of free space with walls around, moved."""
    image = np.full((150, 150), UNKNOWN, np.uint8)
    for grow, level in ((0.2, OCCUPIED), (0.0, FREE)):
        for x, y, w, h in halls:
            w, h = w + grow, h + grow
            corners = np.array([[x - w, y - h], [x + w, y - h], [x + w, y + h], [x - w, y + h]])
            ends = [compose(pose, [*corner, 0.0])[:2] for corner in corners]
            pixels = FRAME.to_pixels(np.array(ends)).round().astype(np.int32)
            cv2.fillPoly(image, [pixels], level)
    return Tile(image, FRAME)


CORRIDOR = [(0, 0, 9, 1)]
TEE = [*CORRIDOR, (0.5, 4, 0.8, 4)]
ELL = [(-4, 0, 5, 1), (0.2, -4, 0.8, 5)]


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (0.4, -0.3, 0.1), (-0.5, 0.5, -0.15)])
def test_the_same_place_fits_though_found_aside_and_turned(pose):
    assert rate_match(draw_tile(TEE), draw_tile(TEE, pose))[0] > 0.85


def test_another_place_fits_worse():
    tee = draw_tile(TEE)
    assert (
        rate_match(tee, draw_tile(ELL))[0]
        < rate_match(tee, draw_tile(TEE, (0.4, -0.3, 0.1)))[0] - 0.08
    )


def test_the_turn_between_the_frames_is_heeded():
    turned = draw_tile(TEE, (0.0, 0.0, np.pi / 2))
    assert rate_match(draw_tile(TEE), turned, -np.pi / 2)[0] > 0.85
    assert rate_match(draw_tile(TEE), turned)[0] < 0.8


def test_nothing_is_said_where_nothing_is_known_in_common():
    empty = Tile(np.full((150, 150), UNKNOWN, np.uint8), FRAME)
    assert rate_match(empty, draw_tile(TEE)) is None


def test_a_bare_corridor_speaks_for_no_closure():
    corridor, tee = draw_tile(CORRIDOR), draw_tile(TEE)
    assert corridor.alias > 0.95 > tee.alias
    assert weigh_match(0.99, corridor.alias) < 0.5 < weigh_match(0.99, tee.alias)


def test_what_a_match_says_is_bounded():
    assert weigh_match(1.0) == MOST_NATS
    assert weigh_match(0.0) == LEAST_NATS
