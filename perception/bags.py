"""ROS bags (ROS 1, ROS 2, mcap): reading a lidar drive into a :class:`ScanLog`.

Needs the optional ``rosbags`` library; no ROS installation.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from perception.bag_frames import FrameTree, flatten_transforms, interpolate_transforms
from perception.errors import InputError
from perception.geometry import Array
from perception.scanlog import ScanLog

SCAN_TYPE, ODOM_TYPE = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TF_TYPE = "tf2_msgs/msg/TFMessage"
_OLD_TF_TYPE = "tf/msg/tfMessage"
_MAP_FRAMES = ("map", "world")
_MOST_GAP_S = 0.5
_MAGIC = (b"#ROSBAG V", b"\x89MCAP0\r\n")


def looks_like_bag(path: str | Path) -> bool:
    """Tell a ROS 1 bag, an mcap or db3 file, or the folder of a ROS 2 bag."""
    path = Path(path)
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or _find_storage(path) is not None
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError:
        return False
    return head.startswith(_MAGIC) or (head.startswith(b"SQLite format 3") and _is_db3(path))


def _is_db3(path: Path) -> bool:
    return path.suffix.lower() == ".db3"


def _find_storage(folder: Path) -> Path | None:
    """Return the first mcap or db3 file of a folder."""
    found = (f for f in sorted(folder.iterdir()) if f.suffix.lower() in (".mcap", ".db3"))
    return next(found, None)


def read_bag(
    path: str | Path, *, scan_topic: str | None = None, odom_topic: str | None = None
) -> ScanLog:
    """Read the scans of a bag, with odometry and, where a mapper ran, corrected poses.

    Parameters
    ----------
    path : a ROS 1 bag, an mcap or db3 file, or the folder of a ROS 2 bag.
    scan_topic : the LaserScan topic; may be left out if there is only one.
    odom_topic : the Odometry topic; may be left out if there is at most one. Without one the
        odometry is taken from tf.

    Returns
    -------
    The scans in order of their stamps. Where the laser sits on the robot is taken from tf; a laser
    mounted upside down is turned round. Ranges outside the limits of the message are NaN.

    Raises
    ------
    InputError : no bag, or damaged; the topics cannot be told, the candidates are listed; the
        ``rosbags`` library is not installed.

    Source
    ------
    The message definitions of sensor_msgs, nav_msgs and tf2_msgs; REP 105 for frames.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such file; check the name")
    with _open(path) as reader:
        by_topic = {c.topic: c.msgtype for c in reader.connections}
        scans = _choose(path, by_topic, SCAN_TYPE, scan_topic, "laser scan", "--scan")
        if scans is None:
            listed = ", ".join(f"{t} ({m})" for t, m in sorted(by_topic.items())[:12]) or "nothing"
            raise InputError(f"{path}: holds no topic of type {SCAN_TYPE}; it holds {listed}")
        odometry = _choose(path, by_topic, ODOM_TYPE, odom_topic, "odometry", "--odom")
        recording = _read_messages(reader, scans, odometry)
    return _Assembly(path, recording, scans, odometry).make_log()


