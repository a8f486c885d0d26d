"""``hssh build`` of many inputs through the command line."""

import pytest


def test_build_many_in_words(hssh, traces, tmp_path):
    broken = tmp_path / "broken.json"
    broken.write_text("[]")
    answer = hssh("build", traces / "ring-2x2-l.json", broken, "-o", tmp_path)
    assert answer.code == 3
    assert "1 of 2 knowledge bases built" in answer.out
    assert str(tmp_path / "ring-2x2-l.hssh") in answer.out


def test_build_many(hssh, traces, tmp_path):
    names = ["ring-2x2-l", "office-section5"]
    words = [traces / f"{name}.json" for name in names]
    answer = hssh("build", *words, "-o", tmp_path, "--jobs", "2", "--json")
    assert (answer.code, answer.err) == (0, "")
    document = answer.document
    assert document["schema"] == "hssh.builds/1"
    assert [build["kb"] for build in document["builds"]] == [
        str(tmp_path / f"{name}.hssh") for name in names
    ]
    for name in names:
        own = hssh("maps", tmp_path / f"{name}.hssh", "--json").document
        alone = tmp_path / "alone.hssh"
        hssh("build", traces / f"{name}.json", "-o", alone)
        assert own == hssh("maps", alone, "--json").document


def test_one_bad_log_does_not_stop_the_others(hssh, traces, tmp_path):
    broken, missing = tmp_path / "broken.json", tmp_path / "missing.log"
    broken.write_text('{"schema": "hssh.trace/1", "visits": [')
    good = traces / "ring-2x2-l.json"
    answer = hssh("build", broken, good, missing, "-o", tmp_path, "--json")
    assert answer.code == 3
    assert (tmp_path / "ring-2x2-l.hssh").is_file()
    assert len(answer.document["builds"]) == 1
    assert [fault["exit_code"] for fault in answer.document["faults"]] == [3, 3]
    lines = answer.err.splitlines()
    assert len(lines) == 2
    assert "broken.json" in lines[0]
    assert "missing.log" in lines[1]


USAGE = {
    "no folder": (["A", "B"], "need a folder"),
    "a file for a folder": (["A", "B", "-o", "TMP/x.hssh"], "need a folder"),
    "jobs for one": (["A", "-o", "TMP/x.hssh", "--jobs", "2"], "no effect on a single input"),
    "one name twice": (["A", "TMP/ring-2x2-l.json", "-o", "TMP"], "would both be written"),
    "no executor": (["A", "-o", "TMP/x.hssh", "--executor", "threads"], "dask:ADDRESS"),
    "jobs of a cluster": (["A", "--executor", "dask:x", "--jobs", "2"], "its own workers"),
    "poses of a trace": (["A", "B", "-o", "TMP", "--poses", "odometry"], "no effect"),
}


@pytest.mark.parametrize("case", USAGE)
def test_usage_of_build_many(hssh, traces, tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    words, word = USAGE[case]
    known = {"A": traces / "ring-2x2-l.json", "B": traces / "office-section5.json"}
    answer = hssh("build", *(known.get(w, w.replace("TMP", str(tmp_path))) for w in words))
    assert (answer.code, answer.out) == (2, "")
    assert word in answer.err
    assert list(tmp_path.iterdir()) == []
