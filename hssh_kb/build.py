"""Building a knowledge base: log -> perception -> Experience -> hypotheses -> layout -> map.

Source: the levels of the Hybrid Spatial Semantic Hierarchy, Beeson 2008, chapter 3.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from hssh_kb.errors import InputError, UsageError
from hssh_kb.experience import Experience
from hssh_kb.records import BuildRecord, PlaceLayout, Raster, Trajectory
from hssh_kb.trace import load_trace
from perception.files import looks_like_json
from perception.grid import Frame
from perception.rosmap_kind import looks_like_ros_map

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.ranking import RankedMaps
    from perception.level import Doors
    from perception.localise import Trajectory as LocalTrajectory
    from perception.places import PlaceSettings, PlaceVisit
    from perception.scanlog import ScanLog

Progress = Callable[[str, int, int], None]
"""Called with (stage, done, in all)."""

PosesMode = Literal["auto", "corrected", "odometry"]

CORRECTED_SIGMA = (0.05, 0.05, 0.004)
"""Error of corrected poses between neighbouring places: m, m, rad, one standard deviation."""


def build(
    input_path: str | Path,
    *,
    poses: PosesMode = "auto",
    doors: Doors | None = None,
    min_gateway_m: float = 0.0,
    best: int = 5,
    budget_s: float | None = None,
    resolution_m: float = 0.1,
    names: str | Path | None = None,
    start_m: tuple[float, float] | None = None,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> KnowledgeBase:
    """Build a knowledge base from a CARMEN log, a ROS bag, a ROS map or a trace.

    Parameters
    ----------
    input_path : a CARMEN log (plain, gz, xz or bz2), a ROS 1 or 2 bag, the yaml file of a ROS map,
        or a ``hssh.trace/1`` file; told apart by content.
    poses : "corrected" takes the corrected poses that some logs carry as they are; "odometry"
        takes raw odometry and matches scans; "auto" takes corrected poses where there are any.
    doors : "ignore" leaves doors and what else leads nowhere far out of the stars, "keep" keeps
        them. By default those of logs are ignored, those of floor maps kept.
    min_gateway_m : narrower gateways count only where the robot drove through them; on a floor map
        they are closed.
    best : how many maps are kept.
    budget_s : seconds for the search; when spent, the best maps found so far are kept. By default
        what suits the number of visits, see :mod:`hssh_kb.search_budget`.
    resolution_m : side of a cell of the global map.
    names, start_m, force : of a ROS map only; see
        :func:`hssh_kb.build_map.build_from_floor_map`.
    scan_topic, odom_topic : of a bag only; see :func:`perception.bags.read_bag`.
    progress : called with (stage, done, in all).

    Raises
    ------
    InputError : the input cannot be read, or breaks its format.
    UsageError : poses are asked for that the log does not have.

    Source
    ------
    Beeson 2008, chapters 4 to 9, in order.
    """
    path = Path(input_path)
    report = progress or _report_nothing
    clock = Clock()
    if looks_like_json(path):
        return _build_from_trace(path, best, budget_s, clock)
    if looks_like_ros_map(path):
        from hssh_kb.build_map import build_from_floor_map

        return build_from_floor_map(
            path,
            names=names,
            start_m=start_m,
            force=force,
            doors=doors or "keep",
            min_gateway_m=min_gateway_m,
            progress=report,
            clock=clock,
        )
    with clock.stage("read"):
        log = _read_log(path, scan_topic, odom_topic)
    return build_from_log(
        log,
        poses=poses,
        doors=doors or "ignore",
        min_gateway_m=min_gateway_m,
        best=best,
        budget_s=budget_s,
        resolution_m=resolution_m,
        progress=report,
        clock=clock,
    )


def build_from_log(
    log: ScanLog,
    *,
    poses: PosesMode = "auto",
    doors: Doors = "ignore",
    min_gateway_m: float = 0.0,
    best: int = 5,
    budget_s: float | None = None,
    resolution_m: float = 0.1,
    progress: Progress | None = None,
    clock: Clock | None = None,
) -> KnowledgeBase:
    """Build a knowledge base from a scan log in memory; see :func:`build`.

    Raises
    ------
    InputError : the drive passed no place at all.
    UsageError : poses are asked for that the log does not have.
    """
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.perceive import make_experience
    from perception.expectation import expect_readings
    from perception.localise import covariance_between
    from perception.mapping import draw_map
    from perception.places import detect_places
    from perception.recall import recall_readings
    from perception.tile_matching import list_matches, match_visits

    report, clock = progress or _report_nothing, clock or Clock()
    with clock.stage("localise"):
        local = _localise(log, poses, lambda done, total: report("localise", done, total))
    settings = settings_for(doors, min_gateway_m)
    with clock.stage("places"):
        visits = detect_places(
            log,
            local.poses,
            settings,
            lambda done, total: report("places", done, total),
        )
    if not visits:
        raise InputError(
            f"{log.source}: no place was found along the drive ({len(log)} scans); a drive has to "
            "pass a corridor crossing, a corner or a dead end"
        )
    with clock.stage("match"):
        tiles, matches = match_visits(visits, local.poses)
        visits = recall_readings(visits, local.poses, tiles, matches, settings)
        visits = expect_readings(visits, local.poses)
        lpm_matches = list_matches(matches, len(visits))
    experience = make_experience(
        visits,
        local.poses,
        lambda i, j: covariance_between(local, i, j),
        source=log.source,
        times_s=log.times_s,
        lpm_matches=lpm_matches,
    )
    with clock.stage("search"):
        report("search", 0, 1)
        ranked = _rank(experience, best, budget_s)
        report("search", 1, 1)
    with clock.stage("layout"):
        trajectory, layouts = _settle(experience, ranked, log, local, visits)
    with clock.stage("map"):
        grid = draw_map(log, trajectory, resolution_m=resolution_m)
    return KnowledgeBase(
        experience,
        ranked,
        layouts,
        lpms={v: _tile(visit) for v, visit in enumerate(visits)},
        trajectory=Trajectory(
            trajectory,
            log.times_s,
            np.array([visit.scan for visit in visits], np.int64),
            log.odometry,
            log.corrected,
        ),
        global_map=Raster(grid.image(), grid.frame),
        record=BuildRecord(
            source=log.source,
            version=own_version(),
            scans=len(log),
            seconds=clock.seconds,
            notices=log.notices + experience.notices,
            options={
                "poses": poses,
                "doors": doors,
                "min_gateway_m": min_gateway_m,
                "best": best,
                "resolution_m": resolution_m,
            },
        ),
    )


def _read_log(path: Path, scan_topic: str | None, odom_topic: str | None) -> ScanLog:
    from perception.bags import looks_like_bag, read_bag
    from perception.carmen import read_carmen

    if looks_like_bag(path):
        return read_bag(path, scan_topic=scan_topic, odom_topic=odom_topic)
    return read_carmen(path)


def settings_for(doors: Doors, min_gateway_m: float = 0.0) -> PlaceSettings:
    """Return how places are detected where doors count or do not; see :mod:`perception.level`.

    Raises
    ------
    UsageError : ``doors`` is something else, or the width is none.
    """
    from perception.places import PlaceSettings

    if not (np.isfinite(min_gateway_m) and min_gateway_m >= 0):
        raise UsageError(f"min_gateway_m is {min_gateway_m}; expected metres, zero or more")
    settings = replace(PlaceSettings(), min_gateway_m=min_gateway_m)
    if doors == "ignore":
        return settings
    if doors == "keep":
        return replace(
            settings, min_frontier_m=0.5, min_depth_m=0.5, robot_radius_m=0.3, door_share=0.0
        )
    raise UsageError(f"doors={doors!r}: use 'keep' or 'ignore'")


def _localise(
    log: ScanLog, poses: PosesMode, report: Callable[[int, int], None]
) -> LocalTrajectory:
    """Return the drive in its own frame: corrected poses, or odometry with scan matching."""
    from perception.localise import Trajectory as LocalTrajectory
    from perception.localise import localise

    if poses == "corrected" and log.corrected is None:
        raise UsageError(f"{log.source}: the log carries no corrected poses; use --poses odometry")
    if poses == "odometry" and log.odometry is None:
        raise UsageError(f"{log.source}: the log carries no odometry; use --poses corrected")
    if poses == "odometry" or log.corrected is None:
        return localise(log, progress=report)
    count = len(log)
    lengths = np.hypot(*np.diff(log.corrected[:, :2], axis=0, prepend=log.corrected[:1, :2]).T)
    # A corrected pose is off by much the same everywhere: spread that over a typical travel.
    share = (lengths + 0.05) / 10.0
    steps = np.diag(np.square(CORRECTED_SIGMA))[None] * share[:, None, None]
    report(count, count)
    return LocalTrajectory(log.corrected, steps, np.ones(count, bool), np.ones(count))


def _rank(experience: Experience, best: int, budget_s: float | None) -> RankedMaps:
    from hssh_kb.ranking import rank_maps
    from hssh_kb.search_budget import allow_seconds

    return rank_maps(experience, best=best, budget_s=budget_s or allow_seconds(len(experience)))


def _settle(
    experience: Experience,
    ranked: RankedMaps,
    log: ScanLog,
    local: LocalTrajectory,
    visits: tuple[PlaceVisit, ...],
) -> tuple[np.ndarray, tuple[PlaceLayout | None, ...]]:
    """Lay out every map kept; the trajectory is that of the first."""
    from hssh_kb.metrical import settle_drive

    settled = [
        settle_drive(experience, hypothesis, log, local.poses, visits) for hypothesis in ranked.maps
    ]
    if not settled:
        return local.poses, ()
    return settled[0][0], tuple(places for _, places in settled)


def _tile(visit: PlaceVisit) -> Raster:
    """Return the stored LPM of a visit in the frame of the visit."""
    frame = visit.tile_frame
    x, y = visit.centre_m
    return Raster(
        visit.tile, Frame(frame.left_m - float(x), frame.top_m - float(y), frame.resolution_m)
    )


def _build_from_trace(path: Path, best: int, budget_s: float | None, clock: Clock) -> KnowledgeBase:
    from hssh_kb.kb import KnowledgeBase
    from hssh_kb.layout import lay_out_hypothesis

    with clock.stage("read"):
        experience = load_trace(path)
    with clock.stage("search"):
        ranked = _rank(experience, best, budget_s)
    layouts = list[PlaceLayout | None]()
    with clock.stage("layout"):
        if experience.has_displacements:
            for hypothesis in ranked.maps:
                laid = lay_out_hypothesis(experience, hypothesis)
                layouts.append(PlaceLayout(laid.poses, laid.covariances, laid.chi2))
    record = BuildRecord(
        source=str(path),
        version=own_version(),
        seconds=clock.seconds,
        notices=experience.notices,
        options={"best": best},
    )
    return KnowledgeBase(experience, ranked, tuple(layouts), record=record)


class Clock:
    """Seconds by stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time spent inside to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            spent = time.perf_counter() - start
            self.seconds[name] = round(self.seconds.get(name, 0.0) + spent, 3)


def _report_nothing(stage: str, done: int, total: int) -> None:
    """Take the place of a progress bar."""


def own_version() -> str:
    """Return the version of the installed package; "unknown" outside an installation."""
    try:
        return version("hssh")
    except PackageNotFoundError:
        return "unknown"
