from __future__ import annotations

import builtins
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from perception.bags import TF_TYPE, looks_like_bag, read_bag
from perception.errors import InputError
from perception.geometry import compose

rosbags = pytest.importorskip(
    "rosbags", reason="the rosbags library is not installed (pip install 'hssh[ros]')"
)

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

KINDS = ("ros1", "db3", "mcap")
MOUNT = (0.2, -0.1, 0.3)
BEAMS = 19


class Recorder:
    """Writes messages to a bag of either kind."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.kind = kind
        if kind == "ros1":
            self.store = get_typestore(Stores.ROS1_NOETIC)
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF_TYPE)
            )
            self.path = folder / "drive.bag"
            self.writer = Writer1(self.path)
        else:
            self.store = get_typestore(Stores.ROS2_HUMBLE)
            self.path = folder / f"drive_{kind}"
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(self.path, version=9, storage_plugin=plugin)
        self.connections: dict[str, object] = {}

    def __enter__(self) -> Recorder:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.close()

    def make(self, name: str, *values: object, **keys: object) -> object:
        return self.store.types[name](*values, **keys)

    def write(self, topic: str, message: object, time_s: float) -> None:
        name = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, name, typestore=self.store)
        if self.kind == "ros1":
            raw = self.store.serialize_ros1(message, name)
        else:
            raw = self.store.serialize_cdr(message, name)
        self.writer.write(self.connections[topic], round(time_s * 1e9), raw)

    def header(self, time_s: float, frame: str) -> object:
        stamp = self.make("builtin_interfaces/msg/Time", int(time_s), round(time_s % 1 * 1e9))
        extra = {"seq": 0} if self.kind == "ros1" else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **extra)

    def turn(self, yaw: float, *, upside_down: bool = False) -> object:
        name = "geometry_msgs/msg/Quaternion"
        c, s = math.cos(yaw / 2), math.sin(yaw / 2)
        return self.make(name, c, s, 0.0, 0.0) if upside_down else self.make(name, 0.0, 0.0, s, c)

    def scan(
        self, time_s: float, ranges: np.ndarray, *, topic: str = "/scan", stamped: bool = True
    ) -> None:
        message = self.make(
            "sensor_msgs/msg/LaserScan",
            self.header(time_s if stamped else 0.0, "laser"),
            -0.9,
            0.9,
            0.1,
            0.0,
            0.1,
            0.05,
            10.0,
            ranges.astype(np.float32),
            np.zeros(0, np.float32),
        )
        self.write(topic, message, time_s)

    def odometry(self, time_s: float, pose: np.ndarray, *, topic: str = "/odom") -> None:
        point = self.make("geometry_msgs/msg/Point", float(pose[0]), float(pose[1]), 0.0)
        place = self.make("geometry_msgs/msg/Pose", point, self.turn(float(pose[2])))
        zero = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        twist = self.make("geometry_msgs/msg/Twist", zero, zero)
        message = self.make(
            "nav_msgs/msg/Odometry",
            self.header(time_s, "odom"),
            "base_link",
            self.make("geometry_msgs/msg/PoseWithCovariance", place, np.zeros(36)),
            self.make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
        )
        self.write(topic, message, time_s)

    def transform(
        self,
        time_s: float,
        parent: str,
        child: str,
        pose: tuple[float, float, float] | np.ndarray,
        *,
        static: bool = False,
        upside_down: bool = False,
    ) -> None:
        place = self.make(
            "geometry_msgs/msg/Transform",
            self.make("geometry_msgs/msg/Vector3", float(pose[0]), float(pose[1]), 0.4),
            self.turn(float(pose[2]), upside_down=upside_down),
        )
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped", self.header(time_s, parent), child, place
        )
        message = self.make("tf2_msgs/msg/TFMessage", [stamped])
        self.write("/tf_static" if static else "/tf", message, time_s)


def truth(time_s: float) -> np.ndarray:
    """Return the pose of the robot at a time: a gentle curve."""
    return np.array([0.5 * time_s, 0.1 * math.sin(time_s), 0.2 * math.sin(0.5 * time_s)])


def ranges_at(k: int) -> np.ndarray:
    ranges = 2.0 + 0.1 * np.arange(BEAMS) + 0.01 * k
    ranges[3], ranges[4], ranges[5] = np.inf, np.nan, 0.01
    ranges[6] = 10.0
    return ranges


def record(folder: Path, kind: str, *, odometry: str = "topic", mount: bool = True) -> Path:
    """Record ten seconds: scans at 5 Hz between odometry at 10 Hz."""
    with Recorder(folder, kind) as bag:
        if mount:
            bag.transform(99.9, "base_link", "laser", MOUNT, static=True)
        for k in range(101):
            at = 0.1 * k
            if odometry == "topic":
                bag.odometry(100 + at, truth(at))
            elif odometry == "tf":
                bag.transform(100 + at, "odom", "base_link", truth(at))
                bag.transform(100 + at, "map", "odom", (10.0, 0.0, 0.5))
            if k % 2 == 0 and k < 100:
                bag.scan(100.05 + at, ranges_at(k))
        return bag.path


@pytest.mark.parametrize("kind", KINDS)
def test_scans_and_odometry_of_the_laser(tmp_path, kind):
    path = record(tmp_path, kind)
    assert looks_like_bag(path)
    log = read_bag(path)
    assert len(log) == 50
    assert np.allclose(log.angles_rad, np.linspace(-0.9, 0.9, BEAMS), atol=1e-6)
    assert np.isnan(log.ranges_m[:, 3:7]).all()
    assert np.allclose(log.ranges_m[7, 8:], ranges_at(14)[8:], atol=1e-5)
    wanted = np.array([compose(truth(t - 100), MOUNT) for t in log.times_s])
    assert np.abs(log.odometry - wanted).max() < 2e-3
    assert log.corrected is None
    assert log.notices == ()


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_poses_from_frames_alone(tmp_path, kind):
    log = read_bag(record(tmp_path, kind, odometry="tf"))
    odom = np.array([compose(truth(t - 100), MOUNT) for t in log.times_s])
    assert np.abs(log.odometry - odom).max() < 2e-3
    assert np.abs(log.corrected - compose([10.0, 0.0, 0.5], odom)).max() < 3e-3


def test_a_storage_file_is_as_good_as_its_folder(tmp_path):
    folder = record(tmp_path, "mcap")
    (file,) = folder.glob("*.mcap")
    assert looks_like_bag(file)
    assert len(read_bag(file)) == 50
    (folder / "metadata.yaml").unlink()
    assert looks_like_bag(folder)
    assert len(read_bag(folder)) == 50


def test_a_laser_upside_down_is_turned_round(tmp_path):
    with Recorder(tmp_path, "mcap") as bag:
        bag.transform(1, "base_link", "laser", (0.2, 0.0, 0.0), static=True, upside_down=True)
        for k in range(20):
            bag.odometry(1 + 0.1 * k, np.zeros(3))
            bag.scan(1 + 0.1 * k, np.linspace(1, 2.8, BEAMS))
    log = read_bag(bag.path)
    assert (np.diff(log.angles_rad) > 0).all()
    assert log.angles_rad[0] == pytest.approx(-0.9)
    assert log.ranges_m[0, 0] == pytest.approx(2.8)  # what was on the right is on the left


def test_without_mount_or_odometry_it_is_told(tmp_path):
    log = read_bag(record(tmp_path, "ros1", mount=False))
    assert "no transform from laser" in log.notices[0]
    assert np.abs(log.odometry - [truth(t - 100) for t in log.times_s]).max() < 2e-3
    (tmp_path / "other").mkdir()
    log = read_bag(record(tmp_path / "other", "ros1", odometry="none"))
    assert log.odometry is None
    assert "from the scans alone" in log.notices[0]


def test_several_topics_have_to_be_chosen(tmp_path):
    with Recorder(tmp_path, "mcap") as bag:
        for k in range(10):
            for topic in ("/front", "/rear"):
                bag.scan(k, np.full(BEAMS, 1.0 if topic == "/front" else 2.0), topic=topic)
            for topic in ("/odom", "/odom_raw"):
                bag.odometry(k, np.array([k, 0.0, 0.0]), topic=topic)
    with pytest.raises(InputError, match=r"/front, /rear; choose one with --scan"):
        read_bag(bag.path)
    with pytest.raises(InputError, match=r"/odom, /odom_raw; choose one with --odom"):
        read_bag(bag.path, scan_topic="/rear")
    with pytest.raises(InputError, match=r"no laser scan topic /left; its .* /front, /rear"):
        read_bag(bag.path, scan_topic="/left")
    log = read_bag(bag.path, scan_topic="/rear", odom_topic="/odom")
    assert log.ranges_m[0, 0] == 2.0


def test_odd_scans_and_lonely_scans_are_skipped_and_counted(tmp_path):
    with Recorder(tmp_path, "ros1") as bag:
        for k in range(10):
            bag.odometry(1 + k, np.array([k, 0.0, 0.0]))
            bag.scan(1 + k, np.full(BEAMS if k != 4 else 7, 1.5))
        bag.scan(30.0, np.full(BEAMS, 1.5))
    log = read_bag(bag.path)
    assert len(log) == 9
    told = " ".join(log.notices)
    assert "1 scans of /scan have other beams" in told
    assert "1 scans without odometry" in told


def test_scans_without_stamps_have_their_time_of_arrival(tmp_path):
    with Recorder(tmp_path, "ros1") as bag:
        for k in range(5):
            bag.odometry(50 + k, np.array([k, 0.0, 0.0]))
            bag.scan(50 + k, np.full(BEAMS, 1.5), stamped=False)
    assert np.allclose(read_bag(bag.path).times_s, 50 + np.arange(5))


def test_no_scan_topic_lists_what_there_is(tmp_path):
    with Recorder(tmp_path, "mcap") as bag:
        bag.odometry(1, np.zeros(3))
    with pytest.raises(InputError, match=r"it holds /odom \(nav_msgs/msg/Odometry\)"):
        read_bag(bag.path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_cut_off_is_told(tmp_path, kind):
    path = record(tmp_path, kind)
    file = path if path.is_file() else next(path.glob(f"*.{kind}"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 3])
    with pytest.raises(InputError, match=r"cannot be read as a ROS bag|holds no"):
        read_bag(path)


def test_other_files_are_no_bags(tmp_path):
    log = tmp_path / "drive.log"
    log.write_text("FLASER 3 1 2 3 0 0 0 0 0 0 1.0 host 1.0\n")
    assert not looks_like_bag(log)
    assert not looks_like_bag(tmp_path)
    assert not looks_like_bag(tmp_path / "none")
    with pytest.raises(InputError, match="no such file"):
        read_bag(tmp_path / "none.bag")


def test_without_the_library_it_says_how_to_get_it(tmp_path, monkeypatch):
    path = record(tmp_path, "ros1")
    real = builtins.__import__

    def refuse(name: str, *rest: object) -> object:
        if name.startswith("rosbags"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(InputError, match=r"pip install 'hssh\[ros\]'"):
        read_bag(path)


def test_a_copy_under_another_name_is_still_a_bag(tmp_path):
    path = record(tmp_path, "ros1")
    shutil.copy(path, tmp_path / "drive.dat")
    assert looks_like_bag(tmp_path / "drive.dat")
