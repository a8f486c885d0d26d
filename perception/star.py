"""The star: the clockwise circular order of the directed local-paths of a place.

Source: Beeson 2008, section 5.1; Beeson, Modayil & Kuipers 2010, section 5.1.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from perception.errors import InputError

_DLP = re.compile(r"(?P<path>.+)(?P<direction>[+-])(?P<alpha>[01])\Z", re.DOTALL)


@dataclass(frozen=True, slots=True, order=True)
class Dlp:
    """A directed local-path (dlp), leading away from its place.

    Attributes
    ----------
    path : name of the local-path; the two dlps of one local-path share it.
    direction : ``"+"`` or ``"-"``.
    alpha : 1 if travel is possible along it away from the place, else 0.
    """

    path: str
    direction: str
    alpha: int

    def __str__(self) -> str:
        """Return the text form, such as ``a+1``."""
        return f"{self.path}{self.direction}{self.alpha}"

    @classmethod
    def parse(cls, text: str) -> Dlp:
        """Read the text form: name, direction, alpha.

        Raises
        ------
        InputError : the text has another form.

        Examples
        --------
        >>> Dlp.parse("a+1")
        Dlp(path='a', direction='+', alpha=1)
        """
        match = _DLP.match(text) if isinstance(text, str) else None
        if match is None:
            raise InputError(
                f"{text!r} is not a directed local-path: expected a name, '+' or '-', "
                "and alpha 0 or 1, such as 'a+1'"
            )
        return cls(match["path"], match["direction"], int(match["alpha"]))


@dataclass(frozen=True)
class Star:
    """A star: dlps in clockwise order; index arithmetic is modulo its size.

    Raises
    ------
    InputError : a local-path lacks one of its two directions or has one twice.

    Examples
    --------
    >>> t = Star.parse(["a-0", "b+1", "a+1", "b-1"])
    >>> t.opposite(0), t.alpha
    (2, (0, 1, 1, 1))
    >>> t.isomorphisms(Star.parse(["y+1", "x+1", "y-1", "x-0"]))
    (3,)
    """

    dlps: tuple[Dlp, ...]

    def __post_init__(self) -> None:
        faults = star_faults(self.dlps)
        if faults:
            raise InputError("; ".join(faults))

    @classmethod
    def parse(cls, texts: Sequence[str]) -> Star:
        """Read a star from the text forms of its dlps, clockwise."""
        return cls(tuple(Dlp.parse(text) for text in texts))

    def __len__(self) -> int:
        return len(self.dlps)

    def __str__(self) -> str:
        """Return the dlps in clockwise order."""
        return " ".join(map(str, self.dlps))

    @cached_property
    def alpha(self) -> tuple[int, ...]:
        """Alpha of each dlp, by index."""
        return tuple(dlp.alpha for dlp in self.dlps)

    @cached_property
    def opposites(self) -> tuple[int, ...]:
        """Index of the opposite dlp (same local-path, other direction), by index."""
        index = {(dlp.path, dlp.direction): k for k, dlp in enumerate(self.dlps)}
        flip = {"+": "-", "-": "+"}
        return tuple(index[dlp.path, flip[dlp.direction]] for dlp in self.dlps)

    def opposite(self, k: int) -> int:
        """Return the index of the dlp opposite to dlp k."""
        return self.opposites[k]

    @cached_property
    def _shape(self) -> tuple[tuple[int, int], ...]:
        """Per dlp: alpha and the clockwise distance to its opposite; names play no part."""
        size = len(self)
        return tuple(
            (alpha, (opposite - k) % size)
            for k, (alpha, opposite) in enumerate(zip(self.alpha, self.opposites, strict=True))
        )

    def isomorphisms(self, other: Star) -> tuple[int, ...]:
        """Return every r such that k -> (k + r) mod m maps this star onto ``other``.

        Cyclic order, alpha and path continuity are preserved.

        Source
        ------
        Beeson 2008, section 5.1 (the three conditions on phi).
        """
        if len(self) != len(other):
            return ()
        size, mine, theirs = len(self), self._shape, other._shape
        return tuple(
            r
            for r in range(max(size, 1))
            if all(mine[k] == theirs[(k + r) % size] for k in range(size))
        )


def star_faults(dlps: Sequence[Dlp]) -> list[str]:
    """Return one sentence for each fault of a would-be star; empty if there is none."""
    faults = []
    seen: dict[str, list[str]] = {}
    for dlp in dlps:
        seen.setdefault(dlp.path, []).append(dlp.direction)
    for path, directions in seen.items():
        if sorted(directions) != ["+", "-"]:
            faults.append(
                f"local-path {path!r} must occur once as '{path}+' and once as '{path}-', "
                f"found {', '.join(path + d for d in directions)}"
            )
    return faults
