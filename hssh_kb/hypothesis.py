"""A hypothesis: one leaf of the tree of maps, in plain Python.

Source: architecture of the tree of maps, Beeson 2008, section 8.2 and Algorithm 8.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from hssh_kb.experience import Experience, Reading


@dataclass(frozen=True)
class Hypothesis:
    """One consistent map: which place each visit is, under which isomorphism.

    Attributes
    ----------
    visits : place of each visit, given as the index of the place's first visit;
        ``visits[v] <= v`` and ``visits[visits[v]] == visits[v]``.
    offsets : ``offsets[v]`` is r such that dlp k of visit v is dlp (k + r) mod m of the
        star of its place (the reading chosen at the place's first visit).
    readings : index of the reading of the star chosen at each visit, 0 being the best star;
        empty means "0 everywhere".
    log_posterior : natural logarithm, unnormalised; None without metrical evidence.
    terms : the addends of ``log_posterior`` by name.
    doubted : travels (named by the visit they lead to) that the map does not believe, such as
        one during which a place may have gone unnoticed.
    """

    visits: tuple[int, ...]
    offsets: tuple[int, ...]
    readings: tuple[int, ...] = ()
    log_posterior: float | None = None
    terms: Mapping[str, float] = field(default_factory=dict, compare=False)
    doubted: tuple[int, ...] = ()

    @cached_property
    def places(self) -> tuple[int, ...]:
        """The places, as the indices of their first visits, in order."""
        return tuple(sorted(set(self.visits)))

    def reading(self, experience: Experience, visit: int) -> Reading:
        """Return the reading of the star that holds at a visit."""
        return experience.visits[visit].readings[self.readings[visit] if self.readings else 0]

    def place_dlp(self, experience: Experience, visit: int, k: int) -> tuple[int, int]:
        """Return (place, index in the star of the place) of dlp k of a visit."""
        size = len(self.reading(experience, visit).star)
        return self.visits[visit], (k + self.offsets[visit]) % size
