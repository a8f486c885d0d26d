"""Reading and writing CARMEN logs."""

import bz2
import gzip
import lzma
import os
from pathlib import Path

import numpy as np
import pytest

from perception.carmen import read_carmen, write_carmen
from perception.errors import InputError
from perception.geometry import between, compose
from perception.scanlog import ScanLog

DATA = Path(
    os.environ.get("HSSH_DATA", Path(__file__).resolve().parents[2].parent / "shared" / "data")
)
RADISH = DATA / "logs" / "radish"
NAMES = [
    "acapulco",
    "aces",
    "edmonton",
    "fhw",
    "freiburg-079",
    "freiburg-101",
    "freiburg-campus",
    "infinite-corridor",
    "intel",
    "seattle",
]


def make_log(scans: int = 20, beams: int = 181, fov_deg: float = 180.0, seed: int = 0) -> ScanLog:
    rng = np.random.default_rng(seed)
    angles = np.deg2rad(np.linspace(-fov_deg / 2, fov_deg / 2, beams))
    ranges = rng.uniform(0.5, 9.0, (scans, beams)).astype(np.float32)
    ranges[rng.random(ranges.shape) < 0.05] = np.nan
    poses = np.zeros((scans, 3))
    for k in range(1, scans):
        poses[k] = compose(poses[k - 1], [0.3, 0.01, rng.normal(0, 0.2)])
    return ScanLog("made", 100 + 0.5 * np.arange(scans), ranges, angles, odometry=poses)


