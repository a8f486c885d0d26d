"""A map that grows while the robot drives: one visit in, the best maps and any change of mind out.

Source: Beeson 2008, section 8.2 and Algorithm 8.1, as visits arrive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from hssh_kb.change_of_mind import ChangeOfMind, explain_change, explain_symbolic_change
from hssh_kb.errors import InputError
from hssh_kb.experience import Experience, Visit
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.layout import lay_out_hypothesis
from hssh_kb.ranking import RankedMaps, rank_maps
from hssh_kb.records import PlaceLayout
from hssh_kb.score import Score, estimate_score
from hssh_kb.search import sum_posteriors
from hssh_kb.trace import experience_from_data, experience_to_data
from hssh_kb.tree_search import TreeOfMaps

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase

_RIVALS = 50


class LiveMap:
    """The tree of maps of a robot under way.

    Parameters
    ----------
    experience : the visits so far; they are searched as a whole.
    score : parameters of the log posterior; estimated from the visits if not given, anew when
        their number has doubled.
    order, planarity : which axioms hold.
    work_per_arrival : units of work (see :mod:`hssh_kb.search_budget`) that an arrival may cost,
        about; what is left undone is done on later arrivals. By default an arrival ends when no
        map that waits is likely to be better.

    Attributes
    ----------
    experience : the visits so far.

    Source
    ------
    Beeson 2008, Algorithm 8.1; the scores and the words are ours.
    """

    def __init__(
        self,
        experience: Experience | None = None,
        *,
        score: Score | None = None,
        order: bool = True,
        planarity: bool = True,
        work_per_arrival: float | None = None,
    ) -> None:
        self.experience = experience or Experience(())
        self._keywords = {"order": order, "planarity": planarity}
        self._work = work_per_arrival
        self._tree = TreeOfMaps(score, experience=self.experience, **self._keywords)
        self._tree.search(budget_work=self._work)
        self._lead = self._tree.lead if self.experience.visits else None

    def arrive(self, visit: Visit, *, depart: int | None = None) -> ChangeOfMind | None:
        """Take in a visit and search on; say whether another map leads now, and why.

        Parameters
        ----------
        visit : the visit that just happened.
        depart : dlp along which the robot left the visit before, in each of its readings, if
            that was not known when it arrived there.

        Returns
        -------
        ChangeOfMind or None : None if the former favourite still leads, grown by the visit.

        Raises
        ------
        InputError : the way out of the visit before is not known, or the visit lacks what a
            travel needs.
        """
        known = list(self.experience.visits)
        previous = None
        if known and depart is not None:
            previous = known[-1] = leave_visit(known[-1], depart)
        self._tree.extend(visit, previous=previous)
        self.experience = replace(self.experience, visits=(*known, visit))
        self._tree.search(budget_work=self._work)
        before, self._lead = self._lead, self._tree.lead
        lead, tree = self._lead, self._tree.tree
        if before is None or lead is None or lead.parent is before:
            return None
        is_here = before.chain()[0] is tree.root
        return explain_change(
            self.experience,
            tree.hypothesis(before),
            tree.hypothesis(lead),
            self._tree.score,
            **self._keywords,
            grown=(tree, before) if is_here else None,
        )

    def best(self, count: int = 1) -> tuple[Hypothesis, ...]:
        """Return the best maps of all visits so far, best first; none if nothing explains them."""
        return self._tree.best(count) if self.experience.visits else ()

    @property
    def is_proven(self) -> bool:
        """Whether no waiting map can be more probable than the best one, under the score."""
        return self._tree.is_proven()


def leave_visit(visit: Visit, depart: int) -> Visit:
    """Return a visit whose way out has become known.

    Raises
    ------
    InputError : no travel is possible along that dlp, or a visit with several readings is given
        one way out.
    """
    if len(visit.readings) > 1:
        raise InputError("a visit with several readings needs a way out in each of them")
    reading = visit.readings[0]
    if not 0 <= depart < len(reading.star) or not reading.star.alpha[depart]:
        raise InputError(f"depart is {depart}, expected a dlp with a gateway of {reading.star}")
    return replace(visit, readings=(replace(reading, depart=depart),))


def extend_kb(
    kb: KnowledgeBase, visit: Visit, *, depart: int | None = None
) -> tuple[KnowledgeBase, ChangeOfMind | None]:
    """Return a knowledge base with one more visit, and the change of mind it brought, if any.

    Where displacements decide, the tree of maps is kept from one visit to the next, so that an
    arrival costs milliseconds; where minimality decides, the maps are ranked anew. Local maps,
    the drive and names are kept; places are laid out anew.

    Parameters
    ----------
    kb : it is not changed.
    visit, depart : as for :meth:`LiveMap.arrive`.

    Raises
    ------
    InputError : the way out of the visit before is not known, or the visit lacks what a travel
        needs.
    """
    change: ChangeOfMind | None
    if kb.ranked_by == "posterior" or not len(kb.experience):
        live = kb.__dict__.pop("_live", None)
        if live is None or live.experience is not kb.experience:
            live = LiveMap(kb.experience)
        change = live.arrive(visit, depart=depart)
        found = live.best(_RIVALS)
        ranked = RankedMaps(
            found[: max(len(kb.hypotheses), 1)],
            "posterior",
            log_evidence=sum_posteriors(found),
        )
        if ranked.maps:
            ranked = replace(ranked, proven=live.is_proven)
        else:
            ranked = replace(kb.ranked, proven=False, inconsistent_from=len(live.experience) - 1)
        return _carry_over(kb, live.experience, ranked, live), change
    known = list(kb.experience.visits)
    if depart is not None:
        known[-1] = leave_visit(known[-1], depart)
    experience = replace(kb.experience, visits=(*known, visit))
    experience_from_data(experience_to_data(experience), experience.source)  # raises
    ranked = rank_maps(experience, minimal=kb.ranked.minimality, policy=kb.ranked.policy)
    change = None
    if ranked.inconsistent_from is None and ranked.maps and kb.hypotheses:
        change = explain_symbolic_change(experience, kb.hypotheses[0], ranked.maps[0])
    return _carry_over(kb, experience, ranked, None), change


def _carry_over(
    kb: KnowledgeBase, experience: Experience, ranked: RankedMaps, live: LiveMap | None
) -> KnowledgeBase:
    layouts = list[PlaceLayout | None]()
    if experience.has_displacements and ranked.inconsistent_from is None:
        for hypothesis in ranked.maps:
            laid = lay_out_hypothesis(experience, hypothesis)
            layouts.append(PlaceLayout(laid.poses, laid.covariances, laid.chi2))
    grown = replace(kb, experience=experience, ranked=ranked, layouts=tuple(layouts))
    if live is not None:
        grown.__dict__["_live"] = live
    return grown


def list_changes_of_mind(
    experience: Experience, *, score: Score | None = None
) -> Sequence[ChangeOfMind]:
    """Return every change of mind while the visits of an experience arrive one by one.

    Parameters
    ----------
    experience : what the robot went through, with displacements.
    score : parameters of the log posterior; by default those that the whole experience tells.

    Examples
    --------
    >>> from hssh_kb.trace import make_experience
    >>> walk = make_experience([(["a+1", "a-0"], None, 0), (["b-1", "b+0"], 1, None)])
    >>> list_changes_of_mind(walk)
    []
    """
    score = score or estimate_score(experience)
    live = LiveMap(replace(experience, visits=()), score=score)
    changes = list[ChangeOfMind]()
    for visit in experience.visits:
        change = live.arrive(visit)
        if change is not None:
            changes.append(change)
    return changes
