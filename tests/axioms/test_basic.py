"""The basic SSH against its own twin: all ways to say which moments were one dstate."""

import math
import random
from collections import Counter

import pytest
import worlds
from comparing import PlaneWalk

from hssh_kb.basic import (
    BasicExperience,
    basic_experience_from_data,
    describe_basic_map,
    enumerate_basic_maps,
    forget_stars,
)
from hssh_kb.errors import InputError
from hssh_kb.maps import enumerate_maps


def partitions(views):
    """All partitions of moments with equal views, as first-member tuples."""

    def grow(part):
        i = len(part)
        if i == len(views):
            yield tuple(part)
            return
        for q in sorted({q for q in part if views[q] == views[i]} | {i}):
            yield from grow([*part, q])

    yield from grow([])


def holds(experience, part, *, order=True):
    schema = {}
    for i, action in enumerate(experience.actions):
        name = (action, i) if action == "turn" else action
        if schema.setdefault((part[i], name), part[i + 1]) != part[i + 1]:
            return False
    place = {q: q for q in part}
    way = {q: (q, 1) for q in part}
    for (q, name), r in schema.items():
        action = name if isinstance(name, str) else name[0]
        if action.startswith("turn"):
            old, new = place[r], place[q]
            place = {x: new if p == old else p for x, p in place.items()}
        if action in ("travel", "turn around"):
            sign = 1 if action == "travel" else -1
            (h, s), (g, t) = way[q], way[r]
            if h == g:
                if t != s * sign:
                    return False  # along a path in both directions
                continue
            flip = s * sign * t
            way = {x: (h, u * flip) if f == g else (f, u) for x, (f, u) in way.items()}
    if len({(place[q], way[q]) for q in place}) < len(place):
        return False
    if not order:
        return True
    ahead = {}
    for (q, name), r in schema.items():
        if name == "travel":
            h, s = way[q]
            one, other = (place[q], place[r]) if s == 1 else (place[r], place[q])
            ahead.setdefault((h, one), set()).add(other)
    for h, start in ahead:
        seen, todo = set(), [start]
        while todo:
            for p in ahead.get((h, todo.pop()), ()):
                if p == start:
                    return False
                if p not in seen:
                    seen.add(p)
                    todo.append(p)
    return True


BELL = (1, 1, 2, 5, 15, 52, 203, 877, 4140)
FEW = 400


def shorten(experience, longest):
    """As many moments as there are few enough partitions of."""
    count, alike = 0, Counter()
    for view in experience.views[:longest]:
        alike[view] += 1
        if max(alike.values()) >= len(BELL) or math.prod(BELL[n] for n in alike.values()) > FEW:
            break
        count += 1
    return BasicExperience(experience.views[:count], experience.actions[: count - 1])


def draw(seed, longest):
    """What the basic SSH makes of a drive: over a lattice or not, looking around or not."""
    rng = random.Random(seed)
    if seed % 2:
        drive = PlaneWalk(seed, most=200, longest=8).experience
    else:
        drive = worlds.random_experience(rng, 8, triangular=seed % 3 == 0, stubs=seed % 8 == 0)
    experience = forget_stars(drive, look_around=seed % 4 > 1)
    views, actions = experience.views, experience.actions
    if seed % 3 == 0:  # poorer views, and turns of which nothing is known
        views = tuple(view[:2] for view in views)
        actions = tuple(
            "turn" if a.startswith("turn") and rng.random() < 0.5 else a for a in actions
        )
    return shorten(BasicExperience(views, actions), longest)


def count_things(experience, part):
    """(paths, places) of a map, by joining what travels and turns join."""
    place, path = ({q: q for q in part} for _ in range(2))
    for i, action in enumerate(experience.actions):
        q, r = part[i], part[i + 1]
        for name, joined in ((place, action != "travel"), (path, action in JOINS_PATHS)):
            if joined:
                new, old = sorted((name[q], name[r]))
                name.update({x: new for x, y in name.items() if y == old})
    return len(set(path.values())), len(set(place.values()))


JOINS_PATHS = ("travel", "turn around")


def differs(seed, longest=7):
    """Compare all maps of one walk, and their paths and places, with brute force."""
    experience, order = draw(seed, longest), seed % 5 > 0
    expected = {p for p in partitions(experience.views) if holds(experience, p, order=order)}
    for engine in ("tree", "program"):
        maps, complete = enumerate_basic_maps(experience, order=order, engine=engine)
        if not complete or len(maps) != len(expected) or set(maps) != expected:
            return True
    sizes = {m: describe_basic_map(experience, m).size for m in expected}
    return sizes != {m: count_things(experience, m) for m in expected}


@pytest.mark.parametrize("chunk", range(4))
def test_maps_of_the_basic_ssh_equal_brute_force(chunk):
    seeds = range(chunk * 10, chunk * 10 + 10)
    assert [seed for seed in seeds if differs(seed)] == []


def test_stars_spare_hypotheses():
    """On the same drives the hybrid theory has fewer maps than the basic one."""
    for name, gain in (("ring-2x2-l", 1.7), ("block-2x2-plus", 1.6)):
        world, route = worlds.REFERENCES[name][:2]
        drive = world.drive(route[:5])
        hybrid = len(enumerate_maps(drive, planarity=False).maps)
        basic, complete = enumerate_basic_maps(forget_stars(drive))
        assert complete
        assert len(basic) >= gain * hybrid


@pytest.mark.parametrize(
    ("data", "told"),
    [
        ([], "kind"),
        ({"schema": "hssh.trace/1", "kind": "basic"}, "'views' must be"),
        (
            {"schema": "hssh.trace/1", "kind": "basic", "views": ["a"], "actions": ["fly"]},
            "'fly' is not 'travel'",
        ),
        (
            {"schema": "hssh.trace/1", "kind": "basic", "views": ["a", "b"], "actions": []},
            "2 views need 1 actions",
        ),
    ],
)
def test_faults_of_a_basic_trace_are_told(data, told):
    with pytest.raises(InputError) as caught:
        basic_experience_from_data(data)
    assert told in str(caught.value)
