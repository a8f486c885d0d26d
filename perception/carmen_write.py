"""Writing a scan log as a raw CARMEN log."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator

import numpy as np

from perception.atomic import write_atomically
from perception.errors import InputError
from perception.geometry import Array
from perception.scanlog import ScanLog

_HEADER = (
    "# CARMEN Logfile",
    "# file format is one message per line",
    "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
    "# message formats defined: PARAM ODOM FLASER ROBOTLASER1",
)


def write_carmen(
    path: str | os.PathLike[str],
    log: ScanLog,
    *,
    max_range_m: float | None = None,
    host: str = "hssh",
) -> None:
    """Write a scan log as a raw CARMEN log: PARAM, ODOM and FLASER lines, atomically.

    Scanners whose beams are not those of a 180 degree FLASER are written as ROBOTLASER1, which
    states its angles. True and corrected poses are not written: who reads the log must find
    its way without them.

    Parameters
    ----------
    path : the file to write, plain text.
    log : a log with odometry.
    max_range_m : written where there was no return; returns near or beyond it are written so
        too. Unless told, 50 m, or more where there are farther returns.
    host : name of the robot's computer, one word.

    Raises
    ------
    InputError : the log has no odometry or no scans, or the place cannot be written to.
    """
    if log.odometry is None or not len(log):
        raise InputError(f"{log.source}: a CARMEN log needs scans and raw odometry to be written")
    if not host or len(host.split()) != 1:
        raise InputError(f"host={host!r}: expected one word")
    if max_range_m is None:
        farthest = float(np.nanmax(log.ranges_m, initial=0.0))
        max_range_m = max(50.0, math.ceil(1.05 * farthest))
    text = "\n".join(_write_lines(log, log.odometry, max_range_m, host)) + "\n"
    write_atomically(path, text.encode())


def _write_lines(log: ScanLog, odometry: Array, max_range_m: float, host: str) -> Iterator[str]:
    """Give the lines of the log."""
    yield from _HEADER
    beams = len(log.angles_rad)
    step_rad = float(np.median(np.diff(log.angles_rad))) if beams > 1 else 0.0
    for name, value in (
        ("robot_frontlaser_offset", "0.0"),
        ("robot_front_laser_max", f"{max_range_m:g}"),
        ("laser_front_laser_resolution", f"{np.rad2deg(step_rad):.6g}"),
    ):
        yield f"PARAM {name} {value} {log.times_s[0]:.6f} {host} {log.times_s[0]:.6f}"
    gaps = beams - beams % 2
    usual = np.deg2rad(180.0 / max(gaps, 1) * (np.arange(beams) - gaps / 2))
    is_flaser = bool(np.allclose(log.angles_rad, usual, atol=1e-6))
    fov_rad = step_rad * (beams - 1)
    lead = (
        f"FLASER {beams} "
        if is_flaser
        else f"ROBOTLASER1 0 {log.angles_rad[0]:.9f} {fov_rad:.9f} {step_rad:.9f} "
        f"{max_range_m:g} 0.01 0 {beams} "
    )
    tail = "" if is_flaser else "0.000000 0.000000 0.0 0.0 0.0 "
    ranges = np.where(
        np.isfinite(log.ranges_m) & (log.ranges_m < max_range_m), log.ranges_m, max_range_m
    )
    for index, (time_s, row) in enumerate(zip(log.times_s, ranges, strict=True)):
        x, y, theta = odometry[index]
        tv, rv = _velocity(log.times_s, odometry, index)
        pose, stamp = f"{x:.6f} {y:.6f} {theta:.6f}", f"{time_s:.6f} {host} {time_s:.6f}"
        readings = " ".join([f"{value:.3f}" for value in row.tolist()])
        remissions = "" if is_flaser else "0 "
        yield f"ODOM {pose} {tv:.4f} {rv:.4f} 0.0 {stamp}"
        yield f"{lead}{readings} {remissions}{pose} {pose} {tail}{stamp}"


def _velocity(times_s: Array, odometry: Array, index: int) -> tuple[float, float]:
    """Return forward (m/s) and turning (rad/s) velocity up to a scan, 0 where time stands."""
    if index == 0 or times_s[index] <= times_s[index - 1]:
        return 0.0, 0.0
    dt = float(times_s[index] - times_s[index - 1])
    dx, dy, dtheta = odometry[index] - odometry[index - 1]
    heading = odometry[index - 1][2]
    turn = (float(dtheta) + np.pi) % (2 * np.pi) - np.pi
    return float(dx * np.cos(heading) + dy * np.sin(heading)) / dt, turn / dt
