"""The theory against the brute-force twins: sets of maps and of minimal maps on random worlds.

Each world is compared three times over (with all axioms, without planarity, without order and
planarity), each time in three engines: the tree of maps, the program as Python puts it together,
and the files as stock clingo reads them. Minimal maps are compared by count and by inclusion.
"""

from __future__ import annotations

import random
import sys
from collections import Counter
from pathlib import Path

from hssh_kb.experience import Experience

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "axioms"))

import test_basic
import worlds
from comparing import PlaneWalk, find_differences
from plane_worlds import SHAPES

PLANE_WORLDS, LATTICES, BASIC_WALKS = 500, 200, 300
LONGEST = (8, 10, 12, 14)
CROSSINGS = ("T", "Y", "+", "X", "K", "psi", "4-armed", "5-armed")
OFTEN = 30
"""At least so many worlds must show each kind of crossing."""


def run() -> bool:
    """Print the tables; return whether all agree with brute force."""
    return all([check_plane_worlds(), check_lattices(), check_basic()])


def check_plane_worlds() -> bool:
    """Compare on worlds in general position, and count what kinds of places they have."""
    worlds_with: Counter[str] = Counter()
    visits: Counter[str] = Counter()
    counts: list[int] = []
    faults: list[str] = []
    for seed in range(PLANE_WORLDS):
        walk = PlaneWalk(20_000 + seed, longest=LONGEST[seed % len(LONGEST)])
        worlds_with.update(set(walk.shapes))
        visits.update(walk.shapes)
        faults += _compare(walk.experience, f"world {20_000 + seed}", counts)
    print(f"{'places':<12}" + "".join(f"{shape:>10}" for shape in SHAPES))
    for label, counter in (("worlds", worlds_with), ("visits", visits)):
        print(f"{label:<12}" + "".join(f"{counter[shape]:>10}" for shape in SHAPES))
    rare = [shape for shape in CROSSINGS if worlds_with[shape] < OFTEN]
    if rare:
        print(f"in fewer than {OFTEN} worlds: {', '.join(rare)}")
    return _tell(f"{PLANE_WORLDS} worlds in general position", counts, faults) and not rare


def check_lattices() -> bool:
    """Compare on square and triangular lattices with holes, where most places look alike."""
    counts: list[int] = []
    faults: list[str] = []
    for seed in range(LATTICES):
        rng = random.Random(10_000 + seed)
        stubs = seed % 5 == 0
        experience = worlds.random_experience(
            rng, rng.randint(2, 5 if stubs else 10), triangular=seed % 3 == 0, stubs=stubs
        )
        faults += _compare(experience, f"lattice {10_000 + seed}", counts)
    return _tell(f"{LATTICES} lattices", counts, faults)


def _compare(experience: Experience, label: str, counts: list[int]) -> list[str]:
    return [f"{label}: {fault}" for fault in find_differences(experience, counts=counts)]


def _tell(label: str, counts: list[int], faults: list[str]) -> bool:
    counts.sort()
    several = sum(count > 1 for count in counts)
    print(
        f"{label}: {sum(counts)} maps in {len(counts)} comparisons of 3 engines, {several} with "
        f"more than one map, median {counts[len(counts) // 2]}, most {counts[-1]}; "
        f"{len(faults)} differ from brute force (must: 0)"
    )
    for fault in faults[:10]:
        print("  " + fault)
    return not faults


def check_basic() -> bool:
    """Compare maps, paths and places of the basic SSH with its own twin."""
    moves: Counter[str] = Counter()
    wrong = []
    for seed in range(BASIC_WALKS):
        actions = test_basic.draw(seed, 10).actions
        moves.update(a if a in ("travel", "turn around", "turn") else "turn N" for a in actions)
        if test_basic.differs(seed, 10):
            wrong.append(seed)
    told = ", ".join(f"{count} of {name!r}" for name, count in moves.most_common())
    print(
        f"{BASIC_WALKS} walks in the basic SSH ({told}): {len(wrong)} differ from brute force "
        "(must: 0)"
    )
    return not wrong
