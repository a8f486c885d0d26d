"""``hssh explore`` through the command line."""

import pytest
from small_kb_files import write_torn_kb

SUGGESTION_KEYS = {
    "rank",
    "tie",
    "kind",
    "place",
    "dlp",
    "direction",
    "text",
    "route",
    "length",
    "travels",
    "entropy_before_bits",
    "entropy_after_bits",
    "gain_bits",
    "expects",
}


@pytest.mark.parametrize("strategy", ["entropy", "agenda", "rehearsal"])
def test_explore_a_trace(hssh, traces, strategy):
    path = traces / "grid-3x3-ltplus.json"
    document = hssh("explore", path, "--all", "--strategy", strategy, "--json").document
    assert document["schema"] == "hssh.explore/1"
    assert (document["strategy"], document["used"]) == (strategy, strategy)
    assert document["maps"] == 62
    assert document["entropy_bits"] == pytest.approx(5.954, abs=1e-3)
    assert document["suggestions"]
    for one in document["suggestions"]:
        assert set(one) >= SUGGESTION_KEYS
        told = [n for group in one["expects"] for n in group["maps"]]
        assert sorted(told) == list(range(1, 63))
    assert hssh("explore", path, "--all", "--strategy", strategy, "--json").document == document


def test_explore_in_words(hssh, traces):
    answer = hssh("explore", traces / "grid-3x3-ltplus.json", "--all", "--best", "2")
    assert answer.code == 0
    assert answer.err == ""
    assert "62 rival maps" in answer.out
    assert "Leave P0 by the way on the left" in answer.out
    assert "may see anything" in answer.out
    assert "more: --best" in answer.out


def test_ties_are_told(hssh, traces):
    answer = hssh("explore", traces / "grid-3x3-ltplus.json", "--strategy", "agenda")
    assert "The first 2 tie" in answer.out
    assert "\n1= " in answer.out


def test_nothing_left_to_explore_is_answered_no(hssh, traces):
    path = traces / "ring-2x2-l.json"
    answer = hssh("explore", path)
    assert answer.code == 1
    assert "nothing left to explore" in answer.out
    document = hssh("explore", path, "--json").document
    assert document["schema"] == "hssh.explore/1"
    assert document["suggestions"] == []
    assert "nothing left" in document["reason"]


def test_explore_a_drive(hssh, drive_kb):
    document = hssh("explore", drive_kb, "--strategy", "agenda", "--json").document
    assert document["unit"] == "m"
    assert all(one["length"] > 0 for one in document["suggestions"])


def test_explore_a_map_in_two_pieces(hssh, tmp_path):
    answer = hssh("explore", write_torn_kb(tmp_path / "torn.hssh"))
    assert answer.code == 0
    assert "Leave P3 by the way straight ahead" in answer.out
    assert "No known way leads from here to P0" in answer.out


def test_a_budget_without_all_has_no_effect(hssh, traces):
    answer = hssh("explore", traces / "ring-2x2-l.json", "--budget", "3")
    assert answer.code == 2
    assert "--all" in answer.err
