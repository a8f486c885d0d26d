"""Damaged CARMEN logs: nothing but InputError ever comes out of the reader."""

import gzip
import lzma
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_carmen import make_log, make_rebased

from perception.carmen import read_carmen, write_carmen
from perception.errors import InputError


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """A raw log, one with ROBOTLASER1, one rewritten by a mapper, as bytes."""
    folder = tmp_path_factory.mktemp("fuzz")
    texts = []
    for beams, fov_deg in ((8, 180.0), (9, 360.0)):
        write_carmen(folder / "a.log", make_log(scans=12, beams=beams, fov_deg=fov_deg))
        texts.append((folder / "a.log").read_bytes())
    raw = make_log(scans=12, beams=9)
    texts.append(make_rebased(raw, raw.odometry * 0.9, has_neff=True).encode())
    return folder, texts


def read_or_refuse(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    try:
        log = read_carmen(path)
    except InputError as error:
        message = str(error)
        assert message.startswith(str(path))
        assert "\n" not in message
        return
    count = len(log)
    assert log.ranges_m.shape == (count, len(log.angles_rad))
    assert np.isfinite(log.times_s).all()
    assert np.isfinite(log.angles_rad).all()
    for poses in (log.odometry, log.corrected):
        assert poses is None or (poses.shape == (count, 3) and np.isfinite(poses).all())
    assert not (log.odometry is None and log.corrected is None)


def damage(data: bytes, rng: np.random.Generator) -> bytes:
    """Truncate, flip bytes, delete or shuffle lines, or put in what a parser may trip on."""
    kind = rng.integers(6)
    if kind == 0:
        return data[: rng.integers(len(data))]
    if kind == 1:
        flipped = np.frombuffer(data, np.uint8).copy()
        places = rng.integers(len(data), size=rng.integers(1, 40))
        flipped[places] ^= rng.integers(1, 256, size=len(places)).astype(np.uint8)
        return flipped.tobytes()
    lines = data.split(b"\n")
    if kind == 2:
        return b"\n".join(line for line in lines if rng.random() > 0.3)
    if kind == 3:
        rng.shuffle(lines)
        return b"\n".join(lines)
    odd = [b"nan", b"-inf", b"1e999", b"1e308", b"", b"0", b"-1", b"1_0", b"\xff", b"9" * 30, b"x"]
    for _ in range(rng.integers(1, 10)):
        place = rng.integers(len(lines))
        tokens = lines[place].split(b" ")
        tokens[rng.integers(len(tokens))] = odd[rng.integers(len(odd))]
        lines[place] = b" ".join(tokens)
    if kind == 5:
        lines = [
            line[: rng.integers(len(line) + 1)] if rng.random() < 0.2 else line for line in lines
        ]
    return b"\n".join(lines)


@pytest.mark.parametrize("seed", range(4))
def test_damaged_text_never_crashes(originals, seed):
    folder, texts = originals
    rng = np.random.default_rng(seed)
    for _ in range(250):
        data = texts[rng.integers(len(texts))]
        for _ in range(rng.integers(1, 4)):
            data = damage(data, rng)
        read_or_refuse(folder / "damaged.log", data)


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress])
def test_damaged_packed_data_never_crash(originals, pack):
    folder, texts = originals
    rng = np.random.default_rng(5)
    for _ in range(60):
        packed = np.frombuffer(pack(texts[0]), np.uint8).copy()
        places = rng.integers(len(packed), size=rng.integers(1, 4))
        packed[places] ^= rng.integers(1, 256, size=len(places)).astype(np.uint8)
        read_or_refuse(folder / "damaged", packed.tobytes()[: rng.integers(1, len(packed) + 1)])


@settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(data=st.binary(max_size=300))
def test_any_bytes_never_crash(tmp_path, data):
    read_or_refuse(tmp_path / "any.log", data)


@settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
@given(
    lines=st.lists(
        st.tuples(
            st.sampled_from(["FLASER", "ROBOTLASER1", "ODOM", "PARAM robot_front_laser_max"]),
            st.lists(st.one_of(st.integers(0, 4), st.floats(width=32)), max_size=25),
        ),
        max_size=8,
    )
)
def test_random_messages_never_crash(tmp_path, lines):
    text = "\n".join(" ".join([name, *map(str, numbers)]) for name, numbers in lines)
    read_or_refuse(tmp_path / "any.log", text.encode())
