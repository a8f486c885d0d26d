"""Broken inputs: each ends in one sentence that names the place of the fault, and exit code 3."""

import copy
import json
import lzma
import random
import sqlite3
import subprocess
import sys
import time

import pytest
from small_kb_files import write_torn_kb

SECTION5 = {
    "schema": "hssh.trace/1",
    "visits": [
        {"star": ["a+1", "b+1", "a-0", "b-0"], "arrive": None, "depart": 1},
        {
            "star": ["a-0", "b+1", "a+1", "b-1"],
            "arrive": 3,
            "depart": 2,
            "name": "lift lobby",
            "displacement": {
                "x": 4.02,
                "y": 0.1,
                "theta": 0.02,
                "cov": [[0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.001]],
            },
        },
    ],
}


def spoil(edit):
    def write(path):
        trace = copy.deepcopy(SECTION5)
        edit(trace)
        path.write_text(json.dumps(trace))

    return write


def put(*keys, value):
    def edit(trace):
        at = trace
        for key in keys[:-1]:
            at = at[key]
        if value is DELETE:
            del at[keys[-1]]
        else:
            at[keys[-1]] = value

    return spoil(edit)


DELETE = object()
V = "visits"
TRACES = {
    "no schema": (put("schema", value=DELETE), "schema"),
    "another schema": (put("schema", value="hssh.trace/2"), "hssh.trace/2"),
    "no visits": (put(V, value=[]), "visits"),
    "visits no list": (put(V, value="three"), "visits"),
    "a visit is no object": (put(V, 1, value=7), "visit 1"),
    "no star": (put(V, 0, "star", value=DELETE), "visit 0"),
    "star with an odd dlp": (put(V, 1, "star", value=["a-0", "b+1", "a+1"]), "visit 1"),
    "dlp twice": (put(V, 1, "star", value=["a-0", "a-0", "a+1", "b-1"]), "visit 1"),
    "dlp misspelt": (put(V, 0, "star", 2, value="a0"), "star[2]"),
    "dlp a number": (put(V, 0, "star", 2, value=3), "star[2]"),
    "arrive out of range": (put(V, 1, "arrive", value=4), "arrive"),
    "arrive negative": (put(V, 1, "arrive", value=-1), "arrive"),
    "arrive a text": (put(V, 1, "arrive", value="3"), "arrive"),
    "arrive true": (put(V, 1, "arrive", value=True), "arrive"),
    "arrive missing": (put(V, 1, "arrive", value=None), "arrive"),
    "arrive at the first visit": (put(V, 0, "arrive", value=2), "visit 0"),
    "arrive through a gateway of alpha 0": (put(V, 1, "arrive", value=2), "alpha is 0"),
    "depart missing": (put(V, 0, "depart", value=DELETE), "depart"),
    "depart with alpha 0": (put(V, 0, "depart", value=2), "alpha is 0"),
    "NaN covariance": (put(V, 1, "displacement", "cov", 0, 0, value=float("nan")), "visit 1"),
    "covariance not positive": (put(V, 1, "displacement", "cov", 0, 0, value=-1), "visit 1"),
    "covariance not symmetric": (put(V, 1, "displacement", "cov", 0, 1, value=0.5), "symmetric"),
    "covariance of another shape": (put(V, 1, "displacement", "cov", value=[1]), "3 x 3"),
    "infinite displacement": (put(V, 1, "displacement", "x", value=float("inf")), "'x'"),
    "displacement at the first visit": (
        put(V, 0, "displacement", value={"x": 1, "y": 0, "theta": 0}),
        "visit 0",
    ),
    "weights above one": (
        put(V, 0, "alternatives", value=[{"star": ["a+1", "a-0"], "depart": 0, "weight": 1.5}]),
        "weight",
    ),
    "name a number": (put(V, 1, "name", value=5), "name"),
    "truncated": (lambda p: p.write_text(json.dumps(SECTION5)[:150]), ":1:"),
    "empty": (lambda p: p.write_bytes(b""), "empty"),
    "only blanks": (lambda p: p.write_bytes(b" \n\n"), "empty"),
    "a directory": (lambda p: p.mkdir(), "directory"),
    "missing": (lambda p: None, "no such file"),
    "garbage": (lambda p: p.write_bytes(random.Random(1).randbytes(4000)), "neither"),
    "a log": (lambda p: p.write_text("ODOM 1 2 3\n"), "hssh build"),
    "nested too deeply": (lambda p: p.write_text("[" * 100_000), "trace.json"),
    "a list": (lambda p: p.write_text("[1, 2]"), "object"),
}


