"""One experience, every engine: sets of maps and of minimal maps beside those of the twin."""

from __future__ import annotations

import random
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, islice

import brute_force
import plane_worlds
import worlds

from hssh_kb.experience import Experience
from hssh_kb.facts import experience_to_facts
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.maps import enumerate_maps, minimal_maps
from hssh_kb.program import has_alternatives, make_converter
from hssh_kb.solver import solve_all, solve_best
from hssh_kb.theory import axiom_program, read_program

COLUMNS: tuple[dict[str, bool], ...] = (
    {},
    {"planarity": False},
    {"order": False, "planarity": False},
)
"""Which axioms hold, as the columns of the reference table, the fullest theory first."""
LONGEST = 24
DRAWS = 6
Walk = tuple[plane_worlds.PlaneWorld, list[int], list[int]]
Key = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
_INCLUDE = re.compile(r'#include "(?P<name>[^"]+)\.lp"\.')
_SWITCHED = {"order": "order_irreflexive", "planarity": "planarity"}


def keys(maps: Iterable[Hypothesis]) -> set[Key]:
    """What maps are compared by: places, offsets and readings of the visits."""
    return {(h.visits, h.offsets, h.readings or (0,) * len(h.visits)) for h in maps}


def read_closure(name: str, *, without: Iterable[str] = ()) -> str:
    """A file with all that it includes, some files left out."""
    left_out = set(without)
    text = read_program(name)
    parts = [
        read_closure(include, without=left_out)
        for include in _INCLUDE.findall(text)
        if include not in left_out
    ]
    return "\n".join([_INCLUDE.sub("", text), *parts])


def maps_from_files(experience: Experience, **switches: bool) -> list[Hypothesis]:
    """All maps as a user of stock clingo finds them: ``all_maps.lp`` less the files left out."""
    without = [axiom_program(_SWITCHED[name]) for name, on in switches.items() if not on]
    program = read_closure("all_maps", without=without) + experience_to_facts(experience)
    convert = make_converter(len(experience), has_alternatives(experience))
    return list(solve_all(program, convert).found)


def best_from_files(experience: Experience, **switches: bool) -> list[Hypothesis]:
    """The minimal maps as ``best_maps.lp`` finds them."""
    without = [axiom_program(_SWITCHED[name]) for name, on in switches.items() if not on]
    program = read_closure("best_maps", without=without) + experience_to_facts(experience)
    convert = make_converter(len(experience), has_alternatives(experience))
    return list(solve_best(program, convert).found)


def find_differences(
    experience: Experience,
    columns: Sequence[int] = (0, 1, 2),
    counts: list[int] | None = None,
) -> Iterator[str]:
    """Say where an engine differs from the twin; nothing if all agree.

    The number of maps in each column is added to ``counts``. Minimal maps are compared where axiom
    8 holds: the paths of a map without it may be circular.
    """
    for column in columns:
        yield from _compare_maps(experience, COLUMNS[column], counts)
        if COLUMNS[column].get("order", True):
            yield from _compare_best(experience, COLUMNS[column])


def _compare_maps(
    experience: Experience, switches: dict[str, bool], counts: list[int] | None
) -> Iterator[str]:
    twin = {tuple(m) for m in brute_force.all_maps(brute_force.plain(experience), **switches)}
    if counts is not None:
        counts.append(len(twin))
    found = {
        "tree": enumerate_maps(experience, **switches).maps,
        "program": enumerate_maps(experience, engine="program", **switches).maps,
        "files": maps_from_files(experience, **switches),
    }
    for engine, maps in found.items():
        if len(maps) != len(twin) or keys(maps) != twin:
            yield f"{engine} {switches}: {len(maps)} maps, twin {len(twin)}"


def _compare_best(experience: Experience, switches: dict[str, bool]) -> Iterator[str]:
    plain = brute_force.plain(experience)
    ties = {tuple(m) for m in brute_force.best_maps(plain, **switches)[1]}
    minimal = {tuple(m) for m in brute_force.subset_minimal(plain, **switches)}
    best = {
        "fewest": (minimal_maps(experience, **switches).maps, ties),
        "best_maps.lp": (best_from_files(experience, **switches), ties),
        "subset": (minimal_maps(experience, minimal="subset", **switches).maps, minimal),
    }
    for name, (maps, expected) in best.items():
        if len(maps) != len(expected) or keys(maps) != expected:
            yield f"{name} {switches}: {len(maps)} maps, twin {len(expected)}"


class PlaneWalk:
    """A random walk in a world in general position, as long as few enough maps explain it.

    Of some walks the one is taken on which most crossings look alike: else the stars tell nearly
    everything. ``most`` bounds the maps of the weakest theory compared, so that all engines and the
    twin can list them.
    """

    def __init__(self, seed: int, most: int = 1500, longest: int = LONGEST):
        rng = random.Random(seed)
        walks = [self._draw(rng, longest) for _ in range(DRAWS)]
        self.world, route, rotations = max(walks, key=lambda walk: _count_alike(*walk))
        most = rng.choice((most // 25, most // 5, most))
        travels = 2
        while travels < longest:
            drive = self.world.drive(route[: travels + 2], rotations)
            twin = brute_force.Twin(brute_force.plain(drive), order=False, planarity=False)
            if sum(1 for _ in islice(twin.maps(), most + 1)) > most:
                break
            travels += 1
        self.route, self.rotations = route[: travels + 1], rotations[: travels + 1]
        self.experience = self.world.drive(self.route, self.rotations)

    @staticmethod
    def _draw(rng: random.Random, longest: int) -> Walk:
        world = plane_worlds.random_plane_world(rng)
        route = worlds.random_walk(rng, world, longest)
        return world, route, [rng.randrange(10) for _ in route]

    @property
    def shapes(self) -> list[str]:
        """What the place of each visit looks like."""
        return [self.world.shape(i) for i in self.route]

    def true_map(self) -> Hypothesis:
        """The map in which each place of the world is one place."""
        first: dict[int, int] = {}
        visits = [first.setdefault(i, v) for v, i in enumerate(self.route)]
        offsets = [
            (self.rotations[v] - self.rotations[p]) % len(self.experience.visits[v].star)
            for v, p in enumerate(visits)
        ]
        return Hypothesis(tuple(visits), tuple(offsets))


def _count_alike(world: plane_worlds.PlaneWorld, route: list[int], rotations: list[int]) -> int:
    """Pairs of different places on a walk, three ways or more, whose stars are isomorphic."""
    crossings = [i for i in route if len(world.neighbours(i)) > 2]
    stars = [world.drive([i]).visits[0].star for i in crossings]
    pairs = combinations(zip(crossings, stars, strict=True), 2)
    return sum(i != j and bool(one.isomorphisms(other)) for (i, one), (j, other) in pairs)
