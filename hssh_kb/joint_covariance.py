"""The joint covariance of places, told by what has changed since it was last written out.

An arrival adds a place to the covariance or takes a matrix of low rank off it. Writing all of it
out each time costs the square of the number of places, in time and in memory, for each map that
a search holds. Here maps share the matrix last written out and the changes that they have in
common; an arrival costs a few columns, and only every so often is the matrix written out anew.

Source: ours; the delayed updates of large Kalman filters are after Guivant & Nebot, "Optimization
of the simultaneous localization and map-building algorithm", IEEE TRA 17, 2001.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_MOST_CHANGES = 32  # written out anew at the latest after so many ...
_PLACES_PER_CHANGE = 8  # ... and sooner where that is cheap: few places


class _Change(NamedTuple):
    """One arrival.

    Attributes
    ----------
    before : the changes before it; None if it is the first since the matrix was written out.
    rows : (3n, r), with n the number of places then: if ``founds``, r = 3 and it is the covariance
        of all places with the last of them; else ``rows @ rows.T`` was taken off.
    founds : a place was added.
    """

    before: _Change | None
    rows: Array
    founds: bool


class JointCovariance(NamedTuple):
    """Covariance of n poses (x, y, heading); never changed once made.

    Attributes
    ----------
    base : (3m, 3m) as last written out.
    latest : the changes since.
    changes : how many there are.
    held : n.

    Source
    ------
    Ours.

    Examples
    --------
    >>> one = JointCovariance.of(np.eye(3)).grow(np.vstack([0.5 * np.eye(3), np.eye(3)]))
    >>> one.take_columns(0)[3:, 0]
    array([0.5, 0. , 0. ])
    """

    base: Array
    latest: _Change | None
    changes: int
    held: int

    @classmethod
    def of(cls, base: Array) -> JointCovariance:
        """Return a covariance (3n, 3n) that is written out."""
        return cls(base, None, 0, len(base) // 3)

    @property
    def nbytes(self) -> int:
        """Bytes that it does not share with the covariance it grew from."""
        return self.base.nbytes if self.latest is None else self.latest.rows.nbytes

    def grow(self, columns: Array) -> JointCovariance:
        """Return it with one more pose.

        Parameters
        ----------
        columns : (3n + 3, 3) covariance of all poses, the new one last, with the new one.
        """
        return self._add(columns, founds=True)

    def shrink(self, root: Array) -> JointCovariance:
        """Return it less ``root @ root.T``; root (3n, r)."""
        return self._add(root, founds=False)

    def _add(self, rows: Array, *, founds: bool) -> JointCovariance:
        made = JointCovariance(
            self.base, _Change(self.latest, rows, founds), self.changes + 1, self.held + founds
        )
        if made.changes >= min(_MOST_CHANGES, 1 + made.held // _PLACES_PER_CHANGE):
            return JointCovariance.of(made.write_out())
        return made

    def take_columns(self, slot: int) -> Array:
        """Return the covariance (3n, 3) of all poses with one."""
        columns = np.zeros((3 * self.held, 3))
        b = slice(3 * slot, 3 * slot + 3)
        change = self.latest
        while change is not None:
            rows, size = change.rows, len(change.rows)
            if not change.founds:
                columns[:size] -= rows @ rows[b].T
            elif size == b.stop:
                columns[:size] += rows
                return columns
            else:
                columns[size - 3 : size] += rows[b].T
            change = change.before
        columns[: len(self.base)] += self.base[:, b]
        return columns

    def write_out(self) -> Array:
        """Return all of it, (3n, 3n)."""
        size, known = 3 * self.held, len(self.base)
        out = np.zeros((size, size))
        out[:known, :known] = self.base
        off = []
        change = self.latest
        while change is not None:
            rows, end = change.rows, len(change.rows)
            if change.founds:
                out[:end, end - 3 : end] = rows
                out[end - 3 : end, :end] = rows.T
            else:
                padded = np.zeros((size, rows.shape[1]))
                padded[:end] = rows
                off.append(padded)
            change = change.before
        if off:
            root = np.hstack(off)
            out -= root @ root.T
        return out