def assert_bad_input(answer, path, *words):
    assert answer.code == 3, answer
    assert answer.out == ""
    sentences = [line for line in answer.err.splitlines() if not line.startswith("note:")]
    assert len(sentences) == 1, answer.err
    assert sentences[0].startswith("hssh: ")
    assert path.name in sentences[0]
    for word in words:
        assert word in sentences[0], answer.err
    assert "Error" not in answer.err


@pytest.mark.parametrize("case", TRACES)
@pytest.mark.parametrize("command", ["maps", "check"])
def test_broken_traces(hssh, tmp_path, case, command):
    path = tmp_path / "trace.json"
    write, word = TRACES[case]
    write(path)
    assert_bad_input(hssh(command, path), path, word)


def test_the_unbroken_one_is_fine(hssh, tmp_path):
    path = tmp_path / "trace.json"
    path.write_text(json.dumps(SECTION5))
    assert hssh("maps", path).code == 0
    assert hssh("check", path).code == 0


def test_all_faults_in_one_message(hssh, tmp_path):
    path = tmp_path / "trace.json"
    trace = copy.deepcopy(SECTION5)
    trace["visits"][0]["depart"] = 2
    trace["visits"][1]["arrive"] = 9
    path.write_text(json.dumps(trace))
    assert_bad_input(hssh("maps", path), path, "visit 0", "visit 1", "alpha is 0", "arrive")


def lines_of(log):
    return log.read_text().splitlines()


def no_scans(log):
    return "\n".join(line for line in lines_of(log) if "FLASER" not in line[:6]).encode()


def wrong_beams_everywhere(log):
    return "\n".join(
        line.replace("FLASER 361", "FLASER 9", 1) if line.startswith("FLASER") else line
        for line in lines_of(log)
    ).encode()


LOGS = {
    "no scans": (no_scans, ("scan",)),
    "empty": (lambda log: b"", ("empty",)),
    "garbage": (lambda log: random.Random(2).randbytes(20_000), ()),
    "prose": (lambda log: b"Once upon a time\nthere was a robot.\n" * 50, ()),
    "truncated xz": (lambda log: lzma.compress(log.read_bytes())[:40_000], ("xz", "cut off")),
    "not a number of beams": (wrong_beams_everywhere, ()),
}


@pytest.mark.parametrize("case", LOGS)
def test_broken_logs(hssh, tmp_path, drive_log, case):
    path = tmp_path / "drive.log"
    spoilt, words = LOGS[case]
    path.write_bytes(spoilt(drive_log))
    target = tmp_path / "x.hssh"
    assert_bad_input(hssh("build", path, "-o", target), path, *words)
    assert not target.exists()


def test_a_missing_log_and_a_folder(hssh, tmp_path):
    target = tmp_path / "x.hssh"
    missing = tmp_path / "nowhere.log"
    assert_bad_input(hssh("build", missing, "-o", target), missing, "no such file")
    assert_bad_input(hssh("build", tmp_path, "-o", target), tmp_path, "directory")


