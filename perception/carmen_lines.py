"""The lines of a CARMEN log, one by one: what each says, and which cannot be used."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

_IGNORED = frozenset(
    b"NEFF SYNC TRUEPOS RLASER LASER3 LASER4 RAWLASER1 RAWLASER2 RAWLASER3 RAWLASER4 RAWLASER5 "
    b"ROBOTLASER2 ROBOTLASER3 ROBOTLASER4 ROBOTLASER5 NMEAGGA NMEARMC GPS IMU SONAR BUMPER MARKER "
    b"VECTORMOVE ROBOTVELOCITY FOLLOWTRAJECTORY BASEVELOCITY SCANMARK POSITIONLASER ARM PANTILT "
    b"COMPASS SM_UPDATE".split()
)
"""Messages of CARMEN and of programs that rewrite its logs, known and not used here."""

_LONGEST_POSE_M = 1e7
_FLASER_TAILS = (8, 9, 10, 11)
_LASER_KINDS = ("FLASER", "ROBOTLASER1")

Pose = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Scan:
    """One laser message.

    Attributes
    ----------
    line : number of the line, from 1.
    kind : ``"FLASER"`` or ``"ROBOTLASER1"``.
    readings : ranges, metres, as written.
    laser, robot : the two poses of the message; m, m, rad.
    time_s : time stamp, NaN where the line has none.
    beams : (number of readings, first angle or NaN, step or NaN), radians.
    max_m : maximum range that the line states, NaN if none.
    tail : number of fields besides the readings.
    """

    line: int
    kind: str
    readings: list[float]
    laser: Pose
    robot: Pose
    time_s: float
    beams: tuple[int, float, float]
    max_m: float
    tail: int


@dataclass(frozen=True, slots=True)
class Odometry:
    """One ODOM message, or the place of a laser message that could not be read (no pose)."""

    line: int
    pose: Pose | None
    time_s: float = math.nan


@dataclass
class Lines:
    """All that was read from a log.

    Attributes
    ----------
    events : scans and odometry in the order of the log.
    parameters : PARAM values as text, the last one standing.
    faults : line number and reason of each line that was skipped.
    is_rewritten : the log has lines that only a mapper writes (NEFF).
    vertices : of a pose graph with scans (g2o): the number of the vertex of each laser message, by
        line. steps : the measured motion between two vertices, first to second.
    """

    events: list[Scan | Odometry] = field(default_factory=list)
    parameters: dict[str, str] = field(default_factory=dict)
    faults: list[tuple[int, str]] = field(default_factory=list)
    is_rewritten: bool = False
    vertices: dict[int, int] = field(default_factory=dict)
    steps: dict[tuple[int, int], Pose] = field(default_factory=dict)

    def scans(self) -> list[Scan]:
        """Return the laser messages only."""
        return [event for event in self.events if isinstance(event, Scan)]

    def drop_scans(self, unwanted: dict[int, str]) -> None:
        """Turn scans, given by line number with the reason, into skipped lines."""
        self.faults.extend(unwanted.items())
        self.faults.sort()
        self.events = [
            Odometry(event.line, None)
            if isinstance(event, Scan) and event.line in unwanted
            else event
            for event in self.events
        ]


class _LineError(ValueError):
    """Why one line cannot be used."""


def parse_lines(data: bytes) -> Lines:
    """Parse the text of a log; lines that cannot be read are noted in ``faults`` and skipped."""
    lines = Lines()
    vertex: int | None = None
    for number, raw in enumerate(data.splitlines(), start=1):
        tokens = raw.split()
        if not tokens or tokens[0].startswith(b"#"):
            continue
        kind = tokens[0]
        try:
            if kind == b"ODOM":
                lines.events.append(_parse_odometry(number, tokens))
            elif kind == b"FLASER":
                lines.events.append(_parse_flaser(number, tokens))
            elif kind == b"ROBOTLASER1":
                lines.events.append(_parse_robotlaser(number, tokens))
                if vertex is not None:
                    lines.vertices[number] = vertex
            elif kind == b"PARAM":
                _parse_parameter(tokens, lines.parameters)
            elif kind == b"VERTEX_SE2":
                vertex = _parse_vertex(tokens)
            elif kind == b"EDGE_SE2":
                _parse_edge(tokens, lines.steps)
            elif kind == b"NEFF":
                lines.is_rewritten = True
            elif kind not in _IGNORED:
                lines.faults.append((number, f"unknown message {_show(kind)}"))
        except _LineError as fault:
            lines.faults.append((number, str(fault)))
            if b"LASER" in kind:
                lines.events.append(Odometry(number, None))
    _settle_forms(lines)
    return lines


def _show(token: bytes) -> str:
    """Return a token for a message: short, printable."""
    text = token[:16].decode("ascii", "replace")
    return repr("".join(c if c.isprintable() else "?" for c in text))


def _read_numbers(tokens: list[bytes], what: str) -> list[float]:
    """Read plain decimal numbers; NaN and infinity are allowed."""
    try:
        numbers = list(map(float, tokens))
    except ValueError:
        bad = next(token for token in tokens if not _is_number(token))
        raise _LineError(f"{what} {_show(bad)} is not a number") from None
    if any(b"_" in token for token in tokens):  # Python would read 1_0 as ten
        raise _LineError(f"{what} with '_' is not a number")
    return numbers


def _is_number(token: bytes) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True


def _read_count(token: bytes, what: str) -> int:
    if not token.isdigit() or len(token) > 6:
        raise _LineError(f"{what} {_show(token)} is not a count")
    return int(token)


def _read_poses(tokens: list[bytes]) -> list[Pose]:
    """Read poses of three finite numbers each."""
    numbers = _read_numbers(tokens, "pose")
    if not all(abs(number) < _LONGEST_POSE_M for number in numbers):  # False for NaN as well
        raise _LineError("a pose is not finite")
    return [(numbers[k], numbers[k + 1], numbers[k + 2]) for k in range(0, len(numbers) - 2, 3)]


def _read_time(tokens: list[bytes]) -> float:
    """Read the first time stamp after the poses; NaN where there is none."""
    if not tokens:
        return math.nan
    time_s = _read_numbers(tokens[:1], "time")[0]
    if not math.isfinite(time_s):
        raise _LineError("the time is not finite")
    return time_s


def _parse_odometry(number: int, tokens: list[bytes]) -> Odometry:
    """``ODOM x y theta [tv rv accel [time host time]]``."""
    if len(tokens) not in (4, 7, 8, 9, 10):
        raise _LineError(f"ODOM with {len(tokens)} fields instead of 10")
    (pose,) = _read_poses(tokens[1:4])
    return Odometry(number, pose, _read_time(tokens[7:8]))


def _parse_flaser(number: int, tokens: list[bytes]) -> Scan:
    """``FLASER n r_1 .. r_n  x y theta  x y theta  [time [host [time]]]``."""
    count = _read_count(tokens[1], "number of readings") if len(tokens) > 1 else 0
    tail = len(tokens) - count
    if count < 3 or tail not in _FLASER_TAILS:
        raise _LineError(f"FLASER announces {count} readings but has {len(tokens)} fields")
    readings = _read_numbers(tokens[2 : 2 + count], "range")
    laser, robot = _read_poses(tokens[2 + count : 8 + count])
    return Scan(
        line=number,
        kind="FLASER",
        readings=readings,
        laser=laser,
        robot=robot,
        time_s=_read_time(tokens[8 + count : 9 + count]),
        beams=(count, math.nan, math.nan),
        max_m=math.nan,
        tail=tail,
    )


def _parse_robotlaser(number: int, tokens: list[bytes]) -> Scan:
    """Parse a ROBOTLASER1 line.

    ``ROBOTLASER1 type start fov step max accuracy mode  n r_1 .. r_n  [m i_1 .. i_m]  laser pose
    robot pose  tv rv distance distance axis  time host time``; ``m`` counts the remissions.
    """
    if len(tokens) < 9:
        raise _LineError(f"ROBOTLASER1 with {len(tokens)} fields")
    count = _read_count(tokens[8], "number of readings")
    rest = tokens[9 + count :]
    if count < 3 or len(rest) < 14:
        raise _LineError(f"ROBOTLASER1 announces {count} readings but has {len(tokens)} fields")
    if len(rest) > 14:
        remissions = _read_count(rest[0], "number of remissions")
        if len(rest) != 15 + remissions:
            raise _LineError(f"ROBOTLASER1 announces {count} readings but has {len(tokens)} fields")
        rest = rest[1 + remissions :]
    start, fov, step, max_m = _read_numbers(tokens[2:6], "laser setting")
    if step == 0 and math.isfinite(fov):
        step = fov / (count - 1)
    if not (abs(start) <= 2 * math.pi + 0.01 and step > 0 and step * (count - 1) <= 6.3):
        raise _LineError("ROBOTLASER1 with impossible beam angles")
    laser, robot = _read_poses(rest[:6])
    return Scan(
        line=number,
        kind="ROBOTLASER1",
        readings=_read_numbers(tokens[9 : 9 + count], "range"),
        laser=laser,
        robot=robot,
        time_s=_read_time(rest[11:12]),
        beams=(count, start, step),
        max_m=max_m,
        tail=0,
    )


def _parse_vertex(tokens: list[bytes]) -> int:
    """``VERTEX_SE2 id x y theta``; the pose stands in the laser line that follows, too."""
    if len(tokens) != 5:
        raise _LineError(f"VERTEX_SE2 with {len(tokens)} fields instead of 5")
    return _read_count(tokens[1], "vertex")


def _parse_edge(tokens: list[bytes], steps: dict[tuple[int, int], Pose]) -> None:
    """``EDGE_SE2 i j dx dy dtheta`` and six entries of the information matrix."""
    if len(tokens) != 12:
        raise _LineError(f"EDGE_SE2 with {len(tokens)} fields instead of 12")
    ends = _read_count(tokens[1], "vertex"), _read_count(tokens[2], "vertex")
    (motion,) = _read_poses(tokens[3:6])
    steps.setdefault(ends, motion)


def _parse_parameter(tokens: list[bytes], parameters: dict[str, str]) -> None:
    """``PARAM name value ...``; a parameter without a value is no fault."""
    if len(tokens) >= 3:
        name, value = (token.decode("utf-8", "replace") for token in tokens[1:3])
        parameters[name] = value


def _settle_forms(lines: Lines) -> None:
    """Keep the scans of one kind and one shape, those of the majority; skip the others."""
    scans = lines.scans()
    if not scans:
        return
    by_kind = Counter(scan.kind for scan in scans)
    kind = max(_LASER_KINDS, key=lambda name: by_kind[name])
    if len(by_kind) > 1:  # one laser logged in two ways, or two lasers: not a fault
        lines.events = [
            event for event in lines.events if isinstance(event, Odometry) or event.kind == kind
        ]
        scans = lines.scans()
    beams = Counter(scan.beams if kind != "FLASER" else scan.beams[:1] for scan in scans)
    common = beams.most_common(1)[0][0]
    odd = {
        scan.line: f"{kind} with {scan.beams[0]} readings where the log has {common[0]}"
        if scan.beams[0] != common[0]
        else f"{kind} with other beam angles than the rest of the log"
        for scan in scans
        if scan.beams[: len(common)] != common
    }
    tails = Counter(scan.tail for scan in scans if scan.line not in odd)
    tail = tails.most_common(1)[0][0]
    for scan in scans:
        if scan.line not in odd and scan.tail != tail:
            odd[scan.line] = (
                f"FLASER announces {scan.beams[0]} readings but has "
                f"{scan.beams[0] + scan.tail} fields"
            )
    lines.drop_scans(odd)