def _open(path: Path) -> Any:  # noqa: ANN401
    """Return the reader of a bag, ready for ``with``."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(
            f"{path}: reading ROS bags needs the rosbags library; install it with "
            "pip install 'hssh[ros]'"
        ) from None
    target = path
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        target = _find_storage(path) or path
    elif path.is_file() and path.suffix.lower() == ".db3" and _is_of_folder(path):
        target = path.parent
    return _Guarded(path, AnyReader, target, get_typestore(Stores.LATEST), AnyReaderError)


def _is_of_folder(path: Path) -> bool:
    return (path.parent / "metadata.yaml").is_file()


class _Guarded:
    """A reader whose own errors become input errors."""

    def __init__(self, path: Path, kind: Any, target: Path, store: Any, error: Any) -> None:  # noqa: ANN401
        self.path, self.error = path, error
        try:
            self.reader = kind([target], default_typestore=store)
        except Exception as fault:  # the library raises whatever a damaged file makes it
            raise self._explain(fault) from None

    def __enter__(self) -> Any:  # noqa: ANN401
        try:
            return self.reader.__enter__()
        except Exception as fault:
            raise self._explain(fault) from None

    def __exit__(self, kind: Any, fault: Any, trace: Any) -> None:  # noqa: ANN401
        self.reader.__exit__(kind, fault, trace)
        if fault is not None and not isinstance(fault, InputError) and isinstance(fault, Exception):
            raise self._explain(fault) from None

    def _explain(self, fault: Exception) -> InputError:
        what = str(fault) or type(fault).__name__
        return InputError(
            f"{self.path}: cannot be read as a ROS bag ({what}); was the recording closed properly?"
        )


def _choose(
    path: Path,
    by_topic: dict[str, str],
    kind: str,
    wanted: str | None,
    what: str,
    option: str,
) -> str | None:
    """Return the topic wanted, or the only one of a type; None if there is none."""
    candidates = sorted(topic for topic, msgtype in by_topic.items() if msgtype == kind)
    listed = ", ".join(candidates)
    if wanted is not None:
        if wanted in candidates:
            return wanted
        raise InputError(
            f"{path}: has no {what} topic {wanted}; "
            + (f"its {what} topics are {listed}" if listed else f"it holds none of type {kind}")
        )
    if len(candidates) > 1:
        raise InputError(f"{path}: has several {what} topics: {listed}; choose one with {option}")
    return candidates[0] if candidates else None


@dataclass
class _Recording:
    """Messages taken from a bag."""

    scans: list[tuple[float, Any]] = field(default_factory=list)
    odometry: list[tuple[float, ...]] = field(default_factory=list)
    base_frame: str = ""
    frames: FrameTree = field(default_factory=FrameTree)
    broken: int = 0


def _read_messages(reader: Any, scan_topic: str, odom_topic: str | None) -> _Recording:  # noqa: ANN401
    recording = _Recording()
    tf_types = (TF_TYPE, _OLD_TF_TYPE)
    wanted = [
        c
        for c in reader.connections
        if c.topic in (scan_topic, odom_topic) or c.msgtype in tf_types
    ]
    for connection, stamp_ns, raw in reader.messages(connections=wanted):
        try:
            message = reader.deserialize(raw, connection.msgtype)
        except Exception:  # one damaged message is no reason to lose the drive
            recording.broken += 1
            continue
        if connection.topic == scan_topic:
            recording.scans.append((_stamp(message.header, stamp_ns), message))
        elif connection.topic == odom_topic:
            pose = message.pose.pose
            recording.odometry.append(
                (_stamp(message.header, stamp_ns), *_list_pose(pose.position, pose.orientation))
            )
            recording.base_frame = message.child_frame_id.lstrip("/")
        else:
            static = connection.topic.rstrip("/").endswith("tf_static")
            for transform in message.transforms:
                place = transform.transform
                recording.frames.add(
                    transform.header.frame_id,
                    transform.child_frame_id,
                    (
                        _stamp(transform.header, stamp_ns),
                        *_list_pose(place.translation, place.rotation),
                    ),
                    static=static,
                )
    return recording


def _stamp(header: Any, stamp_ns: int) -> float:  # noqa: ANN401
    """Return the time of a message, that of its arrival if it has none of its own."""
    seconds = float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)
    return seconds if seconds > 0 else 1e-9 * stamp_ns


def _list_pose(position: Any, turn: Any) -> Iterator[float]:  # noqa: ANN401
    return (float(v) for v in (position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w))


class _Assembly:
    """Putting scans and poses together."""

    def __init__(
        self, path: Path, recording: _Recording, scan_topic: str, odom_topic: str | None
    ) -> None:
        self.path, self.recording = path, recording
        self.scan_topic, self.odom_topic = scan_topic, odom_topic
        self.notices = list[str]()
        if recording.broken:
            self.notices.append(f"{path}: {recording.broken} messages cannot be read, skipped")

    def make_log(self) -> ScanLog:
        """Return the log."""
        kept = self._keep_alike(sorted(self.recording.scans, key=lambda pair: pair[0]))
        if not kept:
            raise InputError(f"{self.path}: {self.scan_topic} holds no scan that can be read")
        first = kept[0][1]
        frame = first.header.frame_id.lstrip("/")
        times = np.array([time for time, _ in kept])
        ranges = np.stack([_mask_ranges(message) for _, message in kept])
        size = ranges.shape[1]
        angles = float(first.angle_min) + float(first.angle_increment) * np.arange(size)
        odometry, corrected, upside_down, inside = self._find_poses(frame, times)
        if not inside.all():
            if not inside.any():
                raise InputError(
                    f"{self.path}: no odometry lies within {_MOST_GAP_S:g} s of any scan of "
                    f"{self.scan_topic}; do both run on one clock?"
                )
            lost = int((~inside).sum())
            self.notices.append(f"{self.path}: {lost} scans without odometry near them are skipped")
        if upside_down:
            ranges, angles = ranges[:, ::-1], -angles[::-1]
        if not np.isfinite(ranges[inside]).any():
            raise InputError(f"{self.path}: none of the scans of {self.scan_topic} has a return")
        return ScanLog(
            str(self.path),
            times[inside],
            np.ascontiguousarray(ranges[inside]),
            np.asarray(angles, float),
            None if odometry is None else odometry[inside],
            None if corrected is None else corrected[inside],
            notices=tuple(self.notices),
        )

    def _keep_alike(self, scans: list[tuple[float, Any]]) -> list[tuple[float, Any]]:
        """Return the scans with the most usual beams, and count the others."""
        kinds = Counter((len(m.ranges), round(float(m.angle_min), 4)) for _, m in scans)
        if not kinds:
            return []
        usual = kinds.most_common(1)[0][0]
        kept = [(t, m) for t, m in scans if (len(m.ranges), round(float(m.angle_min), 4)) == usual]
        if len(kept) < len(scans):
            self.notices.append(
                f"{self.path}: {len(scans) - len(kept)} scans of {self.scan_topic} have other "
                f"beams than the usual {usual[0]}, skipped"
            )
        return kept if usual[0] > 1 else []

    def _find_poses(
        self, laser: str, times: Array
    ) -> tuple[Array | None, Array | None, bool, np.ndarray]:
        """Return odometry and corrected poses of the laser, its mounting, and which times count."""
        frames = self.recording.frames
        chain = frames.list_ancestors(laser)
        inside = np.ones(len(times), bool)
        corrected = odometry = None
        fixed = next((name for name in _MAP_FRAMES if name in chain), None)
        if fixed is not None and frames.moves(laser, fixed):
            corrected = flatten_transforms(frames.find_poses(laser, fixed, times))
            inside &= _is_near(times, *frames.find_span(laser, fixed))
        mount = self._find_mount(laser, chain)
        if self.recording.odometry:
            rows = np.array(sorted(self.recording.odometry), float)
            rows = rows if len(rows) > 1 else np.repeat(rows, 2, axis=0)
            odometry = flatten_transforms(interpolate_transforms(rows, times) @ mount)
            inside &= _is_near(times, rows[0, 0], rows[-1, 0])
        else:
            top = chain[chain.index(fixed) - 1] if fixed is not None else chain[-1]
            if top in chain and frames.moves(laser, top):
                odometry = flatten_transforms(frames.find_poses(laser, top, times))
                inside &= _is_near(times, *frames.find_span(laser, top))
            elif corrected is None:
                self.notices.append(
                    f"{self.path}: neither an odometry topic nor moving frames; the drive is found "
                    "from the scans alone"
                )
        return odometry, corrected, bool(mount[2, 2] < 0), inside

    def _find_mount(self, laser: str, chain: list[str]) -> Array:
        """Return the pose (4, 4) of the laser on the robot, where the odometry is measured."""
        frames = self.recording.frames
        body = self.recording.base_frame
        if body in chain:
            return np.asarray(frames.find_poses(laser, body, np.zeros(1))[0])
        if self.recording.odometry:
            self.notices.append(
                f"{self.path}: no transform from {laser} to {body or 'the robot'}; the laser is "
                "taken to sit where the odometry is measured"
            )
            return np.eye(4)
        rigid = laser
        while rigid in frames.static:
            rigid = frames.parent[rigid]
        return np.asarray(frames.find_poses(laser, rigid, np.zeros(1))[0])


def _is_near(times: Array, first: float, last: float) -> np.ndarray:
    return (times >= first - _MOST_GAP_S) & (times <= last + _MOST_GAP_S)


def _mask_ranges(message: Any) -> np.ndarray:  # noqa: ANN401
    """Return the ranges as float32, NaN where nothing was hit."""
    ranges = np.asarray(message.ranges, np.float32).copy()
    low, high = float(message.range_min), float(message.range_max)
    hit = np.isfinite(ranges) & (ranges > 0) & (ranges >= low)
    if high > low:
        hit &= ranges < 0.999 * high
    ranges[~hit] = np.nan
    return ranges