def test_a_corrupt_line_and_a_scan_of_wrong_length_are_skipped_and_counted(
    hssh, tmp_path, drive_log
):
    lines = lines_of(drive_log)
    scans = [i for i, line in enumerate(lines) if line.startswith("FLASER")]
    bad, short = scans[len(scans) // 2], scans[len(scans) // 3]
    lines[bad] = lines[bad][: len(lines[bad]) // 2] + " \x00?!"
    words = lines[short].split()
    lines[short] = " ".join(
        [
            words[0],
            str(int(words[1]) - 7),
            *words[2 : int(words[1]) - 5],
            *words[2 + int(words[1]) :],
        ]
    )
    path = tmp_path / "drive.log"
    path.write_text("\n".join(lines) + "\n")
    answer = hssh("build", path, "-o", tmp_path / "x.hssh", "--json")
    assert answer.code == 0
    assert answer.document["scans"] == len(scans) - 2
    notes = [line for line in answer.err.splitlines() if line.startswith("note:")]
    assert any(f"{bad + 1}" in note for note in notes), notes
    assert answer.document["notices"] == [note.removeprefix("note: ") for note in notes]


def cut_in_half(path):
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def raise_schema(path):
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version = 99")
    db.commit()
    db.close()


KBS = {
    "cut in half": (cut_in_half, "cut short"),
    "newer schema": (raise_schema, "99"),
    "header only": (lambda p: p.write_bytes(p.read_bytes()[:100]), "cut short"),
    "another SQLite file": (
        lambda p: p.write_bytes(p.read_bytes().replace(b"hssh", b"abcd", 1)),
        "another program",
    ),
}


@pytest.mark.parametrize("case", KBS)
@pytest.mark.parametrize(
    "command",
    [
        ["maps", "KB"],
        ["check", "KB"],
        ["route", "KB", "P0", "P1"],
        ["show", "KB", "-o", "TMP/x.svg"],
        ["export", "KB", "-o", "TMP/x.json"],
    ],
    ids=lambda words: words[0],
)
def test_broken_knowledge_bases(hssh, tmp_path, case, command):
    path = write_torn_kb(tmp_path / "office.hssh")
    spoil_kb, word = KBS[case]
    spoil_kb(path)
    words = [{"KB": str(path)}.get(w, w.replace("TMP", str(tmp_path))) for w in command]
    assert_bad_input(hssh(*words), path, word)
    assert [p.name for p in tmp_path.iterdir()] == ["office.hssh"]


QUESTIONS = {
    "unknown place": (["route", "KB", "P0", "P77"], "P77"),
    "unknown map": (["route", "KB", "P0", "P1", "--map", "9"], "no map 9"),
    "unknown map to draw": (["show", "KB", "-o", "TMP/x.svg", "--map", "9"], "no map 9"),
    "unknown place to draw to": (["show", "KB", "-o", "TMP/x.svg", "--route", "P0", "?"], "'?'"),
    "assumption misspelt": (["check", "KB", "--assume", "v1~v0"], "v1~v0"),
    "assumption on no visit": (["check", "KB", "--assume", "v1=v44"], "v44"),
    "picture into no folder": (["show", "KB", "-o", "TMP/no/x.svg"], "x.svg"),
    "export into no folder": (["export", "KB", "-o", "TMP/no/x.json"], "x.json"),
    "build into no folder": (["build", "KB", "-o", "TMP/no/x.hssh"], "no such folder"),
    "picture over a folder": (["show", "KB", "-o", "TMP/dir.svg"], "directory"),
}


@pytest.mark.parametrize("case", QUESTIONS)
def test_questions_about_what_is_not_there(hssh, tmp_path, case):
    path = write_torn_kb(tmp_path / "office.hssh")
    (tmp_path / "dir.svg").mkdir()
    words, word = QUESTIONS[case]
    answer = hssh(*({"KB": str(path)}.get(w, w.replace("TMP", str(tmp_path))) for w in words))
    assert (answer.code, answer.out) == (3, "")
    assert len(answer.err.splitlines()) == 1
    assert word in answer.err


IMAGES = {
    "missing": lambda p: None,
    "text": lambda p: p.write_text("no image"),
    "empty": lambda p: p.write_bytes(b""),
    "folder": lambda p: p.mkdir(),
}


@pytest.mark.parametrize("case", IMAGES)
def test_broken_images(hssh, tmp_path, case):
    path = tmp_path / "x.png"
    IMAGES[case](path)
    assert_bad_input(hssh("star", path), path)


def test_a_knowledge_base_is_no_input_to_build(hssh, tmp_path):
    path = write_torn_kb(tmp_path / "office.hssh")
    assert_bad_input(hssh("build", path, "-o", tmp_path / "x.hssh"), path, "already")


def test_a_build_killed_at_any_moment_leaves_the_old_knowledge_base_or_the_new_one(
    hssh, tmp_path, traces
):
    path, rng = tmp_path / "office.hssh", random.Random(5)
    write_torn_kb(path)
    command = "import sys; from hssh_kb.cli import main; sys.exit(main(sys.argv[1:]))"
    words = [sys.executable, "-c", command, "build", traces / "grid-3x3-ltplus.json", "-o", path]
    start = time.perf_counter()
    subprocess.run(words, check=True, capture_output=True)
    whole_s = time.perf_counter() - start
    for _ in range(4):
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
        time.sleep(rng.uniform(0.5, 1.0) * whole_s)
        process.kill()
        process.wait()
        answer = hssh("maps", path, "--json")
        assert answer.code == 0
        assert len(answer.document["maps"][0]["visits"]) in (5, 17)
