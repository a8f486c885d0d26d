"""The compiled loops of the skeleton give what the array form gives, to the last bit."""

from collections.abc import Iterator

import numpy as np
import pytest

from perception import kernels
from perception.cracks import Cracks, find_cracks, link_cracks, measure_field, walk_chains
from perception.errors import InputError
from perception.grid import classify
from perception.region import Region, find_region
from perception.topology import local_topology, topology_to_data
from tests.perception.corpus import PLUS, SHAPES, draw_fine, flip, scale

NAMES = {shape.name: shape for shape in (PLUS, *SHAPES)}


@pytest.fixture(autouse=True)
def _forget_choice() -> Iterator[None]:
    yield
    kernels.use_numba(None)


def region_of(name: str, turn: int, side: int, noise: float) -> Region:
    image = flip(scale(draw_fine(NAMES[name], turn, 600), side), noise, np.random.default_rng(3))
    middle = (side - 1) / 2, (side - 1) / 2
    return find_region(
        classify(image), middle, radius_px=2.0, min_frontier_px=0, island_px=side / 5
    )


class PlainLoops:
    spread_faces = staticmethod(kernels.spread_faces)
    cross_faces = staticmethod(kernels.cross_faces)
    follow_chains = staticmethod(kernels.follow_chains)


def same(one: Cracks, other: Cracks) -> bool:
    return all(
        (getattr(one, name) == getattr(other, name)).all()
        for name in ("corners", "points_px", "radius_px", "left", "right")
    )


@pytest.mark.parametrize("name", ["+", "five-armed", "K", "dead end"])
def test_loops_find_the_same_cracks_and_chains_as_arrays(name: str) -> None:
    for turn, side, noise, midline in ((0, 60, 0.0, 9.0), (20, 75, 0.04, 30.0)):
        region = region_of(name, turn, side, noise)
        field = measure_field(region, midline)
        assert (measure_field(region, midline, PlainLoops()).face == field.face).all()  # type: ignore[arg-type]
        cracks = find_cracks(region, field)
        assert len(cracks.radius_px) > 20
        assert same(cracks, find_cracks(region, field, PlainLoops()))  # type: ignore[arg-type]
        beyond, node = link_cracks(cracks.corners)
        path, first = kernels.follow_chains(beyond, node)
        chains = [c.tolist() for c, _, _ in walk_chains(beyond.tolist(), node.tolist())]
        split = [part.tolist() for part in np.split(path, first[1:-1])]
        assert split == chains


def test_numba_changes_nothing_but_the_time() -> None:
    pytest.importorskip("numba", reason="the extra 'fast' (numba) is not installed")
    for name, shape in NAMES.items():
        image = flip(scale(draw_fine(shape, 31, 600), 199), 0.1, np.random.default_rng(5))
        found = []
        for wanted in (False, True):
            kernels.use_numba(wanted)
            found.append(local_topology(image))
        plain, compiled = (topology_to_data(one, name) | {"seconds": 0} for one in found)
        assert plain == compiled
        assert (found[0].skeleton_px == found[1].skeleton_px).all()


def test_without_numba_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "has_numba", lambda: False)
    with pytest.raises(InputError, match="pip install"):
        kernels.use_numba(True)
    kernels.use_numba(None)
    monkeypatch.setattr(kernels._Choice, "seen", kernels.WORTH_IT)
    assert kernels.get_kernels() is None
