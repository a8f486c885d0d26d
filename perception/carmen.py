"""CARMEN logs: reading them into a :class:`ScanLog`, and writing one.

CARMEN is the Carnegie Mellon robot navigation toolkit; its text logs are what most public lidar
data of buildings come in. Line formats: :mod:`perception.carmen_lines`.
"""

from __future__ import annotations

import itertools
import math
import os
from typing import Literal

import numpy as np

from perception.carmen_lines import Lines, Odometry, Scan, parse_lines
from perception.carmen_write import write_carmen
from perception.errors import InputError
from perception.files import read_bytes
from perception.geometry import Array, between, chain_motions, compose, wrap_angle
from perception.returns import mask_no_returns
from perception.scanlog import ScanLog

__all__ = ["PoseKind", "read_carmen", "write_carmen"]

PoseKind = Literal["auto", "corrected", "odometry"]

_MOUNT_SPREAD = 0.02
"""Largest deviation (m, rad) of the laser from a fixed place on the robot."""


def read_carmen(path: str | os.PathLike[str], *, poses: PoseKind = "auto") -> ScanLog:
    """Read a CARMEN log (FLASER or ROBOTLASER1, ODOM, PARAM), plain, gzip, xz or bzip2.

    Parameters
    ----------
    path : the file; compression is told by content, not by name.
    poses : what the poses in the laser lines are. ``"auto"`` finds out: logs rewritten by a
        mapper hold corrected poses there, and their ODOM lines are re-based at every scan, so
        raw odometry is chained from the motions between lines, leaving out each jump into a
        scan. Laser lines inside a pose graph (g2o) hold optimised poses, its edges from one
        vertex to the next the raw ones. ``"corrected"`` and ``"odometry"`` settle it.

    Returns
    -------
    The scans in the order of the log; ranges NaN where nothing was hit (the maximum range is
    found from the data, see :func:`perception.returns.mask_no_returns`). Lines that cannot be
    read are skipped; one notice counts them and gives their numbers.

    Raises
    ------
    InputError : not a readable file, packed data cut off, no text, or no usable scan.

    Source
    ------
    Line formats: CARMEN's logger documentation. Telling the kinds of poses apart: ours.
    """
    if poses not in ("auto", "corrected", "odometry"):
        raise InputError(f"poses={poses!r}: expected 'auto', 'corrected' or 'odometry'")
    data = read_bytes(path)
    source = os.fspath(path)
    _check_is_text(data, source)
    lines = parse_lines(data)
    scans = lines.scans()
    _check_has_scans(lines, scans, data, source)
    notices = _describe_faults(lines, source)
    times = np.array([scan.time_s for scan in scans])
    if not np.isfinite(times).all():
        times = np.arange(len(scans), dtype=float)
        notices.append(f"{source}: the scans have no time stamps; they are numbered instead")
    odometry, corrected = _interpret_poses(lines, scans, poses)
    if odometry is None:
        notices.append(f"{source}: no odometry between the scans, only corrected poses")
    ranges = mask_no_returns([scan.readings for scan in scans], _find_announced_max(lines, scans))
    if not np.isfinite(ranges).any():
        raise InputError(
            f"{source}: none of the {len(scans)} scans has a return (line {scans[0].line} on); "
            "check that the ranges are in metres"
        )
    return ScanLog(
        source=source,
        times_s=times,
        ranges_m=ranges,
        angles_rad=_find_angles(lines, scans[0]),
        odometry=odometry,
        corrected=corrected,
        notices=tuple(notices),
    )


def _check_is_text(data: bytes, source: str) -> None:
    """Refuse binary files early, with the place of the first byte that is no text."""
    head = np.frombuffer(data[:65536], np.uint8)
    control = (head < 9) | ((head > 13) & (head < 32)) | (head > 126)
    if np.count_nonzero(control) > 0.1 * len(head):
        raise InputError(
            f"{source}: not a text file (byte {int(np.argmax(control))} on), expected a CARMEN "
            "log with FLASER or ROBOTLASER1 lines"
        )


def _check_has_scans(lines: Lines, scans: list[Scan], data: bytes, source: str) -> None:
    if scans:
        return
    total = data.count(b"\n") + (not data.endswith(b"\n"))
    why = ""
    if lines.faults:
        number, reason = lines.faults[0]
        why = f"; the first fault is in line {number}: {reason}"
    raise InputError(
        f"{source}: no usable scan in {total} lines, expected FLASER or ROBOTLASER1 lines{why}"
    )


def _describe_faults(lines: Lines, source: str) -> list[str]:
    """Return one notice on all skipped lines, or none."""
    if not lines.faults:
        return []
    shown = "; ".join(f"line {number}: {reason}" for number, reason in lines.faults[:5])
    count = len(lines.faults)
    if count > 5:
        numbers = ", ".join(str(number) for number, _ in lines.faults[5:25])
        shown += f"; lines {numbers}" + (f" and {count - 25} more" if count > 25 else "")
    return [
        f"{source}: skipped {count} line{'s' * (count > 1)} that cannot be read, "
        f"used the rest ({shown})"
    ]


def _find_announced_max(lines: Lines, scans: list[Scan]) -> float | None:
    """Return the maximum range, metres, that the log states, if any."""
    stated = [scan.max_m for scan in scans if math.isfinite(scan.max_m) and scan.max_m > 0]
    if stated:
        return float(np.median(stated))
    return _read_parameter(lines, "robot_front_laser_max")