def write_text(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def format_flaser(readings, laser, robot=None, stamp=" 7.5 host 7.5") -> str:
    poses = " ".join(map(str, [*laser, *(laser if robot is None else robot)]))
    return f"FLASER {len(readings)} {' '.join(map(str, readings))} {poses}{stamp}"


@pytest.mark.parametrize(
    ("beams", "fov_deg"), [(181, 180.0), (361, 180.0), (271, 270.0), (361, 360.0)]
)
def test_a_written_log_reads_back(tmp_path, beams, fov_deg):
    log = make_log(beams=beams, fov_deg=fov_deg)
    write_carmen(tmp_path / "a.log", log)
    back = read_carmen(tmp_path / "a.log")
    np.testing.assert_allclose(back.angles_rad, log.angles_rad, atol=1e-6)
    np.testing.assert_allclose(back.ranges_m, log.ranges_m, atol=6e-4)
    np.testing.assert_allclose(between(back.odometry, log.odometry), 0, atol=2e-6)
    np.testing.assert_allclose(back.times_s, log.times_s)
    assert back.corrected is None
    assert back.truth is None
    assert back.notices == ()
    assert [p.name for p in tmp_path.iterdir()] == ["a.log"]  # nothing temporary is left


def test_180_and_360_beams_end_before_plus_90_degrees(tmp_path):
    for beams, step in ((180, 1.0), (360, 0.5)):
        line = format_flaser(np.linspace(1, 5, beams), (0.1, 0, 0))
        log = read_carmen(write_text(tmp_path / "a.log", line))
        degrees = np.rad2deg(log.angles_rad)
        assert degrees[0] == pytest.approx(-90)
        assert degrees[-1] == pytest.approx(90 - step)


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
def test_compression_is_told_by_content(tmp_path, pack):
    write_carmen(tmp_path / "a.log", make_log())
    packed = tmp_path / "packed.txt"
    packed.write_bytes(pack((tmp_path / "a.log").read_bytes()))
    assert len(read_carmen(packed)) == 20


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_packed_data_cut_off_are_refused_with_the_place(tmp_path, pack, share):
    write_carmen(tmp_path / "a.log", make_log(scans=200))
    packed = pack((tmp_path / "a.log").read_bytes())
    (tmp_path / "cut").write_bytes(packed[: int(share * len(packed))])
    with pytest.raises(InputError, match=r"cut: the \w+ data are cut off .* byte \d+ .*line \d+"):
        read_carmen(tmp_path / "cut")


def test_a_corrupt_line_is_skipped_and_counted(tmp_path):
    write_carmen(tmp_path / "a.log", make_log())
    lines = (tmp_path / "a.log").read_text().splitlines()
    scans = [k for k, line in enumerate(lines) if line.startswith("FLASER")]
    lines[scans[3]] = lines[scans[3]].replace(" 1", " x1", 2)
    lines[scans[7]] = " ".join(lines[scans[7]].split()[:150])
    lines[scans[9]] = " ".join(["FLASER", "181", *lines[scans[9]].split()[3:]])
    log = read_carmen(write_text(tmp_path / "b.log", "\n".join(lines)))
    assert len(log) == 17
    (notice,) = log.notices
    assert "skipped 3 lines" in notice
    for k in (3, 7, 9):
        assert f"line {scans[k] + 1}:" in notice


def test_a_scan_with_another_beam_count_than_the_log_is_skipped(tmp_path):
    write_carmen(tmp_path / "a.log", make_log())
    lines = (tmp_path / "a.log").read_text().splitlines()
    lines.insert(10, format_flaser([1.0] * 90, (0, 0, 0)))
    log = read_carmen(write_text(tmp_path / "b.log", "\n".join(lines)))
    assert len(log) == 20
    assert "line 11: FLASER with 90 readings where the log has 181" in log.notices[0]


def test_robotlaser_with_and_without_remissions(tmp_path):
    head = "ROBOTLASER1 0 -1.570796 3.141593 0.017453 50.0 0.1 0 180 "
    ranges = " ".join(["2.5"] * 178 + ["50.0", "0.0"])
    tail = "1.2 0.0 0.0 1.0 0.0 0.0 0 0 0 0 0 5.5 robot 5.5"
    with_count = f"{head}{ranges} 0 {tail}"
    with_values = f"{head}{ranges} 180 {' '.join(['9'] * 180)} {tail}"
    for text in (with_count, with_values, f"{head}{ranges} {tail}"):
        log = read_carmen(write_text(tmp_path / "a.log", text.replace("1.2", "1.3") + "\n" + text))
        assert np.isnan(log.ranges_m[:, 178:]).all()
        assert np.isfinite(log.ranges_m[:, :178]).all()
        assert np.rad2deg(log.angles_rad[[0, -1]]) == pytest.approx([-90, 89], abs=0.01)
        assert log.odometry[:, 0].tolist() == [1.3, 1.2]
        assert log.times_s[0] == 5.5


def make_rebased(raw: ScanLog, corrected, has_neff: bool) -> str:
    """Write raw odometry as a mapper does: re-based on the corrected pose at every scan."""
    lines, base = [], np.zeros(3)
    last = raw.odometry[0]
    for k, pose in enumerate(raw.odometry):
        for share in (0.5, 0.97):  # the last motion before the scan is in no ODOM line
            step = between(last, pose) * (share if k else 0)
            x, y, th = compose(base, step)
            lines.append(f"ODOM {x} {y} {th} 0 0 0 {k + share} host {k + share}")
        base = corrected[k]
        readings = np.nan_to_num(raw.ranges_m[k], nan=50.0).round(3).tolist()
        lines.append(format_flaser(readings, base, stamp=f" {k + 1} host {k + 1}"))
        lines.append(f"ODOM {base[0]} {base[1]} {base[2]} 0 0 0 0 host 0")
        if has_neff:
            lines.append("NEFF 30")
        last = pose
    return "\n".join(lines)


@pytest.mark.parametrize("has_neff", [True, False])
def test_rebased_odometry_is_chained_without_the_jumps(tmp_path, has_neff):
    raw = make_log(scans=40)
    corrected = compose([3.0, -2.0, 0.7], raw.odometry * np.array([0.9, 0.9, 1.0]))
    path = write_text(tmp_path / "a.log", make_rebased(raw, corrected, has_neff))
    log = read_carmen(path)
    np.testing.assert_allclose(log.corrected[:, :2], corrected[:, :2])
    step = between(raw.odometry[:-1], raw.odometry[1:])
    np.testing.assert_allclose(between(log.odometry[:-1], log.odometry[1:]), 0.97 * step, atol=1e-9)
    told = read_carmen(path, poses="odometry")
    assert told.corrected is None
    np.testing.assert_allclose(told.odometry[:, :2], corrected[:, :2])


def test_a_lost_scan_of_a_rebased_log_leaves_no_jump(tmp_path):
    raw = make_log(scans=40)
    corrected = compose([300.0, -2.0, 0.7], raw.odometry)
    lines = make_rebased(raw, corrected, has_neff=True).splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("FLASER"))
    lines[first] = lines[first][:200]
    log = read_carmen(write_text(tmp_path / "a.log", "\n".join(lines)))
    assert len(log) == 39
    assert np.abs(log.odometry[:, :2]).max() < 50


