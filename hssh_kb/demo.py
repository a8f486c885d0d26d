"""The demonstration: a simulated drive, its knowledge base, and the three questions put to it.

The knowledge base is built from the written log alone. The world's own graph is looked at only
afterwards, to say whether the top map is the true one.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hssh_kb.answers import document_build, document_check, document_maps, document_route
from hssh_kb.errors import InputError
from hssh_kb.kb import KnowledgeBase

if TYPE_CHECKING:
    from hssh_kb.check import Check
    from hssh_kb.route import Route
    from perception.scanlog import ScanLog
    from perception.world import World

Progress = Callable[[str, int, int], None]
_NEAR_M = 3.0
_CROSSING = 3
_QUESTION_S, _QUESTIONS_S = 10.0, 15.0


@dataclass(frozen=True)
class Truth:
    """The top map held against the world's own graph.

    Attributes
    ----------
    visits : true place of each visit of the map; None where there is no true place near.
    passed : true places that the drive passed, in order.
    faults : one sentence for each difference.
    """

    visits: tuple[str | None, ...]
    passed: tuple[str, ...]
    faults: tuple[str, ...]


@dataclass(frozen=True)
class Demo:
    """What the demonstration did and found."""

    folder: Path
    kb: KnowledgeBase
    truth: Truth
    route: Route | None
    assumption: str | None
    why_not: Check | None
    files: tuple[str, ...]

    @property
    def matches_truth(self) -> bool:
        """True if the top map is the true one."""
        return not self.truth.faults

    def document(self) -> dict[str, Any]:
        """Return the ``hssh.demo/1`` document."""
        return {
            "schema": "hssh.demo/1",
            "folder": str(self.folder),
            "files": list(self.files),
            "build": document_build(self.kb, str(self.folder / "demo.hssh")),
            "maps": document_maps(self.kb.experience, self.kb.ranked),
            "route": document_route(self.route) if self.route else None,
            "assumption": self.assumption,
            "check": document_check(self.why_not) if self.why_not else None,
            "truth": {
                "matches": self.matches_truth,
                "visits": list(self.truth.visits),
                "passed": list(self.truth.passed),
                "faults": list(self.truth.faults),
            },
        }


def run_demo(folder: Path, *, seed: int = 0, progress: Progress | None = None) -> Demo:
    """Simulate a drive through the bundled world, build its knowledge base, and question it.

    Parameters
    ----------
    folder : where ``drive.log``, ``demo.hssh``, ``map.svg`` and ``map.png`` are written.
    seed : of the noise and the drift.
    progress : called with (stage, done, in all).

    Raises
    ------
    InputError : the folder cannot be made or written to.
    """
    from perception.carmen_write import write_carmen
    from perception.driver import drive
    from perception.world import load_world

    report = progress or _report_nothing
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from None
    world = load_world()
    log = drive(world, seed=seed, progress=lambda done, total: report("drive", done, total))
    path = folder / "drive.log"
    write_carmen(path, log)
    kb = KnowledgeBase.build(path, progress=report)
    kb.save(folder / "demo.hssh")
    truth = compare_with_truth(kb, world, log)
    route = _choose_route(kb)
    report("pictures", 0, 2)
    ends = (route.start.label, route.goal.label) if route else None
    kb.show(folder / "map.svg", route=ends)
    report("pictures", 1, 2)
    kb.show(folder / "map.png", route=ends)
    report("pictures", 2, 2)
    assumption, why_not = _ask_why_not(kb)
    files = ("drive.log", "demo.hssh", "map.svg", "map.png")
    return Demo(folder, kb, truth, route, assumption, why_not, files)


def compare_with_truth(kb: KnowledgeBase, world: World, log: ScanLog) -> Truth:
    """Hold the top map against the true places that the drive passed.

    Parameters
    ----------
    kb : built from the log. world : where it was driven. log : with true poses.
    """
    from perception.driver import truth_visits

    passed = tuple(truth_visits(world, log))
    names = list(world.truth)
    centres = np.array([world.position(name) for name in names])
    visits = list[str | None]()
    scans = kb.trajectory.visit_scans if kb.trajectory is not None else ()
    for scan in scans:
        away = np.hypot(*(centres - log.truth[int(scan), :2]).T) if log.truth is not None else None
        near = away is not None and away.min() <= _NEAR_M
        visits.append(names[int(away.argmin())] if away is not None and near else None)
    faults = [
        f"v{v} (P{kb.hypothesis().visits[v]}) is at no place of the world's graph: "
        f"{_name_spot(world, log, scans[v])}"
        for v, name in enumerate(visits)
        if name is None
    ]
    return Truth(tuple(visits), passed, (*faults, *_find_faults(kb, visits, passed)))


def _name_spot(world: World, log: ScanLog, scan: int) -> str:
    if log.truth is None:
        return "the log has no true poses"
    x, y = (float(value) for value in log.truth[int(scan), :2])
    return f"({x:.1f}, {y:.1f}) m, {world.name_at(x, y) or 'nowhere'}"


def _find_faults(kb: KnowledgeBase, visits: list[str | None], passed: tuple[str, ...]) -> list[str]:
    faults = list[str]()
    told = [place for place in visits if place is not None]
    if tuple(told) != passed:
        missed = len(passed) - _count_in_order(passed, told)
        extra = len(told) - _count_in_order(passed, told)
        faults.append(
            f"of {len(passed)} passes of true places {missed} made no visit, "
            f"and {extra} of {len(told)} visits at true places are no pass of theirs"
        )
    places = kb.hypothesis().visits
    owner: dict[int, str] = {}
    home: dict[str, int] = {}
    for v, (place, name) in enumerate(zip(places, visits, strict=False)):
        if name is None:
            continue
        if owner.setdefault(place, name) != name:
            faults.append(f"v{v}: P{place} is {owner[place]}, but this visit was at {name}")
        if home.setdefault(name, place) != place:
            faults.append(f"v{v}: {name} is P{home[name]} and again P{place}")
    return faults


def _count_in_order(one: tuple[str, ...], other: list[str]) -> int:
    """Length of the longest common subsequence."""
    row = [0] * (len(other) + 1)
    for a in one:
        before = row[:]
        for j, b in enumerate(other, 1):
            row[j] = before[j - 1] + 1 if a == b else max(before[j], row[j - 1])
    return row[-1]


def _choose_route(kb: KnowledgeBase) -> Route | None:
    """Return the route from the first place with the most turns: the most to tell."""
    labels = list(kb.graph().places)
    routes = [kb.route(labels[0], label) for label in labels[1:]]
    return max(routes, key=lambda route: (len(route.steps), route.length_m or 0.0), default=None)


def _ask_why_not(kb: KnowledgeBase) -> tuple[str | None, Check | None]:
    """Suppose that two look-alike crossings were one place, and ask why not.

    The first pair that an axiom refutes within the time given is told.
    """
    hypothesis, visits = kb.hypothesis(), kb.experience.visits
    pairs = [
        (v, w)
        for v in range(len(hypothesis.visits))
        for w in range(v - 1)
        if hypothesis.visits[v] != hypothesis.visits[w]
        and visits[v].star.isomorphisms(visits[w].star)
    ]
    pairs.sort(key=lambda pair: sum(visits[pair[0]].star.alpha) < _CROSSING)
    end = time.monotonic() + _QUESTIONS_S
    answer: tuple[str | None, Check | None] = (None, None)
    for v, w in pairs:
        assumption = f"v{v}=v{w}"
        check = kb.check([assumption], budget_s=_QUESTION_S)
        if answer[1] is None or any(violation.axioms for violation in check.violations):
            answer = assumption, check
        if answer[0] == assumption and check.status == "violated":
            break
        if time.monotonic() > end:
            break
    return answer


def describe_demo(demo: Demo) -> str:
    """Return what the demonstration found, as text."""
    kb, rows = demo.kb, demo.kb.rows
    length = kb.trajectory.length_m if kb.trajectory is not None else 0.0
    lines = [
        f"The drive: {kb.record.scans} scans over {length:.0f} m, {len(kb.experience)} visits.",
        "",
        f"1. Which maps? {len(rows)} kept, the best first"
        f" ({'metrical evidence' if kb.ranked_by == 'posterior' else 'minimality'} decided):",
    ]
    for row in rows:
        posterior = row.hypothesis.log_posterior
        score = "" if posterior is None else f", log posterior {posterior:.1f}"
        lines.append(f"   map {row.number}: {row.places} places, {row.paths} paths{score}")
    if demo.route is not None:
        start, goal = demo.route.start.title, demo.route.goal.title
        lines += ["", f"2. How do I get from {start} to {goal}?", f"   {demo.route.text}"]
        lines.append(f"   (holds in {demo.route.holds_in} of {demo.route.maps} maps)")
    if demo.why_not is not None and demo.assumption is not None:
        first, second = demo.assumption.split("=")
        lines += ["", f"3. Why are {first} and {second} not one place, though they look alike?"]
        told = demo.why_not.violations[0].text if demo.why_not.violations else ""
        lines.append(f"   {_only_unlikely(demo) if demo.why_not.consistent else told}")
    lines += ["", *_describe_truth(demo), ""]
    lines.append(f"Written to {demo.folder}: {', '.join(demo.files)}")
    return "\n".join(lines)


def _only_unlikely(demo: Demo) -> str:
    return (
        f"No axiom forbids {demo.assumption}; it is less probable than the best map, because the "
        "distances driven do not fit."
    )


def _describe_truth(demo: Demo) -> list[str]:
    if demo.matches_truth:
        distinct = len(set(demo.truth.passed))
        return [
            f"The top map is the true one: its {len(demo.truth.visits)} visits and {distinct} "
            "places are those of the world's own graph."
        ]
    return ["The top map is not the true one:", *(f"   {fault}" for fault in demo.truth.faults)]


def _report_nothing(stage: str, done: int, total: int) -> None:
    """Take the place of a progress bar."""
