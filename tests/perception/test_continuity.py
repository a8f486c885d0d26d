"""Path continuity and the circular order, on gateways made by hand."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.continuity import rate_alignments, read_stars
from perception.gateways import Gateway
from perception.shapes import name_shape
from perception.star import Star


def gate(heading_deg: float, distance: float = 20, shift: float = 0, width: float = 20) -> Gateway:
    """Return a gateway on a spoke of a wheel; shift moves it sideways."""
    a = math.radians(heading_deg)
    dx, dy = math.cos(a), math.sin(a)
    x, y = distance * dx - shift * dy, distance * dy + shift * dx
    half = width / 2
    return Gateway(
        (x, y), ((x + dy * half, y - dx * half), (x - dy * half, y + dx * half)), a, width
    )


def best(*gates: Gateway, continuity: str = "angle") -> Star:
    return read_stars(gates, (0.0, 0.0), continuity=continuity)[0].star


@pytest.mark.parametrize(
    ("headings", "star"),
    [
        ((0, 90, 180, 270), "a+1 b+1 a-1 b-1"),
        ((0, 90, 180), "a+1 b+1 a-1 b-0"),
        ((0, 90), "a+1 b+1 a-0 b-0"),
        ((0, 180), "a+1 a-1"),
        ((33,), "a+1 a-0"),
        ((0, 120, 240), "a+1 b-0 c+1 a-0 b+1 c-0"),
        ((270, 315, 45, 90), "a+1 b+1 c+1 a-1 b-0 c-0"),
        ((225, 270, 315, 90), "a+1 b+1 c+1 a-0 b-1 c-0"),
        ((0, 90, 200, 270), "a+1 b+1 a-1 b-1"),
        ((0, 135), "a+1 b-0 a-0 b+1"),
    ],
)
def test_published_stars(headings: tuple[int, ...], star: str) -> None:
    for turn in (0, 50, 100, 213):
        found = best(*(gate(heading + turn) for heading in headings))
        assert found.isomorphisms(Star.parse(star.split()))


def test_shapes_have_names_and_tell_mirrors_apart_only_where_they_differ() -> None:
    names = [name_shape(best(*(gate(h) for h in hs))) for hs in ((0, 90, 180), (0, 120, 240), (5,))]
    assert names == ["T", "Y", "dead end"]
    assert name_shape(best(*(gate(h) for h in (225, 270, 315, 90)))) == "psi"
    assert name_shape(best(*(gate(h) for h in (270, 315, 45, 90)))) == "K"
    assert name_shape(best(*(gate(h) for h in (0, 72, 144, 216, 288)))) == "five-armed"
    straight = best(gate(0), gate(180))
    assert name_shape(straight) == "straight"
    assert name_shape(straight, is_narrow=True) == "door"


@pytest.mark.parametrize(("turn", "name"), [(90, "+"), (78, "+"), (70, "X"), (45, "X"), (130, "X")])
def test_x_is_a_crossing_off_the_right_angle(turn: int, name: str) -> None:
    for start in (0, 33, 200, 300):
        gates = [gate(start + h) for h in (0, turn, 180, turn + 180)]
        reading = read_stars(gates, (0.0, 0.0))[0]
        assert name_shape(reading.star, reading.headings_px) == name


def test_shifted_corridor_is_two_paths_under_both_tests() -> None:
    for continuity in ("angle", "ray"):
        assert len(best(gate(0, shift=0), gate(180, shift=25), continuity=continuity)) == 4
        assert len(best(gate(0, shift=0), gate(180, shift=4), continuity=continuity)) == 2


def test_bend_of_25_degrees_is_a_path_by_angle_only() -> None:
    bent = gate(0, 40), gate(205, 40)
    assert len(best(*bent)) == 2
    assert len(best(*bent, continuity="ray")) == 4


def test_two_rivals_for_one_continuation_leave_it_open() -> None:
    readings = read_stars([gate(0), gate(165), gate(195)], (0.0, 0.0))
    assert len(readings) >= 2
    paired = [r for r in readings if len(r.star) == 4]
    assert len(paired) == 2, "either rival may continue the path"
    assert paired[0].weight == pytest.approx(paired[1].weight)


def test_alignments_are_rated_over_all_readings() -> None:
    sure = rate_alignments(read_stars([gate(0), gate(90), gate(180)], (0.0, 0.0)))
    assert [(one.gateways, one.confidence) for one in sure] == [((0, 2), 1.0), ((1,), 1.0)]
    torn = {
        one.gateways: one.confidence
        for one in rate_alignments(read_stars([gate(0), gate(165), gate(195)], (0.0, 0.0)))
    }
    assert torn[0, 1] == pytest.approx(torn[0, 2])
    assert torn[0, 1] + torn[0, 2] + torn[0,] == pytest.approx(1)
    assert torn[0, 1] + torn[2,] >= torn[0, 1]
    assert (1, 2) not in torn


def test_no_gateways_give_the_empty_star() -> None:
    (reading,) = read_stars([], (0.0, 0.0))
    assert len(reading.star) == 0
    assert reading.weight == 1


@given(
    st.lists(st.integers(0, 35), min_size=1, max_size=6, unique=True),
    st.integers(0, 359),
)
def test_turning_the_world_changes_no_star(tens: list[int], turn: int) -> None:
    gates = [gate(10 * t + 0.5 * k) for k, t in enumerate(tens)]
    turned = [gate(10 * t + 0.5 * k + turn) for k, t in enumerate(tens)]
    one, two = read_stars(gates, (0.0, 0.0)), read_stars(turned[::-1], (0.0, 0.0))
    assert one[0].weight == pytest.approx(two[0].weight, abs=1e-6)
    if len(one) == 1 or one[0].weight > one[1].weight + 1e-6:
        assert one[0].star.isomorphisms(two[0].star)
    for reading in one:
        assert sum(reading.star.alpha) == len(tens)
        assert sorted(g for g in reading.gateway_out if g is not None) == list(range(len(tens)))


def test_a_path_that_crosses_another_may_bend_a_little_more_and_lie_further_aside() -> None:
    through = gate(90), gate(270)
    bent, aside = gate(180 + 45), gate(180, shift=24)
    for one in (bent, aside):
        crossing = sorted((gate(0), *through, one), key=lambda g: g.outward_rad % (2 * math.pi))
        assert name_shape(best(*crossing)) == "+"
        assert not best(gate(0), one).isomorphisms(best(gate(0), gate(180)))


def test_two_gateways_on_one_side_of_a_path_are_held_to_the_plain_limit() -> None:
    star = best(gate(0), gate(68), gate(180), gate(292 - 180))
    assert star.alpha.count(0) == 2
