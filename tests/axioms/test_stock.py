"""Stock clingo runs the theory from the files alone: ``python -m clingo``, no code of ours."""

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest
import worlds
from test_against_brute_force import contradict

from hssh_kb.basic import BasicExperience, enumerate_basic_maps
from hssh_kb.cli import main
from hssh_kb.facts import write_instance
from hssh_kb.maps import minimal_maps
from hssh_kb.theory import axiom_directory
from hssh_kb.trace import load_trace, make_experience

TRACES = Path(__file__).resolve().parents[1] / "traces"
BEST = ("--opt-mode=optN", "--quiet=1")
POLICIES = {
    "paths-then-places": ["best_maps.lp"],
    "places-then-paths": ["all_maps.lp", "objective.lp", "policies/places_then_paths.lp"],
    "places-only": ["all_maps.lp", "objective.lp", "policies/places_only.lp"],
}


def run_clingo(files, *options):
    """Its answer as JSON; it must have nothing to say besides."""
    run = subprocess.run(
        [sys.executable, "-m", "clingo", *files, "0", "--outf=2", *options],
        capture_output=True,
        text=True,
        check=False,
        cwd=axiom_directory(),
    )
    assert run.stderr == ""
    return json.loads(run.stdout)["Models"]


def instance(tmp_path, text, *facts):
    path = tmp_path / "instance.lp"
    path.write_text("\n".join([text, *facts]), encoding="utf-8")
    return path


def export(tmp_path, source):
    """The instance that the command line writes."""
    path = tmp_path / "exported.lp"
    assert main(["export", str(source), "-o", str(path)]) == 0
    return path


@pytest.mark.parametrize("left_out", [(), ("14",), ("08", "14")])
def test_all_maps_and_axioms_left_out(tmp_path, left_out):
    name = "figure8-3x2-lt" if left_out else "grid-3x3-ltplus"
    path = export(tmp_path, TRACES / f"{name}.json")
    column = len(left_out)
    expected = worlds.REFERENCES[name][2][2 - column]
    files = ["all_maps.lp"]
    if left_out:  # the list of files, some of them left out
        text = (axiom_directory() / "all_maps.lp").read_text(encoding="utf-8")
        included = [line.split('"')[1] for line in text.splitlines() if line.startswith("#incl")]
        files = [file for file in included if file[:2] not in left_out]
    assert run_clingo([*files, path], "-q")["Number"] == expected


@pytest.mark.parametrize("policy", POLICIES)
def test_each_policy_has_its_best_maps(tmp_path, policy):
    experience = worlds.random_experience(random.Random(0), 3, triangular=True, stubs=True)
    best = minimal_maps(experience, policy=policy)
    path = instance(tmp_path, write_instance(experience))
    found = run_clingo([*POLICIES[policy], path], *BEST)
    assert (found["Optimal"], tuple(found["Costs"])) == (len(best.maps), best.costs[0])


def test_maps_of_the_basic_ssh(tmp_path, capsys):
    data = {"schema": "hssh.trace/1", "kind": "basic"}
    data["views"] = ["w", "u", "u", "w", "w", "u"]
    data["actions"] = ["travel", "turn around", "travel", "turn right", "travel"]
    trace = tmp_path / "basic.json"
    trace.write_text(json.dumps(data), encoding="utf-8")
    maps, _ = enumerate_basic_maps(BasicExperience(tuple(data["views"]), tuple(data["actions"])))
    found = run_clingo(["basic_maps.lp", export(tmp_path, trace)], "-q")
    assert found["Number"] == len(maps) > 1
    assert main(["export", str(trace), "-o", str(tmp_path / "basic.json.pgm")]) == 2
    assert "basic trace" in capsys.readouterr().err


def weigh(tmp_path, experience, *weights):
    path = instance(tmp_path, write_instance(experience), *weights)
    found = run_clingo(["weighed_maps.lp", path], *BEST, "--project=show")
    return found["Optimal"], found["Costs"]


def test_a_weight_of_nothing_switches_an_axiom_off(tmp_path):
    experience = load_trace(TRACES / "ring-2x2-l.json")
    free, ordered, flat = worlds.REFERENCES["ring-2x2-l"][2]
    assert weigh(tmp_path, experience) == (flat, [0])
    off = ["weight(planarity,0).", "weight(order_irreflexive,0)."]
    assert weigh(tmp_path, experience, off[0]) == (ordered, [0])
    assert weigh(tmp_path, experience, *off) == (free, [0])


def test_weights_say_which_axiom_yields(tmp_path):
    """Out and home again, but home looks otherwise: either it is another place, or another star."""
    door = (["a+1", "a-0"], None, 0)
    walk = make_experience([door, (["a-0", "a+1"], 0, 1), (["a+1", "b+1", "a-0", "b-0"], 2, None)])
    heavy = {
        "travel": ["weight(star_isomorphism,9)."],
        "star": ["weight(reversibility,9).", "weight(travel_function,9)."],
    }
    answers = {}
    for name, weights in heavy.items():
        path = instance(tmp_path, write_instance(walk), *weights, "#show. #show violation/2.")
        found = subprocess.run(
            [sys.executable, "-m", "clingo", "weighed_maps.lp", path, "0", "--outf=2", *BEST],
            capture_output=True,
            text=True,
            check=False,
            cwd=axiom_directory(),
        )
        models = json.loads(found.stdout)["Call"][0]["Witnesses"]
        answers[name] = {atom for model in models for atom in model["Value"] if "violation" in atom}
    assert answers["travel"]
    assert all("star_isomorphism" not in atom for atom in answers["travel"])
    assert answers["star"]
    assert all("star_isomorphism" in atom for atom in answers["star"])


def test_what_contradicts_itself_has_maps_that_cost(tmp_path):
    before = worlds.random_experience(random.Random(1), 3)
    number, costs = weigh(tmp_path, contradict(random.Random(1), before))
    assert number > 0
    assert costs[0] > 0
