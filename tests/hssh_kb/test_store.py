"""The knowledge base file: round trip, kills, and every way it can be broken."""

import os
import random
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_kbs import make_kb

from hssh_kb.errors import InputError
from hssh_kb.kb import KnowledgeBase
from hssh_kb.store import SCHEMA_VERSION, is_knowledge_base, load_kb, save_kb

ARRAYS = ("poses", "times_s", "visit_scans", "odometry")


@pytest.fixture(scope="module")
def kb():
    return make_kb({2: "lift lobby"})


@pytest.fixture
def path(kb, tmp_path):
    path = tmp_path / "a.hssh"
    save_kb(kb, path)
    return path


def assert_same(one: KnowledgeBase, other: KnowledgeBase):
    assert one.experience == other.experience
    assert one.ranked == other.ranked
    assert [h.terms for h in one.hypotheses] == [h.terms for h in other.hypotheses]
    assert one.names == other.names
    assert one.record == other.record
    for a, b in zip(one.layouts, other.layouts, strict=True):
        assert (a is None) == (b is None)
        if a is not None:
            assert np.array_equal(a.poses, b.poses)
            assert np.array_equal(a.covariances, b.covariances)
            assert a.chi2 == b.chi2
    for name in ARRAYS:
        assert np.array_equal(getattr(one.trajectory, name), getattr(other.trajectory, name))
    assert other.trajectory.corrected is None
    assert one.lpms.keys() == other.lpms.keys()
    rasters = [*one.lpms.values(), one.global_map], [*other.lpms.values(), other.global_map]
    for a, b in zip(*rasters, strict=True):
        assert np.array_equal(a.image, b.image)
        assert a.frame == b.frame


def test_round_trip(kb, path):
    assert_same(kb, load_kb(path))


def test_saving_again_replaces_and_leaves_nothing_else(kb, path):
    save_kb(kb, path)
    assert [p.name for p in path.parent.iterdir()] == ["a.hssh"]


def test_content_not_name_says_what_a_file_is(path, tmp_path, traces):
    assert is_knowledge_base(path.rename(tmp_path / "a.json"))
    assert not is_knowledge_base(traces / "ring-2x2-l.json")


def test_a_leftover_of_a_dead_process_is_removed_and_one_of_a_live_process_stays(kb, path):
    dead = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    left, live = (path.parent / f".a.hssh.{pid}.ffff.part" for pid in (dead, os.getpid()))
    left.write_bytes(b"half")
    live.write_bytes(b"half")
    save_kb(kb, path)
    assert not left.exists()
    assert live.exists()


KILLER = """
import os, random, signal, sys, time
sys.path.insert(0, {tests!r})
from pathlib import Path
from small_kbs import make_kb
from hssh_kb.store import load_kb, save_kb
path, rng = Path(sys.argv[1]), random.Random(7)
kbs = [make_kb({{2: "one"}}), make_kb({{2: "other"}})]
for _ in range({kills}):
    child = os.fork()
    if not child:
        while True:
            for kb in kbs:
                save_kb(kb, path)
    time.sleep(rng.uniform(0.005, 0.06))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    print(load_kb(path).names[2], len(list(path.parent.iterdir())) - 1)
"""
KILLS = 40


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork to kill a process in the middle")
def test_killed_at_any_moment_the_file_is_the_old_or_the_new_one(tmp_path):
    path = tmp_path / "a.hssh"
    save_kb(make_kb({2: "old"}), path)
    script = KILLER.format(tests=str(Path(__file__).parent), kills=KILLS)
    told = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
    ).stdout
    seen = [line.split() for line in told.splitlines()]
    assert len(seen) == KILLS
    assert {name for name, _ in seen} <= {"old", "one", "other"}
    assert any(name != "old" for name, _ in seen), "no save was finished: it kills too early"
    assert any(left != "0" for _, left in seen), "no save was interrupted: it kills too late"
    save_kb(make_kb(), path)
    assert [p.name for p in tmp_path.iterdir()] == ["a.hssh"]


def assert_refused(path, *words):
    with pytest.raises(InputError) as caught:
        load_kb(path)
    text = str(caught.value)
    assert str(path) in text
    assert "\n" not in text
    for word in words:
        assert word in text
    assert caught.value.exit_code == 3


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.001, 0.01, 0.3, 0.5, 0.9, 0.999])
def test_cut_short(path, share):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    if path.stat().st_size < 16:
        assert_refused(path, "not a knowledge base", "hssh build")
    else:
        assert_refused(path, "cut short", "build it again")


def test_newer_schema(path):
    with sqlite3.connect(path) as db:
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    db.close()
    assert_refused(path, f"schema version {SCHEMA_VERSION + 1}", "newer hssh")


def test_another_program(tmp_path):
    path = tmp_path / "other.db"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE t (x)")
    db.commit()
    db.close()
    assert_refused(path, "another program")


def edit(path, *statements):
    db = sqlite3.connect(path)
    for statement in statements:
        db.execute(*statement)
    db.commit()
    db.close()


def test_a_missing_table(path):
    edit(path, ("DROP TABLE lpms",))
    assert_refused(path, "lpms")


def test_a_missing_row(path):
    edit(path, ("DELETE FROM meta WHERE key = 'ranking'",))
    assert_refused(path, "damaged")


def test_a_spoilt_array(path):
    edit(path, ("UPDATE trajectory SET array = ? WHERE name = 'poses'", (b"\x00junk",)))
    assert_refused(path, "damaged")


def test_a_spoilt_image(path):
    edit(path, ("UPDATE global_map SET png = ?", (b"junk",)))
    assert_refused(path, "damaged")


def test_a_trace_that_breaks_its_format(path):
    edit(path, ("UPDATE experience SET document = '{}'",))
    assert_refused(path, "schema")


def test_a_map_that_does_not_fit_the_experience(path):
    edit(
        path,
        (
            "UPDATE hypotheses SET document = replace(document, '\"visits\": [0', "
            "'\"visits\": [0, 0, 0, 0') WHERE number = 1",
        ),
    )
    assert_refused(path, "map 1")


def test_flipped_bytes_never_crash(path):
    """Whatever bytes are damaged: it loads, or it is refused in one sentence."""
    good, rng = path.read_bytes(), random.Random(3)
    for _ in range(60):
        data = bytearray(good)
        for _ in range(rng.choice([1, 20, 400])):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            load_kb(path)
        except InputError as error:
            assert str(path) in str(error)  # noqa: PT017


def test_where_nothing_can_be_written(kb, tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        save_kb(kb, tmp_path / "nowhere" / "a.hssh")
    with pytest.raises(InputError, match="is a directory"):
        save_kb(kb, tmp_path)
