"""How sure a gateway is, from what the robot did and saw; what a bare path is."""

from dataclasses import replace

import numpy as np
import pytest

from perception.evidence import see_beyond, see_through, share_hidden, weigh_gateways
from perception.grid import UNKNOWN, classify
from perception.sightings import is_path
from perception.star import Star
from perception.topology import local_topology

LIMITS = {"min_frontier_px": 9.0, "min_depth_px": 10.0}
NOWHERE = np.zeros((0, 2))


def draw_tee(sliver_px):
    """A corridor from west to east and a way south, of which a sliver is seen."""
    image = np.full((150, 150), UNKNOWN, np.uint8)
    image[62:88, :] = 0
    image[64:86, :] = 255
    image[86:, 62:90] = UNKNOWN
    image[86:, 62] = image[86:, 89] = 0
    for k in range(sliver_px):
        image[86 + k, 63 : 63 + max(26 - 26 * k // sliver_px, 1)] = 255
    return image


def read(image):
    return local_topology(
        image, resolution_m=0.1, robot_radius_m=0.4, min_depth_m=0.5, denoise=False
    )


def southern(topology):
    return max(topology.gateways, key=lambda g: g.centre_px[1])


def test_one_sees_further_through_a_sliver_than_one_can_go():
    image = draw_tee(40)
    gateway = southern(read(image))
    seen = see_through(gateway, classify(image).free)
    assert seen > 25
    assert seen > gateway.depth_px + 5


def test_a_way_seen_as_a_sliver_is_surer_than_a_niche():
    topology = read(draw_tee(40))
    doubtful = [replace(g, confidence=0.5) for g in topology.gateways]
    topology = replace(topology, gateways=tuple(doubtful))
    sliver = weigh_gateways(topology, draw_tee(40), NOWHERE, **LIMITS)
    niche = weigh_gateways(topology, draw_tee(12), NOWHERE, **LIMITS)
    assert southern(sliver).confidence > 0.9
    assert southern(sliver).confidence > southern(niche).confidence
    assert sum(sliver.star.alpha) == 3


def test_what_is_seen_no_further_than_an_alcove_is_in_doubt():
    image = draw_tee(0)
    image[86:98, 63:89] = 255  # its end is not seen
    topology = read(image)
    alcove = southern(topology)
    assert alcove.outward_rad == pytest.approx(np.pi / 2, abs=0.3)
    weighed = southern(weigh_gateways(topology, image, NOWHERE, **LIMITS))
    assert weighed.confidence < 0.3 < alcove.confidence


def test_what_hides_its_end_may_go_on_sooner_than_what_is_seen_to_end():
    hidden, closed, half = draw_tee(0), draw_tee(0), draw_tee(0)
    for image in (hidden, closed, half):
        image[86:98, 63:89] = 255
    closed[98:100, 62:90] = half[98:100, 62:76] = 0
    topology = read(hidden)
    gateway = southern(topology)
    shares = [share_hidden(gateway, classify(image)) for image in (hidden, closed, half)]
    assert shares[0] == 1.0
    assert shares[1] == 0.0
    assert 0.3 < shares[2] < 0.7
    sure = [
        southern(weigh_gateways(topology, image, NOWHERE, **LIMITS)).confidence
        for image in (hidden, half, closed)
    ]
    assert sure[0] > 2 * sure[1] > 2 * sure[2]


def test_a_way_that_goes_on_aslant_is_seen_but_an_alcove_is_no_deeper_for_that():
    ways, alcove = draw_tee(0), draw_tee(0)
    ways[86:98, 63:89] = alcove[86:98, 63:89] = 255
    for k in range(50):
        ways[min(90 + k // 2, 149), 40 - min(k, 40) : 66 + 20 - k // 3] = 255
    gateway = southern(read(alcove))
    far, near = (see_beyond(gateway, classify(image).free) for image in (ways, alcove))
    assert near == see_through(gateway, classify(alcove).free)
    assert far > near + 10


def test_off_the_grid_one_sees_for_ever():
    image = draw_tee(40)
    western = min(read(image).gateways, key=lambda g: g.centre_px[0])
    assert see_through(western, classify(image).free) == len(image)


def test_a_gateway_that_the_robot_went_through_is_sure():
    image = draw_tee(40)
    topology = read(image)
    x, y = southern(topology).centre_px
    way = np.array([[x, y - 8], [x + 1, y + 8]])
    assert southern(weigh_gateways(topology, image, way, **LIMITS)).confidence == 1.0


def test_without_gateways_there_is_nothing_to_weigh():
    topology = replace(read(draw_tee(40)), gateways=())
    assert weigh_gateways(topology, draw_tee(40), NOWHERE, **LIMITS) is topology


@pytest.mark.parametrize(
    ("star", "told"),
    [
        (["a+1", "a-1"], True),
        (["a+1", "a-0"], False),  # a dead end
        (["a+1", "b+1", "a-0", "b-0"], False),  # two gateways, but two paths: a corner
        (["a+1", "b+1", "a-1", "b-0"], False),
        ([], False),
    ],
)
def test_on_path_is_two_gateways_on_one_path(star, told):
    assert is_path(Star.parse(star)) is told


def test_an_alcove_whose_end_is_seen_is_deeper_than_wide_or_no_way():
    wide, narrow = draw_tee(0), draw_tee(0)
    wide[86:110, 63:89] = 255
    wide[86:98, 89:95] = 255  # one corner of it is not seen
    wide[110, 62:90] = 0
    narrow[86:, 62:90] = UNKNOWN
    narrow[86:110, 70:82] = 255
    narrow[86:110, 69] = narrow[86:110, 82] = narrow[110, 69:83] = 0
    narrow[86:88, 62:90] = 0
    narrow[86:88, 70:82] = 255
    topology = read(draw_tee(40))
    gateway = southern(topology)
    slim = replace(gateway, ends_px=((81.0, 88.0), (70.0, 88.0)), width_px=11.0)
    sure = []
    for image, one in ((wide, gateway), (narrow, slim)):
        others = tuple(g for g in topology.gateways if g is not gateway)
        seen = replace(topology, gateways=(*others, replace(one, depth_px=20.0)))
        sure.append(southern(weigh_gateways(seen, image, NOWHERE, **LIMITS)).confidence)
    assert sure[0] < 0.3
    assert sure[1] > 0.55


def test_where_nobody_looked_the_length_of_a_way_says_nothing_once_the_robot_has_left():
    image = draw_tee(0)
    image[86:92, 63:89] = 255
    topology = read(draw_tee(40))
    short = [replace(g, depth_px=3.0) if g is southern(topology) else g for g in topology.gateways]
    topology = replace(topology, gateways=tuple(short))
    under_way = southern(weigh_gateways(topology, image, NOWHERE, **LIMITS)).confidence
    over = southern(weigh_gateways(topology, image, NOWHERE, **LIMITS, is_over=True)).confidence
    assert 0.4 < over < 0.6
    assert under_way < 0.75 * over


def test_no_way_is_quite_sure_but_those_that_were_driven():
    image = draw_tee(0)
    image[86:, 63:89] = 255
    topology = read(image)
    driven = np.column_stack([np.linspace(20, 130, 50), np.full(50, 75.0)])
    weighed = weigh_gateways(topology, image, driven, **LIMITS)
    sure = sorted(g.confidence for g in weighed.gateways)
    assert sure[1:] == [1.0, 1.0]
    assert 0.9 < sure[0] < 0.95
    assert sum(weighed.star.alpha) == 3
    assert len(weighed.readings) > 1  # without it, too


def test_where_one_way_on_is_in_doubt_a_corner_is_likelier_than_a_dead_end():
    image = draw_tee(40)
    image[62:88, 90:] = UNKNOWN
    image[62:88, 89] = 0  # no way east: what is left is a corner, or a dead end
    topology = read(image)
    assert len(topology.gateways) == 2
    doubtful = tuple(
        replace(g, depth_px=12.0, frontier_px=12.0) if g is southern(topology) else g
        for g in topology.gateways
    )
    image[86:, 63:89] = UNKNOWN
    image[86:92, 63:89] = 255
    driven = np.column_stack([np.linspace(10, 75, 50), np.full(50, 75.0)])
    topology = replace(topology, gateways=doubtful)
    weighed = weigh_gateways(topology, image, driven, **LIMITS, is_over=True)
    assert southern(weighed).confidence < 0.5
    assert sum(weighed.star.alpha) == 2
    assert sum(weighed.readings[1].star.alpha) == 1
