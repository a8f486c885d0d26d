"""The knowledge base object: what it refuses, and its questions."""

import dataclasses

import numpy as np
import pytest
from small_kbs import make_kb, true_map, walk_true

from hssh_kb.errors import InputError
from hssh_kb.kb import KnowledgeBase
from hssh_kb.ranking import RankedMaps, rank_maps, tabulate_maps
from hssh_kb.records import PlaceLayout
from hssh_kb.trace import load_trace


@pytest.fixture(scope="module")
def kb():
    return make_kb({2: "lift lobby"})


def test_place_by_label_visit_and_name(kb):
    assert {kb.place(q).label for q in ("P1", "p1", "v1", "v7", " V7 ")} == {"P1"}
    assert kb.place("Lift Lobby").label == "P2"
    with pytest.raises(InputError, match="the places are lift lobby, P0, P1"):
        kb.place("zzz")


def test_rows_of_scores_that_tie(kb):
    tied = dataclasses.replace(kb.hypotheses[1], log_posterior=-3.5)
    ranked = RankedMaps((kb.hypotheses[0], tied, kb.hypotheses[1]), "posterior")
    rows = tabulate_maps(kb.experience, ranked)
    assert [(r.number, r.rank, r.tie) for r in rows] == [(1, 1, 2), (2, 1, 2), (3, 3, 1)]


def test_minimality_can_be_asked_for_where_there_is_metrical_evidence():
    truth = walk_true(2, 2, [0, 1, 3, 2, 0, 1, 3, 2, 0])
    by_posterior = rank_maps(truth.experience)
    assert by_posterior.ranked_by == "posterior"
    assert by_posterior.maps[0].visits == true_map(truth).visits  # four corners
    minimal = rank_maps(truth.experience, minimal="cardinality")
    assert minimal.ranked_by == "minimal"
    assert len(minimal.maps[0].places) == 2  # folded: the distances overrule it


def test_maps_with_options_ranks_anew(traces):
    kb = KnowledgeBase.from_experience(load_trace(traces / "grid-3x3-ltplus.json"))
    assert kb.maps() is kb.ranked
    assert len(kb.maps(every=True, planarity=False).maps) == 88
    assert len(kb.maps(best=3).maps) == 3


def test_too_many_to_count_are_not_counted(traces, monkeypatch):
    monkeypatch.setattr("hssh_kb.ranking.COUNT_LIMIT", 100)
    ranked = rank_maps(load_trace(traces / "block-2x2-plus.json"))
    assert (ranked.consistent, ranked.complete, ranked.proven) == (None, False, True)
    assert [len(h.places) for h in ranked.maps] == [2]


def test_check(kb):
    assert kb.check().consistent
    assert not kb.check(["v2=v0"]).consistent


def test_save_and_open(kb, tmp_path):
    kb.save(tmp_path / "a.hssh")
    assert KnowledgeBase.open(tmp_path / "a.hssh").ranked == kb.ranked


def test_parts_that_do_not_fit_together(kb):
    layout = PlaceLayout(np.zeros((2, 3)), np.zeros((2, 3, 3)), 0.0)
    with pytest.raises(InputError, match="layout of map 1"):
        dataclasses.replace(kb, layouts=(layout,))
    longer = dataclasses.replace(kb.hypothesis(), visits=(0,) * 20, offsets=(0,) * 20)
    with pytest.raises(InputError, match="map 1 has 20 visits"):
        dataclasses.replace(kb, ranked=RankedMaps((longer,), "posterior"), layouts=())
    forward = dataclasses.replace(kb.hypothesis(), visits=(0, 2, *kb.hypothesis().visits[2:]))
    with pytest.raises(InputError, match="not its first"):
        dataclasses.replace(kb, ranked=RankedMaps((forward,), "posterior"), layouts=())
    with pytest.raises(InputError, match="name is for visit 99"):
        dataclasses.replace(kb, names={99: "x"})


def test_no_such_map(kb):
    with pytest.raises(InputError, match="no map 0"):
        kb.graph(0)
    with pytest.raises(InputError, match="2 ranked maps"):
        kb.layout(3)
