"""The basic SSH against its own twin: all ways to say which moments were one dstate."""

import random

import pytest
import worlds

from hssh_kb.basic import (
    BasicExperience,
    basic_experience_from_data,
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


def differs(seed):
    """Compare the maps of one random walk with brute force; return whether they differ."""
    rng = random.Random(seed)
    drive = worlds.random_experience(rng, rng.randint(1, 4), stubs=seed % 4 == 0)
    experience = forget_stars(drive)
    if seed % 3 == 0:  # poorer views, and turns of which nothing is known
        views = tuple(view[:2] for view in experience.views)
        actions = tuple(
            "turn" if a.startswith("turn") and rng.random() < 0.5 else a for a in experience.actions
        )
        experience = BasicExperience(views[:7], actions[:6])
    order = seed % 5 != 0
    expected = {p for p in partitions(experience.views) if holds(experience, p, order=order)}
    for engine in ("tree", "program"):
        maps, complete = enumerate_basic_maps(experience, order=order, engine=engine)
        if not complete or len(maps) != len(expected) or set(maps) != expected:
            return True
    return False


@pytest.mark.parametrize("chunk", range(4))
def test_maps_of_the_basic_ssh_equal_brute_force(chunk):
    assert [seed for seed in range(chunk * 15, chunk * 15 + 15) if differs(seed)] == []


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
