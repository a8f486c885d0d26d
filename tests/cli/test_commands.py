"""Each command through ``main(argv)``: documents, exit codes, what goes to stdout and stderr."""

import gzip
import json
import subprocess
import sys
import time
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

import hssh_kb.cli.entry as cli
from hssh_kb.errors import InternalError
from hssh_kb.kb import KnowledgeBase

COMMANDS = [module.NAME for module in cli.COMMANDS]
COUNTS = {  # consistent maps with planarity and without; the architecture's table
    "ring-2x2-l": (8, 8, (2, 2), 1),
    "block-2x2-plus": (444, 1623, (2, 2), 1),
    "figure8-3x2-lt": (11, 11, (5, 6), 2),
    "grid-3x3-ltplus": (62, 88, (4, 5), 1),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_help_ends_with_examples(hssh, command):
    answer = hssh(command, "--help")
    assert answer.code == 0
    last = [line for line in answer.out.rstrip().split("examples:\n")[-1].splitlines() if line]
    assert last
    assert all(line.strip().startswith(f"hssh {command}") for line in last)


def test_help_is_quick_and_loads_nothing_heavy():
    script = (
        "import sys; from hssh_kb.cli import main; main(['--help']);"
        "sys.exit(sum(m in sys.modules for m in ('numpy', 'cv2', 'clingo', 'scipy', 'networkx')))"
    )
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == 0
    assert time.perf_counter() - start < 1.5  # 0.1 s on an idle machine


@pytest.mark.parametrize("name", COUNTS)
def test_maps_of_the_reference_traces(hssh, traces, name):
    planar, all_maps, best, ties = COUNTS[name]
    document = hssh("maps", traces / f"{name}.json", "--json").document
    assert document["schema"] == "hssh.maps/1"
    assert (document["consistent"], document["complete"]) == (planar, True)
    assert document["ranked_by"] == "minimal"
    top = document["maps"]
    assert len(top) == ties
    assert {(m["paths"], m["places"], m["rank"], m["tie"]) for m in top} == {(*best, 1, ties)}
    every = hssh("maps", traces / f"{name}.json", "--json", "--all", "--no-planarity").document
    assert every["consistent"] == len(every["maps"]) == all_maps
    sizes = [(m["paths"], m["places"]) for m in every["maps"]]
    assert sizes == sorted(sizes)
    for entry in every["maps"]:
        labels = entry["visits"]
        assert all(labels[int(label[1:])] == label for label in labels)
        assert len(entry["offsets"]) == len(labels)


def test_maps_says_in_words_what_decided_and_what_ties(hssh, traces):
    answer = hssh("maps", traces / "figure8-3x2-lt.json")
    assert answer.code == 0
    assert "11 consistent maps" in answer.out
    assert "Minimality decided" in answer.out
    assert "tie" in answer.out
    assert answer.err == ""


def test_maps_by_subset_minimality(hssh, traces):
    answer = hssh("maps", traces / "figure8-3x2-lt.json", "--minimal", "subset", "--json")
    assert answer.code == 0
    assert answer.document["minimal"] == "subset"
    assert {(m["paths"], m["places"]) for m in answer.document["maps"]} >= {(5, 6)}


def test_maps_of_a_kb_by_posterior(hssh, drive_kb):
    document = hssh("maps", drive_kb, "--json").document
    assert document["ranked_by"] == "posterior"
    scores = [m["log_posterior"] for m in document["maps"]]
    assert scores == sorted(scores, reverse=True)
    top = document["maps"][0]
    assert sum(top["terms"].values()) == pytest.approx(top["log_posterior"], abs=1e-6)
    text = hssh("maps", drive_kb, "-v").out
    assert "Metrical evidence decided" in text
    assert "terms of the log posterior" in text
    assert hssh("maps", drive_kb, "--best", 1, "--json").document["maps"] == [top]


def test_maps_from_a_stored_kb_and_minimality_on_demand(hssh, drive_kb):
    document = hssh("maps", drive_kb, "--minimal", "cardinality", "--json").document
    assert document["ranked_by"] == "minimal"


def test_a_budget_that_is_spent_gives_a_partial_answer_and_code_4(hssh, tmp_path):
    """A long walk over crossings that all look alike has more maps than anyone can list."""
    star = ["a+1", "b+1", "a-1", "b-1"]
    visits = [
        {"star": star, "arrive": 0 if v else None, "depart": (0, 1, 3, 0, 1)[v % 5]}
        for v in range(40)
    ]
    path = tmp_path / "alike.json"
    path.write_text(json.dumps({"schema": "hssh.trace/1", "visits": visits}))
    answer = hssh("maps", path, "--all", "--budget", "0.05", "--json")
    assert answer.code == 4
    assert answer.document["budget_spent"] is True
    assert answer.document["consistent"] is None
    assert "partial answer" in hssh("maps", path, "--all", "--budget", "0.05").out


CONTRADICTION = {
    "schema": "hssh.trace/1",
    "visits": [
        {"star": ["a+1", "a-0"], "arrive": None, "depart": 0},
        {"star": ["b+0", "b-1"], "arrive": 0, "depart": 1},
        {"star": ["c+0", "d+1", "c-1", "d-0"], "arrive": 0, "depart": None},
    ],
}


def test_an_experience_that_contradicts_itself(hssh, tmp_path):
    """Back through the gateway one came by, and yet at another star."""
    path = tmp_path / "walk.json"
    path.write_text(json.dumps(CONTRADICTION))
    answer = hssh("maps", path, "--json")
    assert answer.code == 1
    assert answer.document["inconsistent_from"] == 2
    assert [m["visits"] for m in answer.document["maps"]] == [["P0", "P1"]]
    assert "contradicts itself from v2" in hssh("maps", path).out
    check = hssh("check", path, "--json")
    assert check.code == 1
    assert check.document["consistent"] is False
    assert check.document["violations"]
    assert check.document["repairs"]


def test_check(hssh, traces):
    path = traces / "figure8-3x2-lt.json"
    fine = hssh("check", path, "--json")
    assert (fine.code, fine.document["consistent"], fine.document["violations"]) == (0, True, [])
    why_not = hssh("check", path, "--assume", "v7=v2", "--json")
    assert why_not.code == 1
    violation = why_not.document["violations"][0]
    assert violation["observations"] == ["v2", "v7"]
    assert violation["axiom"] == "star_isomorphism"
    assert "v7 = v2" in violation["text"]
    text = hssh("check", path, "--assume", "v7=v2").out
    assert violation["text"] in " ".join(text.split())
    assert "drop the assumption v7 = v2" in text


def test_route_on_a_trace_and_its_document(hssh, traces):
    path = traces / "figure8-3x2-lt.json"
    answer = hssh("route", path, "P0", "v4", "--map", 2, "--json")
    document = answer.document
    assert answer.code == 0
    assert document["schema"] == "hssh.route/1"
    assert (document["from"], document["to"]) == ("P0", "P4")
    actions = [step["action"] for step in document["steps"]]
    assert actions == ["orient", "travel", "turn", "travel", "arrive"]
    assert all(step["text"] for step in document["steps"])
    assert document["steps"][2]["direction"] == "left"
    assert document["length_m"] is None
    assert document["holds_in"] in (1, 2)
    assert hssh("route", path, "P0", "v4", "--map", 2).out.startswith(document["text"])


def test_route_in_metres(hssh, drive_kb):
    document = hssh("route", drive_kb, "P0", "P1", "--json").document
    assert 1 < document["length_m"] < 40


def test_no_route_is_code_1_with_the_reason(hssh, tmp_path):
    from small_kb_files import write_torn_kb

    path = write_torn_kb(tmp_path / "torn.hssh")
    answer = hssh("route", path, "P0", "P3", "--json")
    assert answer.code == 1
    assert answer.document["text"] is None
    assert "from there one reaches P1" in answer.document["reason"]
    assert hssh("route", path, "P0", "P3").out.startswith("No travelled way")
    assert hssh("show", path, "-o", tmp_path / "x.svg", "--route", "P0", "P3").code == 1
    assert not (tmp_path / "x.svg").exists()
    assert hssh("show", path, "-o", tmp_path / "x.svg").code == 0  # in pieces, it can be drawn


@pytest.mark.parametrize("ending", ["svg", "png"])
def test_show(hssh, drive_kb, tmp_path, ending):
    path = tmp_path / f"map.{ending}"
    answer = hssh("show", drive_kb, "-o", path, "--route", "P0", "P1")
    assert (answer.code, answer.out) == (0, f"{path}\n")
    if ending == "svg":
        assert ET.parse(path).getroot().tag.endswith("svg")
    else:
        assert cv2.imread(str(path)) is not None


def test_export(hssh, drive_kb, tmp_path):
    for ending in ("json", "lp", "pgm"):
        answer = hssh("export", drive_kb, "-o", tmp_path / f"x.{ending}", "--json")
        assert answer.code == 0
        for file in answer.document["files"]:
            assert (tmp_path / file).stat().st_size
    assert (tmp_path / "x.yaml").exists()


def test_a_trace_has_no_global_map_to_export(hssh, traces, tmp_path):
    answer = hssh("export", traces / "ring-2x2-l.json", "-o", tmp_path / "x.pgm")
    assert answer.code == 1
    assert "no global map" in answer.err
    assert list(tmp_path.iterdir()) == []


def test_axioms(hssh):
    document = hssh("axioms", "--json").document
    assert document["schema"] == "hssh.axioms/1"
    assert all(
        {"number", "source", "status", "text"} <= axiom.keys() for axiom in document["axioms"]
    )
    text = hssh("axioms").out
    assert all(axiom["title"] in text for axiom in document["axioms"])


def draw_crossing(path):
    image = np.zeros((200, 200), np.uint8)
    image[85:115, :] = image[:, 85:115] = 254
    cv2.imwrite(str(path), image)
    return path


def test_star(hssh, tmp_path):
    first, second = (draw_crossing(tmp_path / name) for name in ("one.png", "two.pgm"))
    answer = hssh("star", first, second, "--json")
    assert answer.code == 0
    images = answer.document["images"]
    assert [image["file"] for image in images] == [str(first), str(second)]
    assert [len(image["gateways"]) for image in images] == [4, 4]
    assert images[0]["at_place"] is True
    assert {"centre", "ends", "outward"} <= images[0]["gateways"][0].keys()
    assert "4 gateways, at a place" in hssh("star", first).out
    assert hssh("star", first, "-o", tmp_path / "drawn.png").code == 0
    assert cv2.imread(str(tmp_path / "drawn.png")) is not None


def test_build_a_trace_then_question_it(hssh, traces, tmp_path):
    path = tmp_path / "walk.hssh"
    document = hssh("build", traces / "grid-3x3-ltplus.json", "-o", path, "--json").document
    assert document["schema"] == "hssh.build/1"
    assert (document["visits"], document["places"], document["paths"]) == (17, 5, 4)
    assert document["scans"] == 0
    assert document["trajectory_m"] is None
    assert document["kb"] == str(path)
    assert hssh("maps", path, "--json").document["maps"][0]["places"] == 5
    assert KnowledgeBase.open(path).hypothesis().places == (0, 1, 2, 3, 4)


def test_build_a_log(hssh, drive_log, drive_kb, tmp_path):
    packed = tmp_path / "drive.log.gz"
    packed.write_bytes(gzip.compress(drive_log.read_bytes()))
    answer = hssh("build", packed, "-o", tmp_path / "again.hssh", "--json")
    document = answer.document
    assert answer.code == 0
    assert document["scans"] > 50
    assert document["trajectory_m"] > 20
    assert {"read", "localise", "places", "search", "layout", "map"} <= document["seconds"].keys()
    once, again = KnowledgeBase.open(drive_kb), KnowledgeBase.open(tmp_path / "again.hssh")
    assert once.ranked == again.ranked  # the same log gives the same maps
    assert np.array_equal(once.trajectory.poses, again.trajectory.poses)


def test_build_names_its_output_after_its_input(hssh, traces, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert hssh("build", traces / "ring-2x2-l.json").code == 0
    assert (tmp_path / "ring-2x2-l.hssh").exists()


USAGE = {
    "no command": [],
    "unknown command": ["fly"],
    "unknown option": ["axioms", "--quick"],
    "all and best": ["maps", "TRACE", "--all", "--best", "2"],
    "subset and all": ["maps", "TRACE", "--all", "--minimal", "subset"],
    "best nought": ["maps", "TRACE", "--best", "0"],
    "negative budget": ["maps", "TRACE", "--budget", "-1"],
    "verbose json": ["maps", "TRACE", "--json", "-v"],
    "budget on a stored answer": ["maps", "KB", "--budget", "3"],
    "poses of a trace": ["build", "TRACE", "--poses", "odometry", "-o", "TMP/x.hssh"],
    "doors of a trace": ["build", "TRACE", "--doors", "keep", "-o", "TMP/x.hssh"],
    "gateways of a trace": ["build", "TRACE", "--min-gateway", "1.2", "-o", "TMP/x.hssh"],
    "output is input": ["build", "TRACE", "-o", "TRACE"],
    "poses that a log lacks": ["build", "LOG", "--poses", "corrected", "-o", "TMP/x.hssh"],
    "picture of another kind": ["show", "TRACE", "-o", "TMP/x.gif"],
    "export of another kind": ["export", "TRACE", "-o", "TMP/x.doc"],
    "radius without resolution": ["star", "x.png", "--robot-radius", "0.2"],
    "one drawing of two images": ["star", "x.png", "y.png", "-o", "TMP/z.png"],
    "robot nowhere": ["star", "x.png", "--robot", "here"],
}


@pytest.mark.parametrize("case", USAGE)
def test_usage_errors_are_code_2(hssh, case, traces, tmp_path, drive_log, drive_kb):
    here = {"TRACE": traces / "ring-2x2-l.json", "KB": drive_kb, "LOG": drive_log}
    words = [str(here.get(w, w.replace("TMP", str(tmp_path)))) for w in USAGE[case]]
    answer = hssh(*words)
    assert answer.code == 2
    assert answer.out == ""
    assert answer.err
    assert list(tmp_path.iterdir()) == []


def test_our_own_fault_is_code_70_and_asks_for_a_report(hssh, monkeypatch):
    def break_down(args):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(cli.axioms, "run", break_down)
    answer = hssh("axioms")
    assert (answer.code, answer.out) == (70, "")
    assert "report" in answer.err
    assert len(answer.err.splitlines()) == 1


def test_debug_shows_the_traceback(capsys, monkeypatch):
    def break_down(args):
        raise InternalError("the axiom files are missing")

    monkeypatch.setattr(cli.axioms, "run", break_down)
    assert cli.main(["axioms", "--debug"]) == 70
    assert "Traceback" in capsys.readouterr().err


def test_interrupted(hssh, monkeypatch):
    def stop(args):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.axioms, "run", stop)
    assert hssh("axioms").code == 130


def test_a_reader_that_goes_away_is_no_fault():
    script = (
        "import sys; from hssh_kb.cli import main_and_exit as m; sys.argv[1:] = ['axioms']; m()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    assert process.wait() == 0
    assert error == b""


def test_version(hssh):
    assert hssh("--version").out.startswith("hssh ")