def _read_parameter(lines: Lines, name: str) -> float | None:
    """Return a PARAM as a finite number, or None."""
    try:
        value = float(lines.parameters[name])
    except (KeyError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _find_angles(lines: Lines, scan: Scan) -> Array:
    """Return the beam angles (b,), radians: as stated, else a 180 degree scanner's."""
    count, start, step = scan.beams
    if math.isfinite(start):
        return np.asarray(start + step * np.arange(count), float)
    gaps = count - count % 2  # 180 and 181 readings are 1 degree apart, 360 and 361 half of it
    step_deg = 180.0 / gaps
    if gaps not in (180, 360):
        stated = _read_parameter(lines, "laser_front_laser_resolution")
        if stated is not None and stated > 0 and stated * gaps <= 360:
            step_deg = stated
    return np.asarray(np.deg2rad(step_deg * (np.arange(count) - gaps / 2)))


def _interpret_poses(
    lines: Lines, scans: list[Scan], poses: PoseKind
) -> tuple[Array | None, Array | None]:
    """Return odometry and corrected poses (n, 3) of the laser; either may be None."""
    laser = _wrap(np.array([scan.laser for scan in scans]))
    in_graph = bool(lines.steps) and all(scan.line in lines.vertices for scan in scans)
    if in_graph and poses != "odometry":
        return _chain_steps(lines, scans, laser), laser
    robot = _wrap(np.array([scan.robot for scan in scans]))
    mount = between(robot, laser)
    spread = _wrap(mount - mount[:1])
    spread = np.abs(_wrap(spread - np.median(spread, axis=0)))
    is_pair = bool(np.median(spread.max(axis=1)) > _MOUNT_SPREAD)
    if is_pair and poses != "odometry" and np.ptp(robot, axis=0).max() > 0:
        return robot, laser
    if poses == "odometry" or (poses == "auto" and not _is_rebased(lines)):
        return _odometry_of_scans(lines, laser), None
    chained = _chain_odometry(lines)
    return (None if _lacks_motion(chained, laser) else chained), laser


def _chain_steps(lines: Lines, scans: list[Scan], laser: Array) -> Array:
    """Chain the measured motions between the vertices of consecutive scans: (n, 3) poses.

    Where a motion was not measured, that between the optimised poses stands for it.
    """
    at = [lines.vertices[scan.line] for scan in scans]
    motions = between(laser[:-1], laser[1:])
    for k, ends in enumerate(itertools.pairwise(at)):
        if ends in lines.steps:
            motions[k] = lines.steps[ends]
    return np.asarray(chain_motions(motions), float)


def _wrap(poses: Array) -> Array:
    """Return poses with their angles in [-pi, pi)."""
    return np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])])


def _lacks_motion(odometry: Array, corrected: Array) -> bool:
    """Tell whether odometry stood still in most of the steps in which the robot moved."""
    moved_m, driven_m = (
        np.hypot(*np.diff(poses[:, :2], axis=0).T) for poses in (corrected, odometry)
    )
    is_moving = moved_m > 0.05
    stood = driven_m[is_moving] < 0.1 * moved_m[is_moving]
    return 2 * int(np.count_nonzero(stood)) > len(stood)


def _is_rebased(lines: Lines) -> bool:
    """Tell whether a mapper replaced the poses and re-based the odometry at each scan.

    Such a log has NEFF lines, or after (nearly) every scan an ODOM line that repeats its pose
    with the time 0, or repeats it although the motions into scans are unlike the others.
    """
    if lines.is_rewritten:
        return True
    followed = repeated = stamped = 0
    into: list[float] = []
    others: list[float] = []
    for before, after in zip(lines.events, lines.events[1:], strict=False):
        if isinstance(after, Scan):
            if isinstance(before, Odometry) and before.pose is not None:
                into.append(math.dist(before.pose[:2], after.laser[:2]))
        elif after.pose is not None and isinstance(before, Scan):
            followed += 1
            repeated += after.pose in (before.laser, before.robot)
            stamped += after.pose == before.laser and after.time_s == 0 != before.time_s
        elif after.pose is not None and isinstance(before, Odometry) and before.pose is not None:
            others.append(math.dist(before.pose[:2], after.pose[:2]))
    if followed < 3 or repeated < 0.9 * followed:
        return False
    if stamped >= 0.9 * followed:
        return True
    usual = float(np.median(others)) if others else 0.0
    return bool(others) and usual > 0 and float(np.median(into)) > 3 * usual


def _odometry_of_scans(lines: Lines, laser: Array) -> Array:
    """Return raw odometry (n, 3): as in the scans, or from ODOM where the scans have none."""
    if np.ptp(laser, axis=0).max() > 0:
        return laser
    last: tuple[float, float, float] | None = None
    found: list[tuple[float, float, float]] = []
    for event in lines.events:
        if isinstance(event, Scan):
            found.append(last or (0.0, 0.0, 0.0))
        elif event.pose is not None:
            last = event.pose
    offset = _read_parameter(lines, "robot_frontlaser_offset") or 0.0
    return compose(_wrap(np.array(found)), [offset, 0.0, 0.0])


def _chain_odometry(lines: Lines) -> Array:
    """Chain the motions between consecutive lines, but not those into a scan: (n, 3) poses.

    A laser line that could not be read leaves the odometry re-based all the same, so the motion
    into the ODOM line after it is left out.

    Source
    ------
    Ours; checked against an independent raw log of the same drive.
    """
    poses: list[tuple[float, float, float]] = []
    is_jump: list[bool] = []
    at_scan: list[int] = []
    lost = False
    for event in lines.events:
        if isinstance(event, Scan):
            at_scan.append(len(poses))
            poses.append(event.laser)
            is_jump.append(True)
            lost = False
        elif event.pose is None:
            lost = True
        else:
            poses.append(event.pose)
            is_jump.append(lost)
            lost = False
    track = _wrap(np.array(poses))
    motion = between(track[:-1], track[1:])
    motion[np.array(is_jump[1:], bool)] = 0.0
    return np.asarray(chain_motions(motion)[np.array(at_scan)])
