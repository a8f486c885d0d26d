"""The most probable maps of an experience: one call from visits to ranked maps.

Source: Beeson 2008, sections 8.2 and 10.1.2; the search itself is in
:mod:`hssh_kb.tree_search`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hssh_kb.contradiction import Contradiction, find_contradiction, tell_strains
from hssh_kb.errors import InputError
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.score import Score
from hssh_kb.search_budget import allow_work
from hssh_kb.tree_search import TreeOfMaps

_RIVALS = 100  # so many complete maps share the probability


@dataclass(frozen=True)
class SearchResult:
    """What the search found.

    Attributes
    ----------
    maps : the best complete maps, best first; if none is consistent, the best maps of the
        visits before ``inconsistent_from``.
    proven : no waiting map can beat the first one, under the score.
    expansions : maps grown.
    leaves : maps that wait.
    inconsistent_from : the first visit that no map could explain, None if all are explained.
    reason : one sentence on how the search ended.
    spent : it ended because the budget was spent.
    log_evidence : log of the summed posteriors of all complete maps found, which makes
        probabilities of their log posteriors; None if there is none.
    contradiction : what clashes at ``inconsistent_from`` and what to doubt, where it is the
        displacements that call for what the axioms refuse.
    strains : which displacements speak against the best map, in words; '' if none does.
    """

    maps: tuple[Hypothesis, ...]
    proven: bool
    expansions: int
    leaves: int
    inconsistent_from: int | None
    reason: str
    spent: bool = False
    log_evidence: float | None = None
    contradiction: Contradiction | None = None
    strains: str = ""


def search_maps(
    experience: Experience,
    *,
    best: int = 5,
    budget_s: float | None = None,
    budget_work: float | None = None,
    order: bool = True,
    planarity: bool = True,
    score: Score | None = None,
) -> SearchResult:
    """Search the most probable maps of an experience.

    Parameters
    ----------
    experience : what the robot went through, with displacements.
    best : how many maps to return.
    budget_s : seconds of wall time to spend at most; None for no limit. A search that they end
        depends on how fast the machine is; one that the work ends does not.
    budget_work : units of work to spend at most (see :mod:`hssh_kb.search_budget`); by default
        what suits the number of visits, ``math.inf`` for no limit.
    order, planarity : which axioms to hold the maps to.
    score : parameters of the log posterior; estimated from the experience if not given.

    Returns
    -------
    SearchResult

    Raises
    ------
    InputError : the experience has no visits, or a visit lacks what a travel needs.

    Source
    ------
    Beeson 2008, Algorithm 8.1 and section 10.1.2; ours.
    """
    if not experience.visits:
        raise InputError(f"{experience.source or 'experience'}: has no visits to map")
    tree = TreeOfMaps(score, experience=experience, order=order, planarity=planarity)
    if budget_work is None:
        budget_work = allow_work(len(experience), tree.score.slip)
    tree.search(budget_s=budget_s, budget_work=budget_work)
    lead = tree.lead
    if lead is not None and not tree.score.slip and order:
        clash = find_contradiction(experience, tree.tree, lead)
        if clash is not None:
            begun = replace(experience, visits=experience.visits[: clash.visit])
            tree = TreeOfMaps(tree.score, experience=begun, planarity=planarity)
            tree.search(budget_s=budget_s, budget_work=budget_work)
            return replace(
                _sum_up(tree, clash.visit, best),
                proven=False,
                inconsistent_from=clash.visit,
                reason=f"inconsistent from visit {clash.visit}: {clash.text}",
                contradiction=clash,
            )
    found = _sum_up(tree, len(experience), best)
    if lead is not None and not tree.score.slip:
        found = replace(found, strains=tell_strains(experience, tree.tree, lead))
    return found


def sum_posteriors(maps: Sequence[Hypothesis]) -> float | None:
    """Return the log of the summed posteriors of maps; None if there are none."""
    known = [m.log_posterior for m in maps if m.log_posterior is not None]
    return float(np.logaddexp.reduce(known)) if known else None


def _sum_up(tree: TreeOfMaps, visits: int, best: int) -> SearchResult:
    every = tree.best(max(best, _RIVALS))
    if every:
        proven = tree.is_proven()
        return SearchResult(
            every[:best],
            proven,
            tree.expansions,
            tree.leaves,
            None,
            _tell_end(tree, proven),
            tree.spent,
            sum_posteriors(every),
        )
    depth = max(d for d in range(visits) if tree.reached(d))
    spent = tree.leaves > 0
    reason = (
        f"the budget was spent before any map explained visit {depth + 1}"
        if spent
        else f"inconsistent from visit {depth + 1}: no map explains it"
    )
    maps = tree.best_so_far(depth, best)
    return SearchResult(maps, False, tree.expansions, tree.leaves, depth + 1, reason, spent)


def _tell_end(tree: TreeOfMaps, proven: bool) -> str:
    if proven:
        return "no waiting map can be more probable"
    if tree.spent:
        return "the budget was spent; a waiting map may be more probable"
    return "no waiting map is likely to be more probable"
