"""Axioms changed, switched off, weakened and added, through ``main(argv)``."""

import shutil

import pytest

from hssh_kb.theory import axiom_directory, packaged_directory, use_axioms

RULE = "violation(order_irreflexive, twice(T,D,P,K)) :- starts(T,D,P,K), passes(T,D,P)"


@pytest.fixture(autouse=True)
def packaged_again(monkeypatch):
    monkeypatch.delenv("HSSH_AXIOMS", raising=False)
    yield
    use_axioms(None)


@pytest.fixture
def ring(traces):
    return traces / "ring-2x2-l.json"


@pytest.fixture
def own(tmp_path):
    return shutil.copytree(packaged_directory(), tmp_path / "axioms")


def edit(own, name, old, new):
    path = own / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def visits(answer):
    return {tuple(m["visits"]) for m in answer.document["maps"]}


def test_a_changed_rule_changes_the_maps(hssh, ring, own, monkeypatch):
    before = hssh("maps", ring, "--all", "--json")
    edit(own, "08_order_irreflexive.lp", RULE, f"{RULE}, P > 0")
    after = hssh("maps", ring, "--all", "--axioms", own, "--json")
    assert "08_order_irreflexive.lp" in after.err
    assert len(after.err.splitlines()) == 1
    assert visits(before) < visits(after)
    assert visits(after) - visits(before) == {("P0",) * 9}
    assert hssh("maps", ring, "--all", "--json").document == before.document
    monkeypatch.setenv("HSSH_AXIOMS", str(own))
    assert hssh("maps", ring, "--all", "--json").document == after.document
    assert hssh("check", ring, "--assume", "v1=v0").code == 0


def test_a_changed_rule_changes_the_reasons(hssh, ring, own):
    asked = ("check", ring, "--assume", "v1=v0")
    assert "axiom 8" in hssh(*asked).out
    edit(own, "08_order_irreflexive.lp", RULE, f"{RULE}, P > 0")
    assert hssh(*asked, "--axioms", own).code == 0
    edit(own, "08_order_irreflexive.lp", f"{RULE}, P > 0.", f"{RULE}, P = 0.")
    told = hssh(*asked, "--axioms", own, "--json")
    assert told.code == 1
    assert told.document["violations"][0]["axiom"] == "order_irreflexive"


def test_comments_and_spaces_change_nothing(hssh, ring, own):
    edit(own, "08_order_irreflexive.lp", RULE, f"% mine\n  {RULE} % mine\n")
    answer = hssh("maps", ring, "--axioms", own, "--json")
    assert answer.err == ""
    assert answer.document == hssh("maps", ring, "--json").document


def test_an_axiom_of_ones_own_is_held_and_named(hssh, ring, own):
    header = "Title: home is left for good\n% Says: No visit but the first is at home.\n"
    (own / "19_home.lp").write_text(
        f"% Number: 19\n% Name: home\n% {header}% Source: mine\n% Status: ours\n"
        "% Reads: place/3\n% Derives: violation(home, back(V))\n#defined place/3.\n"
        "violation(home, back(V)) :- place(V,0,O), V > 0.\n"
    )
    answer = hssh("maps", ring, "--all", "--axioms", own, "--json")
    assert answer.document["maps"]
    assert all("P0" not in m["visits"][1:] for m in answer.document["maps"])
    told = hssh("check", ring, "--assume", "v4=v0", "--axioms", own)
    assert told.code == 1
    assert "axiom 19 (home is left for good)" in told.out
    assert "home is left for good" in hssh("axioms", "--axioms", own).out
    (own / "19_home.lp").write_text("violation(home, back(V)) :- place(V,0,O), V > 0.\n")
    assert hssh("maps", ring, "--axioms", own).code == 3


def test_a_file_left_out_switches_its_axiom_off(hssh, ring, own):
    (own / "08_order_irreflexive.lp").unlink()
    by_file = hssh("maps", ring, "--all", "--axioms", own, "--json").document
    by_name = hssh("maps", ring, "--all", "--without", "8", "--json").document
    by_option = hssh("maps", ring, "--all", "--no-order", "--json").document
    assert by_file == by_name
    assert by_file["consistent"] == by_option["consistent"] == 9


