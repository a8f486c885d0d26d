"""What another visit saw of a place, where this one could not look."""

from dataclasses import replace

import numpy as np
import pytest

from perception.geometry import compose
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame
from perception.places import PlaceReading, PlaceSettings, PlaceVisit
from perception.recall import recall_readings
from perception.star import Star
from perception.tile_matching import Tile, match_visits, rate_match, refine_pose

PLUS, TEE = (Star.parse(("a+1", f"b+{south}", "a-1", "b-1")) for south in (1, 0))
HEADINGS = (0.0, -np.pi / 2, np.pi, np.pi / 2)
CELLS, CELL_M = 151, 0.1


def draw_crossing(south_m, *, is_walled=False, centre=(0.0, 0.0)):
    """A crossing 7.5 m to each side, uneven so that it fits in one way; south it is seen so far."""
    frame = Frame(centre[0] - 7.55, centre[1] + 7.55, CELL_M)
    rows, columns = np.indices((CELLS, CELLS))
    points = frame.to_metres(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    x, y = points.T.reshape(2, CELLS, CELLS)

    def free(grow):
        along = (np.abs(y) < 1.0 + grow) | ((np.abs(y - 0.6) < 1.0 + grow) & (x > 3.0))
        north = (np.abs(x) < 0.9 + grow) & (y > 0)
        south = (np.abs(x) < 0.9 + grow) & (y < 0) & (y > -1.0 - south_m - grow * is_walled)
        return along | north | south

    image = np.full((CELLS, CELLS), UNKNOWN, np.uint8)
    image[free(0.15)] = OCCUPIED
    image[free(0.0)] = FREE
    return image, frame


def read(star, weight):
    gateways = tuple((1.2 * np.cos(h), 1.2 * np.sin(h)) for h in HEADINGS)
    return PlaceReading(star, 0, 0, HEADINGS, gateways, weight)


def visit(scan, drawn, weights, centre=(0.0, 0.0)):
    readings = (read(PLUS, weights[0]), read(TEE, weights[1]))
    readings = tuple(sorted((r for r in readings if r.weight), key=lambda r: -r.weight))
    return PlaceVisit(
        scan, scan - 2, scan + 2, np.array(centre, float), 1.2, readings, drawn[0], drawn[1]
    )


def drive(x=0.0):
    """West to east through the crossing twice, back round somewhere far north."""
    there = np.column_stack([np.arange(-6, 6.5, 0.5), np.zeros(25), np.zeros(25)])
    return np.concatenate([there, there + np.array([x, 0.0, 0.0])])


def recall(first, second, poses=None):
    poses = drive() if poses is None else poses
    tiles, matches = match_visits((first, second), poses)
    return recall_readings((first, second), poses, tiles, matches, PlaceSettings())


def weights(found):
    return {r.star: r.weight for r in found.readings}


def test_a_way_that_another_visit_looked_into_is_believed():
    known = visit(12, draw_crossing(6.0), (1.0, 0.0))
    doubtful = visit(37, draw_crossing(0.2), (0.1, 0.9))
    same, told = recall(known, doubtful)
    assert same is known
    assert told.readings[0].star == PLUS
    assert 0.6 < weights(told)[PLUS] < 0.82
    assert sum(weights(told).values()) == pytest.approx(1.0)
    assert told.readings[0].gateways_m == doubtful.readings[1].gateways_m


def test_the_earlier_visit_learns_from_the_later_too_though_it_lies_aside():
    doubtful = visit(12, draw_crossing(0.2), (0.1, 0.9))
    aside = (0.3, -0.15)
    known = visit(37, draw_crossing(6.0), (1.0, 0.0), aside)
    image, frame = draw_crossing(6.0)
    known = replace(known, tile=image, tile_frame=frame)
    assert recall(doubtful, known)[0].readings[0].star == PLUS


def test_a_way_that_was_read_is_not_taken_back():
    other = visit(12, draw_crossing(0.2, is_walled=True), (0.0, 1.0))
    sure = visit(37, draw_crossing(0.2), (0.9, 0.1))
    assert weights(recall(other, sure)[1]) == pytest.approx({PLUS: 0.9, TEE: 0.1})


def test_places_far_apart_or_unlike_tell_each_other_nothing():
    known = visit(12, draw_crossing(6.0), (1.0, 0.0))
    far = visit(37, draw_crossing(0.2, centre=(40.0, 0.0)), (0.1, 0.9), (40.0, 0.0))
    assert recall(known, far, drive(40.0))[1] is far
    image, frame = draw_crossing(0.2)
    image[25:66], image[25], image[85:] = FREE, OCCUPIED, UNKNOWN  # a hall north of a wall
    unlike = visit(37, (image, frame), (0.1, 0.9))
    assert recall(known, unlike)[1] is unlike


def test_a_star_that_the_other_visit_rules_out_gains_nothing():
    other = visit(12, draw_crossing(6.0), (0.0, 1.0))
    doubtful = visit(37, draw_crossing(0.2), (0.1, 0.9))
    assert weights(recall(other, doubtful)[1])[PLUS] <= 0.1


def test_what_is_in_no_doubt_is_left_alone():
    pair = visit(12, draw_crossing(6.0), (1.0, 0.0)), visit(37, draw_crossing(0.2), (0.0, 1.0))
    assert recall(*pair) == pair


@pytest.mark.parametrize("pose", [(0.33, -0.21, 0.05), (-0.5, 0.4, -0.1)])
def test_tiles_are_laid_over_each_other_to_a_fraction_of_a_cell(pose):
    image, frame = draw_crossing(6.0)
    rows, columns = np.indices(image.shape)
    points = frame.to_metres(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    moved = np.array([compose(np.array(pose), np.array([*p, 0.0]))[:2] for p in points])
    column, row = np.rint(frame.to_pixels(moved)).astype(int).T
    on = (column >= 0) & (row >= 0) & (column < CELLS) & (row < CELLS)
    turned = np.full(image.size, UNKNOWN, np.uint8)
    turned[on] = image[row[on], column[on]]
    tiles = Tile(image, frame), Tile(turned.reshape(image.shape), frame)
    share, about = rate_match(*tiles)
    assert share > 0.9
    assert refine_pose(*tiles, about) == pytest.approx(pose, abs=0.05)
