"""What should change nothing: where star lists begin, names, left and right swapped, the way back.

Each change of the experience says exactly how the maps change with it; nothing else may.
"""

import random

import pytest
import worlds
from comparing import PlaneWalk

from hssh_kb.basic import BasicExperience, describe_basic_map, enumerate_basic_maps, forget_stars
from hssh_kb.maps import enumerate_maps, minimal_maps
from hssh_kb.trace import experience_from_data, experience_to_data

SWITCHES = ({}, {"planarity": False}, {"order": False, "planarity": False})


def draw(seed):
    """A walk over a lattice or in general position."""
    if seed % 2:
        return PlaneWalk(seed, most=200, longest=7).experience
    rng = random.Random(seed)
    stubs = seed % 5 == 0
    return worlds.random_experience(rng, 4 if stubs else 6, triangular=seed % 3 == 0, stubs=stubs)


def turned(experience, turns):
    """Each star listed from elsewhere: dlp k becomes dlp k - turn."""
    data = experience_to_data(experience)
    for item, turn in zip(data["visits"], turns, strict=True):
        size = len(item["star"])
        item["star"] = [item["star"][(k + turn) % size] for k in range(size)]
        for key in ("arrive", "depart"):
            if item[key] is not None:
                item[key] = (item[key] - turn) % size
    return experience_from_data(data)


def mirrored(experience):
    """Left and right swapped: dlp k becomes dlp -k - 1."""
    data = experience_to_data(experience)
    for item in data["visits"]:
        item["star"].reverse()
        for key in ("arrive", "depart"):
            if item[key] is not None:
                item[key] = len(item["star"]) - 1 - item[key]
    return experience_from_data(data)


def renamed(rng, experience):
    """Other names for the local-paths of each visit, and their directions swapped or not."""
    data = experience_to_data(experience)
    for item in data["visits"]:
        names = sorted({text[:-2] for text in item["star"]})
        new = dict(zip(names, rng.sample("uvwxyz", len(names)), strict=True))
        swap = {name: rng.random() < 0.5 for name in names}
        signs = {"+": "-", "-": "+"}
        item["star"] = [
            new[t[:-2]] + (signs[t[-2]] if swap[t[:-2]] else t[-2]) + t[-1] for t in item["star"]
        ]
    return experience_from_data(data)


def reversed_walk(experience):
    """The same walk driven home, last visit first."""
    data = experience_to_data(experience)
    visits = []
    for visit, item in zip(experience.visits[::-1], data["visits"][::-1], strict=True):
        arrive = None if visit.depart is None else visit.star.opposite(visit.depart)
        depart = None if visit.arrive is None else visit.star.opposite(visit.arrive)
        visits.append({"star": item["star"], "arrive": arrive, "depart": depart})
    return experience_from_data({**data, "visits": visits})


def keys(maps):
    return {(h.visits, h.offsets) for h in maps}


def turn_map(turns, sizes):
    def change(visits, offsets):
        changed = zip(visits, offsets, turns, sizes, strict=True)
        return visits, tuple((r + turn - turns[p]) % m for p, r, turn, m in changed)

    return change


def mirror_map(sizes):
    def change(visits, offsets):
        return visits, tuple(-r % m for r, m in zip(offsets, sizes, strict=True))

    return change


def reverse_map(sizes):
    def change(visits, offsets):
        last = len(visits) - 1
        latest = {p: v for v, p in enumerate(visits)}
        new = [
            (last - latest[p], (r - offsets[latest[p]]) % m)
            for p, r, m in zip(visits, offsets, sizes, strict=True)
        ]
        places, turns = zip(*reversed(new), strict=True)
        return places, turns

    return change


def keep_map(visits, offsets):
    return visits, offsets


def check_changed(experience, other, change):
    """All maps, the minimal ones and their costs are those of before, changed alike."""
    for switches in SWITCHES:
        maps = keys(enumerate_maps(experience, **switches).maps)
        assert keys(enumerate_maps(other, **switches).maps) == {change(*m) for m in maps}
    for switches in SWITCHES[:2]:
        best, again = minimal_maps(experience, **switches), minimal_maps(other, **switches)
        assert keys(again.maps) == {change(*m) for m in keys(best.maps)}
        assert again.costs == best.costs


@pytest.mark.parametrize("seed", range(6000, 6016))
def test_stars_names_and_sides_change_maps_only_as_they_say(seed):
    experience = draw(seed)
    rng = random.Random(seed)
    sizes = [len(visit.star) for visit in experience.visits]
    turns = [rng.randrange(m) for m in sizes]
    check_changed(experience, turned(experience, turns), turn_map(turns, sizes))
    check_changed(experience, mirrored(experience), mirror_map(sizes))
    check_changed(experience, renamed(rng, experience), keep_map)


@pytest.mark.parametrize("seed", range(6100, 6112))
def test_the_way_back_has_the_same_maps(seed):
    experience = draw(seed)
    sizes = [len(visit.star) for visit in experience.visits]
    check_changed(experience, reversed_walk(experience), reverse_map(sizes))


@pytest.mark.parametrize("seed", range(6200, 6210))
def test_a_world_seen_in_a_mirror_or_driven_home_is_the_experience_changed(seed):
    walk = PlaneWalk(seed, most=200, longest=7)
    partitions = {h.visits for h in enumerate_maps(walk.experience).maps}
    glass = walk.world.mirror().drive(walk.route, walk.rotations)
    assert {h.visits for h in enumerate_maps(glass).maps} == partitions
    home = walk.world.drive(walk.route[::-1], walk.rotations[::-1])
    assert home.visits == reversed_walk(walk.experience).visits


def basic_sizes(experience):
    maps, complete = enumerate_basic_maps(experience, limit=20_000)
    assert complete
    return {m: describe_basic_map(experience, m).size for m in maps}


@pytest.mark.parametrize("seed", range(6300, 6316))
def test_the_basic_ssh_takes_no_note_of_star_lists_names_and_sides(seed):
    """Reversing a walk means nothing here: an action need not be undone by another."""
    experience = draw(seed)
    rng = random.Random(seed)
    basic = forget_stars(experience, look_around=seed % 4 == 0)
    basic = BasicExperience(basic.views[:14], basic.actions[:13])
    found = basic_sizes(basic)

    turns = [rng.randrange(len(visit.star)) for visit in experience.visits]
    plain = forget_stars(experience)
    for other in (turned(experience, turns), renamed(rng, experience)):
        same = forget_stars(other)
        assert (same.views, same.actions) == (plain.views, plain.actions)

    glass = forget_stars(mirrored(experience))
    short = BasicExperience(plain.views[:14], plain.actions[:13])
    assert basic_sizes(BasicExperience(glass.views[:14], glass.actions[:13])) == basic_sizes(short)

    symbols = sorted(set(basic.views))
    new = dict(zip(symbols, rng.sample(range(100), len(symbols)), strict=True))
    words = sorted({a for a in basic.actions if a.startswith("turn ")} - {"turn around"})
    said = dict(zip(words, rng.sample(range(100), len(words)), strict=True))
    other = BasicExperience(
        tuple(f"view {new[w]}" for w in basic.views),
        tuple(f"turn by {said[a]}" if a in said else a for a in basic.actions),
    )
    assert basic_sizes(other) == found
