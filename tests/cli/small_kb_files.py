"""Knowledge base files for the tests of the command line."""

from hssh_kb.experience import make_experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.kb import KnowledgeBase
from hssh_kb.ranking import RankedMaps


def write_torn_kb(path):
    """Three places in a row; the travel to the third is not believed."""
    way = ["a+1", "a-1"]
    experience = make_experience([(way, None, 0), (way, 0, 0), (way, 0, None)])
    best = Hypothesis((0, 1, 2), (0, 0, 0), log_posterior=-1.0, doubted=(2,))
    KnowledgeBase(experience, RankedMaps((best,), "posterior")).save(path)
    return path