def test_a_raw_log_that_repeats_the_scan_pose_in_odom_stays_raw(tmp_path):
    log = make_log(scans=30)
    lines = []
    for k, (x, y, th) in enumerate(log.odometry):
        lines.append(format_flaser([1.0, 2.0, 3.0], (x, y, th), stamp=f" {k + 5} h {k + 5}"))
        lines.append(f"ODOM {x} {y} {th} 0 0 0 {k + 5} h {k + 5}")
    back = read_carmen(write_text(tmp_path / "a.log", "\n".join(lines)))
    assert back.corrected is None
    np.testing.assert_allclose(back.odometry, log.odometry)


def test_a_pair_of_corrected_and_raw_poses_is_told_from_a_mount(tmp_path):
    raw = make_log(scans=30).odometry
    better = compose([1.0, 2.0, 0.5], raw * np.array([0.8, 1.2, 1.0]))
    pair = "\n".join(format_flaser([1.0, 2.0, 3.0], b, r) for b, r in zip(better, raw, strict=True))
    log = read_carmen(write_text(tmp_path / "pair.log", pair))
    np.testing.assert_allclose(log.corrected, better)
    np.testing.assert_allclose(log.odometry, raw)
    laser = compose(raw, [0.2, 0.0, 0.0])
    mount = "\n".join(format_flaser([1.0, 2.0, 3.0], b, r) for b, r in zip(laser, raw, strict=True))
    log = read_carmen(write_text(tmp_path / "mount.log", mount))
    assert log.corrected is None
    np.testing.assert_allclose(log.odometry, laser)


def test_scans_without_poses_take_the_last_odom_line(tmp_path):
    text = "PARAM robot_frontlaser_offset 0.2\n"
    for k in range(5):
        text += f"ODOM {k} 0 0 0 0 0 1 h 1\n" + format_flaser([1.0, 2.0, 3.0], (0, 0, 0)) + "\n"
    log = read_carmen(write_text(tmp_path / "a.log", text))
    assert log.odometry[:, 0].tolist() == [0.2, 1.2, 2.2, 3.2, 4.2]


def test_scans_without_time_stamps_are_numbered(tmp_path):
    text = "\n".join(format_flaser([1.0, 2.0, 3.0], (k, 0, 0), stamp="") for k in range(3))
    log = read_carmen(write_text(tmp_path / "a.log", text))
    assert log.times_s.tolist() == [0, 1, 2]
    assert "no time stamps" in log.notices[0]


def write_faulty(tmp_path: Path, name: str) -> Path:
    path = tmp_path / name
    if name == "directory":
        path.mkdir()
    elif name == "empty":
        path.write_bytes(b"")
    elif name == "empty.gz":
        path.write_bytes(gzip.compress(b""))
    elif name == "binary":
        path.write_bytes(bytes(range(256)) * 50)
    elif name == "prose":
        path.write_text("a text\nwithout any scan\n")
    elif name == "odometry only":
        path.write_text("ODOM 0 0 0 0 0 0 1 h 1\n" * 9)
    elif name == "nothing seen":
        path.write_text(format_flaser([0.0, 0.0, 0.0], (0, 0, 0)))
    elif name == "all scans short":
        path.write_text("FLASER 180 1 2 3 0 0 0 0 0 0 1 h 1\n" * 9)
    return path


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing", "no such file"),
        ("directory", "is a directory"),
        ("empty", "0 bytes"),
        ("empty.gz", "0 bytes"),
        ("binary", r"not a text file \(byte 0 on\)"),
        ("prose", "no usable scan in 2 lines.* line 1: unknown message 'a'"),
        ("odometry only", "no usable scan in 9 lines"),
        ("nothing seen", "none of the 1 scans has a return"),
        ("all scans short", "line 1: FLASER announces 180 readings but has 14 fields"),
    ],
)
def test_faulty_inputs_are_refused_in_one_sentence(tmp_path, name, message):
    with pytest.raises(InputError, match=message) as caught:
        read_carmen(write_faulty(tmp_path, name))
    assert "\n" not in str(caught.value)


