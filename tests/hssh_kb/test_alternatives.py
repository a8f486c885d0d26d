"""What became of what no axiom forbids: the ranked maps in which it holds, or its price."""

from pathlib import Path

from hssh_kb.alternatives import find_standing, tell_possible
from hssh_kb.congruence import Assumption
from hssh_kb.kb import KnowledgeBase
from hssh_kb.maps import enumerate_maps, minimal_maps
from hssh_kb.ranking import measure_map
from hssh_kb.trace import load_trace

FIGURE8 = load_trace(Path(__file__).resolve().parents[1] / "traces" / "figure8-3x2-lt.json")


def test_the_best_maps_under_an_assumption_are_the_best_of_those_in_which_it_holds():
    maps = enumerate_maps(FIGURE8).maps
    for v in range(len(FIGURE8)):
        for w in range(v):
            for same in (True, False):
                held = [h for h in maps if (h.visits[v] == h.visits[w]) == same]
                found = minimal_maps(FIGURE8, supposed=[Assumption(v, w, same, "")])
                least = min((measure_map(FIGURE8, h) for h in held), default=None)
                expected = {h for h in held if measure_map(FIGURE8, h) == least}
                assert set(found.maps) == expected


def test_a_tie_and_a_price_are_told():
    kb = KnowledgeBase.from_experience(FIGURE8)
    assert find_standing(kb, ["v9=v3"]).maps == (2,)
    assert "in 1 of the 2 ranked maps (2)" in tell_possible(kb, 9, 3)
    assert find_standing(kb, ["v9=v0"]).maps == ()
    told = tell_possible(kb, 9, 0)
    assert "8 paths and 9 places, this one 5 paths and 6 places" in told
    assert find_standing(kb, ["v9!=v3", "v3=v0"]).maps == (1,)
