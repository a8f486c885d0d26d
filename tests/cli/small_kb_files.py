"""Knowledge base files for the tests of the command line."""

from hssh_kb.hypothesis import Hypothesis
from hssh_kb.kb import KnowledgeBase
from hssh_kb.ranking import RankedMaps
from hssh_kb.trace import make_experience


def write_torn_kb(path):
    """P0 - P1 and P3 - P4; the one travel between them is contradicted at both its ends."""
    way = ["a+1", "a-1"]
    experience = make_experience(
        [(way, None, 0), (way, 0, 1), (way, 1, 0), (way, 0, 1), (way, 1, None)]
    )
    best = Hypothesis((0, 1, 0, 3, 4), (0,) * 5, log_posterior=-1.0, doubted=(3,))
    KnowledgeBase(experience, RankedMaps((best,), "posterior")).save(path)
    return path