def test_writing_refuses_what_cannot_be_a_log(tmp_path):
    log = make_log()
    with pytest.raises(InputError, match="raw odometry"):
        write_carmen(tmp_path / "a.log", ScanLog("x", log.times_s, log.ranges_m, log.angles_rad))
    with pytest.raises(InputError, match="cannot be written"):
        write_carmen(tmp_path / "no" / "a.log", log)
    with pytest.raises(InputError, match="is a directory"):
        write_carmen(tmp_path, log)
    with pytest.raises(InputError, match="expected one word"):
        write_carmen(tmp_path / "a.log", log, host="two words")


@pytest.mark.parametrize("name", NAMES)
def test_real_logs_give_the_reference_odometry(name):
    if not RADISH.is_dir():
        pytest.skip("the public logs (shared/data/logs/radish) are not beside the checkout")
    log = read_carmen(RADISH / f"{name}-corrected.log.xz")
    with lzma.open(RADISH / f"{name}-poses.csv.xz", "rt") as stream:
        table = np.genfromtxt(stream, delimiter=",", names=True)
    assert len(log) == len(table)
    assert log.notices == ()
    for poses, prefix in ((log.corrected, "corr"), (log.odometry, "odom")):
        wanted = np.column_stack([table[f"{prefix}_{c}"] for c in ("x", "y", "theta")])
        np.testing.assert_allclose(poses[:, :2], wanted[:, :2], atol=1e-4)
        np.testing.assert_allclose(np.sin(poses[:, 2] - wanted[:, 2]), 0, atol=1e-4)


def test_a_real_log_without_odometry_has_none():
    if not RADISH.is_dir():
        pytest.skip("the public logs (shared/data/logs/radish) are not beside the checkout")
    log = read_carmen(RADISH / "orebro-corrected.log.xz")
    assert log.odometry is None
    assert log.corrected is not None
    assert "no odometry" in log.notices[0]
    assert 0.02 < np.isnan(log.ranges_m).mean() < 0.03  # 982 of 42897 are the error codes


def test_one_scan_of_a_rewritten_log_is_enough(tmp_path):
    text = "NEFF 30\n" + format_flaser([1.0, 2.0, 3.0], (1, 2, 0.5))
    log = read_carmen(write_text(tmp_path / "a.log", text))
    assert log.corrected.tolist() == [[1, 2, 0.5]]
    assert log.odometry.tolist() == [[0, 0, 0]]


def test_scans_inside_a_pose_graph_have_both_kinds_of_poses(tmp_path):
    text, truth = "", [[0.0, 0.0, 0.0], [1.1, 0.0, 0.1], [2.3, 0.2, 0.1]]
    for k, (x, y, theta) in enumerate(truth):
        pose = f"{x} {y} {theta}"
        text += f"VERTEX_SE2 {k} {pose}\nROBOTLASER1 0 -1.57 3.14 0.785 50 0.1 0 5 2 3 4 3 2 0 "
        text += f"{pose} {pose} 0 0 0 0 0 {k}.5 host {k}.5\n"
    text += "#LOOP\nEDGE_SE2 0 2 2.3 0.2 0.1 1 0 0 1 0 1\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    log = read_carmen(write_text(tmp_path / "graph.g2o", text))
    assert not log.notices
    assert np.allclose(log.corrected, truth)
    measured = between(log.odometry[:-1], log.odometry[1:])
    assert np.allclose(measured[0], [1.0, 0.0, 0.0])
    assert np.allclose(measured[1], between(np.array(truth[1]), np.array(truth[2])))