def test_switching_off_changes_check(hssh, ring):
    asked = ("check", ring, "--assume", "v1=v0")
    assert hssh(*asked).code == 1
    assert hssh(*asked, "--without", "order_irreflexive").code == 0
    useless = hssh(*asked, "--without", "5")
    assert useless.code == 2
    assert "only maps drawn by hand" in useless.err
    assert hssh(*asked, "--without", "99").code == 2


def test_a_weakened_axiom_costs_and_forbids_nothing(hssh, tmp_path):
    # Turning on one's heel, one finds another star than the one left behind.
    bend, end = '"star": ["a+1", "b+1", "a-0", "b-0"]', '"star": ["a+1", "a-0"]'
    path = tmp_path / "odd.json"
    path.write_text(
        f'{{"schema": "hssh.trace/1", "visits": [{{{bend}, "arrive": null, "depart": 0}},'
        f'{{{end}, "arrive": 1, "depart": 0}}, {{{end}, "arrive": 1, "depart": null}}]}}'
    )
    strict = hssh("maps", path, "--json")
    assert strict.code == 1
    assert strict.document["inconsistent_from"] == 2
    weak = hssh("maps", path, "--weaken", "star_isomorphism=4", "--weaken", "12=1")
    assert weak.code == 0
    assert "weakened: star_isomorphism (cost 4)" in weak.err
    assert "Broken axioms cost" in weak.out
    assert hssh("maps", path, "--weaken", "11=4", "--all").code == 2
    assert hssh("maps", path, "--weaken", "11").code == 2
    assert hssh("maps", path, "--weaken", "11=0").code == 2


def test_rules_of_ones_own_are_obeyed_and_blamed(hssh, ring, tmp_path):
    mine = tmp_path / "mine.lp"
    mine.write_text("violation(mine, home(V)) :- place(V,0,O), V > 0.\n")
    answer = hssh("maps", ring, "--all", "--rules", mine, "--json")
    assert all("P0" not in m["visits"][1:] for m in answer.document["maps"])
    told = hssh("check", ring, "--assume", "v4=v0", "--rules", mine)
    assert told.code == 1
    assert "mine of" in told.out
    assert "home(4)" in told.out
    query = hssh("maps", ring, "--rules", mine, "--query", "at(V,0), V > 0")
    assert query.code == 1


@pytest.mark.parametrize(
    ("rules", "told"),
    [
        ("violation(mine, home(V)) :- plase(V,0,O).", "plase"),
        ("violation(mine, home(V) :- place(V,0,O).", "line 1"),
        ("% none\nviolation(mine, X) :- place(V,0,O).", "line 2"),
        ("#script (python)\n#end.", "scripts are not run"),
    ],
)
def test_faults_of_rules_are_told(hssh, ring, tmp_path, rules, told):
    path = tmp_path / "mine.lp"
    path.write_text(rules)
    answer = hssh("maps", ring, "--rules", path)
    assert answer.code == 3
    assert told in answer.err
    assert str(path) in answer.err


def test_a_directory_without_axioms_is_told(hssh, ring, tmp_path, monkeypatch):
    assert hssh("maps", ring, "--axioms", tmp_path).code == 3
    monkeypatch.setenv("HSSH_AXIOMS", str(tmp_path))
    answer = hssh("maps", ring)
    assert answer.code == 3
    assert "HSSH_AXIOMS" in answer.err
    monkeypatch.delenv("HSSH_AXIOMS")
    assert axiom_directory() == packaged_directory()


def test_probable_maps_that_break_changed_axioms_are_left_out(hssh, drive_kb, tmp_path):
    stored = hssh("maps", drive_kb, "--json").document
    last = len(stored["maps"][0]["visits"]) - 1
    place = int(stored["maps"][0]["visits"][last][1:])
    mine = tmp_path / "mine.lp"
    mine.write_text(f"violation(mine, end) :- place({last},{place},O).\n")
    answer = hssh("maps", drive_kb, "--rules", mine, "--json")
    assert "left out" in answer.err or "break the axioms in use" in answer.err
    if answer.code == 0:
        assert all(m["visits"][last] != f"P{place}" for m in answer.document["maps"])
    assert hssh("maps", drive_kb, "--without", "14").code == 2
