"""Experience to facts: the one place that writes the input predicates of the theory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from hssh_kb.experience import Experience, Reading

PRICE_SCALE = 1000
"""A reading of weight w costs ``-PRICE_SCALE * ln(w)``, rounded: integers are what ASP adds up."""


def price_of_reading(weight: float) -> int:
    """Return the price of believing a reading of a given probability.

    Examples
    --------
    >>> price_of_reading(1.0), price_of_reading(0.2)
    (0, 1609)
    """
    return round(-PRICE_SCALE * math.log(weight))


def experience_to_facts(experience: Experience, visits: Iterable[int] | None = None) -> str:
    """Return the facts of an experience, one a line, for the programs in ``axioms/``.

    Parameters
    ----------
    experience : what was lived through.
    visits : only these visits, and the travels between those of them that follow one another.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> two = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> print(experience_to_facts(two).splitlines()[0])
    visit(0). size(0,0,2). dlp(0,0,0,1,1). dlp(0,0,1,0,0). departs(0,0,0).
    """
    chosen = range(len(experience)) if visits is None else sorted(set(visits))
    kept = set(chosen)
    lines = []
    for v in chosen:
        facts = [f"visit({v})."]
        if v - 1 in kept:
            facts.append(f"travelled({v - 1},{v}).")
        several = len(experience.visits[v].readings) > 1
        for r, reading in enumerate(experience.visits[v].readings):
            facts.extend(_reading_facts(v, r, reading))
            if several:
                facts.append(f"price({v},{r},{price_of_reading(reading.weight)}).")
        lines.append(" ".join(facts))
    return "\n".join(lines) + "\n"


def _reading_facts(v: int, r: int, reading: Reading) -> Iterator[str]:
    star = reading.star
    yield f"size({v},{r},{len(star)})."
    for k, (alpha, opposite) in enumerate(zip(star.alpha, star.opposites, strict=True)):
        yield f"dlp({v},{r},{k},{alpha},{opposite})."
    for k, told in enumerate(reading.types):
        if told:
            yield f"path_type({v},{r},{k},{told.lower()})."
    if reading.arrive is not None:
        yield f"arrives({v},{r},{reading.arrive})."
    if reading.depart is not None:
        yield f"departs({v},{r},{reading.depart})."


def candidate_facts(experience: Experience, visits: int | None = None) -> str:
    """Return what ``axioms/tight.lp`` derives: where each visit may be, by its star alone."""
    count = len(experience) if visits is None else visits
    facts = []
    for v in range(count):
        for p in range(v):
            turns = {
                r
                for one in experience.visits[v].readings
                for other in experience.visits[p].readings
                for r in one.isomorphisms(other)
            }
            facts += [f"candidate({v},{p},{r})." for r in sorted(turns)]
    return " ".join(facts) + "\n"


def write_instance(experience: Experience) -> str:
    """Return a stand-alone ``.lp`` instance, to be run with the axiom files by stock clingo."""
    head = [
        f"% Experience of {len(experience)} visits"
        + (f" from {experience.source}" if experience.source else ""),
        "% All maps:  python -m clingo AXIOMS/all_maps.lp THIS_FILE 0",
        "% Best maps: python -m clingo AXIOMS/best_maps.lp THIS_FILE 0 --opt-mode=optN --quiet=1",
        "% where AXIOMS is the directory of the axioms; its README.md says more.",
    ]
    head += [
        f"% visit {v} is called {visit.name!r}"
        for v, visit in enumerate(experience.visits)
        if visit.name
    ]
    head = [line.replace("\n", " ") for line in head]
    return "\n".join([*head, "", experience_to_facts(experience)])
