"""Robots that follow suggestions in symbolic worlds, and expected entropy by brute force."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
from symbolic_walks import Eyes, Walk, World, make_grid, observe, walk_randomly

from hssh_kb.experience import Experience, Visit
from hssh_kb.kb import KnowledgeBase
from hssh_kb.maps import enumerate_maps
from hssh_kb.place_graph import build_place_graph
from hssh_kb.ranking import RankedMaps, count_map
from perception.star import Star

SYMBOLS = Eyes(turned=False, headings=False)


def look(star: Star, facing: int) -> tuple:
    """What one sees: alpha and the distance to the opposite, clockwise; written anew here."""
    names = [(d.path, d.direction) for d in star.dlps]
    out = []
    for i in range(len(star)):
        k = (facing + i) % len(star)
        d = star.dlps[k]
        other = names.index((d.path, "-" if d.direction == "+" else "+"))
        out.append((d.alpha, (other - k) % len(star)))
    return tuple(out)


# -- expected entropy, each map in turn taken for the true world -----------------------------


class BruteForce:
    """Lists every run of observations with its probability under each map."""

    def __init__(self, experience, maps, weights, lead):
        self.experience, self.maps, self.weights, self.lead = experience, maps, weights, lead
        self.graphs = [build_place_graph(experience, h) for h in maps]
        self.seen, self.total = defaultdict(float), 1.0
        for visit in experience.visits:
            self.total += 1.0
            for reading in visit.readings:
                star = reading.star
                if reading.arrive is not None:
                    self.seen[look(star, reading.arrive)] += reading.weight
                    continue
                names = [(d.path, d.direction) for d in star.dlps]
                doors = [
                    names.index((d.path, "-" if d.direction == "+" else "+"))
                    for d in star.dlps
                    if d.alpha
                ]
                for k in doors:
                    self.seen[look(star, k)] += reading.weight / len(doors)
        doubt = [1 - visit.readings[0].weight for visit in experience.visits]
        self.misread = sum(doubt) / len(doubt)

    def anything(self) -> dict:
        """Whatever may come where nothing is known; None stands for what was never seen."""
        found = {view: count / self.total for view, count in self.seen.items()}
        return {**found, None: 1 - sum(found.values())}

    def start(self, i):
        h, last = self.maps[i], len(self.experience) - 1
        place, facing = h.place_dlp(
            self.experience, last, h.reading(self.experience, last).arrive or 0
        )
        return f"P{place}", facing

    def go(self, i, stand, turn):
        """Where map i says a travel leads to, and what is seen there."""
        label, facing = stand
        graph = self.graphs[i]
        size = len(graph.places[label].star)
        edge = graph.edge_at.get((label, (facing + turn) % size))
        if edge is None:
            return None, None
        return (edge.goal, edge.arrive), look(graph.places[edge.goal].star, edge.arrive)

    def expect_entropy(self, turns) -> float:
        runs = defaultdict(lambda: np.zeros(len(self.maps)))
        for i in range(len(self.maps)):
            for run, chance in self._runs(i, self.start(i), self.start(self.lead), turns, ()):
                runs[run][i] += chance * self.weights[i]
        expected = 0.0
        for joint in runs.values():
            whole = joint.sum()
            expected -= sum(p * math.log2(p / whole) for p in joint if p > 0)
        return expected

    def _runs(self, i, stand, leader, turns, before):
        """Yield the runs of observations that end after the turns or at the first surprise."""
        if not turns:
            yield before, 1.0
            return
        onward, expected = self.go(self.lead, leader, turns[0])
        mine, view = (None, None) if stand is None else self.go(i, stand, turns[0])
        chances = dict(self.anything())
        if mine is not None:
            chances = {seen: self.misread * p for seen, p in chances.items()}
            chances[view] = chances.get(view, 0.0) + 1 - self.misread
        for seen, chance in chances.items():
            if chance <= 0:
                continue
            run = (*before, seen)
            if onward is None or seen != expected:
                yield run, chance
            else:
                after = mine if mine is not None and view == seen else None
                for whole, rest in self._runs(i, after, onward, turns[1:], run):
                    yield whole, chance * rest


# -- simulated robots --------------------------------------------------------------------------


class Robot:
    """A robot on a walk through a symbolic world, which does as it is told."""

    def __init__(self, world: World, walk: Walk, seed: int = 0):
        self.world, self.walk, self.seed = world, walk, seed
        self.log: list[tuple[int, Star, int]] = []  # turn taken, star then seen, dlp then faced

    @property
    def experience(self) -> Experience:
        """The walk so far, in symbols only."""
        truth = observe(self.world, self.walk, SYMBOLS, np.random.default_rng(self.seed))
        visits = tuple(Visit(v.readings, None) for v in truth.experience.visits)
        return Experience(visits, "robot")

    @property
    def partition(self) -> tuple[int, ...]:
        first: dict[int, int] = {}
        return tuple(first.setdefault(p, v) for v, p in enumerate(self.walk.places))

    @property
    def travels(self) -> int:
        return len(self.walk.places) - 1

    @property
    def star(self) -> Star:
        return self.experience.visits[-1].star

    def view(self) -> tuple:
        return look(self.star, self.walk.arrive[-1])

    def travel(self, turn: int) -> None:
        here, size = self.walk.places[-1], len(self.world.dlps[self.walk.places[-1]])
        k = (self.walk.arrive[-1] + turn) % size
        there, gateway = self.world.corridors[here, k]
        self.walk.depart[-1] = k
        self.walk.places.append(there)
        self.walk.arrive.append(self.world.opposite(there, gateway))
        self.walk.depart.append(None)
        self.log.append((turn, self.star, self.walk.arrive[-1]))

    def follow(self, graph, walk, limit=math.inf) -> bool:
        """Follow a suggestion up to its end, the first surprise (False), or so many travels."""
        for turn, edge in zip(walk.turns, walk.way, strict=False):
            if self.travels >= limit:
                return True
            self.travel(turn)
            if self.view() != look(graph.places[edge.goal].star, edge.arrive):
                return False
        if self.travels < limit:
            self.travel(walk.turns[-1])
        return True


def weigh_afterwards(experience, maps, log) -> list[float]:
    """Probability of maps, alike at first, after the travels of a log.

    Unlike the forecast, this remembers: what was unexplored in a map is a new place from then on.
    """
    brute = BruteForce(experience, maps, [1.0] * len(maps), 0)
    weights = []
    for i, graph in enumerate(brute.graphs):
        stars = {label: place.star for label, place in graph.places.items()}
        joined = {key: (edge.goal, edge.arrive) for key, edge in graph.edge_at.items()}
        (label, facing), weight = brute.start(i), 1.0
        for n, (turn, star, arrive) in enumerate(log):
            k = (facing + turn) % len(stars[label])
            view = look(star, arrive)
            if (label, k) not in joined:
                weight *= brute.seen[view] / brute.total or 1 / brute.total
                new = f"N{n}"
                stars[new] = star
                joined[label, k] = new, arrive
                back = star.opposite(arrive), stars[label].opposite(k)
                joined[new, back[0]] = label, back[1]
            label, facing = joined[label, k]
            if look(stars[label], facing) != view:
                weight = 0.0
                break
        weights.append(weight)
    return [weight / sum(weights) for weight in weights]


def list_all(robot: Robot, limit: int = 3000) -> RankedMaps | None:
    """All maps of what a robot lived through, the least first; None if there are too many."""
    found = enumerate_maps(robot.experience, limit=limit)
    if not found.complete:
        return None
    lived = robot.experience
    maps = sorted(found.maps, key=lambda h: (count_map(lived, h), h.visits, h.offsets))
    return RankedMaps(tuple(maps), "minimal", minimality="subset", consistent=len(maps))


def know(robot: Robot, limit: int = 3000) -> KnowledgeBase | None:
    """A knowledge base in which all maps are alike."""
    ranked = list_all(robot, limit)
    return None if ranked is None else KnowledgeBase(robot.experience, ranked)


def start_robot(seed: int, *, width=4, height=4, holes=0.1, travels=(7, 13)) -> Robot:
    """A robot after a random walk in a random world of a seed."""
    rng = np.random.default_rng(seed)
    world = make_grid(width, height, holes=holes, rng=rng)
    walk = walk_randomly(world, int(rng.integers(*travels)), rng)
    return Robot(world, walk, seed)


def with_misreadings(experience: Experience, rng: np.random.Generator) -> Experience:
    """Give some visits a second reading: the star of another visit."""
    visits = list(experience.visits)
    for v, visit in enumerate(visits):
        if rng.random() < 0.5:
            other = visits[int(rng.integers(len(visits)))].readings[0].star
            doors = [k for k in range(len(other)) if other.alpha[k]]
            reading = visit.readings[0]
            visits[v] = replace(
                visit,
                readings=(
                    replace(reading, weight=0.8),
                    replace(
                        reading,
                        star=other,
                        arrive=None if v == 0 else other.opposite(doors[0]),
                        depart=None if v == len(visits) - 1 else doors[-1],
                        weight=0.2,
                    ),
                ),
            )
    return replace(experience, visits=tuple(visits))
