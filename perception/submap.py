"""The submap: the scans of the last metres of travel, which the next scan is matched to."""

from __future__ import annotations

from collections import deque

import numpy as np

from perception.errors import NoAnswerError
from perception.geometry import Array, between
from perception.surfaces import Reference, Surface


class Submap:
    """Key scans of the last metres of travel, with their poses.

    Parameters
    ----------
    travel_m : how much of the drive is kept, metres.
    stride_m, stride_rad : a scan is a key scan once the robot has moved or turned so far.

    Examples
    --------
    >>> from perception.surfaces import fit_normals
    >>> wall = fit_normals(np.column_stack([np.full(9, 2.0), np.linspace(-0.4, 0.4, 9)]))
    >>> submap = Submap(travel_m=3.0)
    >>> [submap.add(wall, np.array([x, 0.0, 0.0])) for x in (0.0, 0.2, 0.7, 1.4)]
    [True, False, True, True]
    """

    def __init__(self, travel_m: float, stride_m: float = 0.5, stride_rad: float = 0.35) -> None:
        self._travel_m, self._stride_m, self._stride_rad = travel_m, stride_m, stride_rad
        self._surfaces: deque[Surface] = deque()
        self._stations: deque[Array] = deque()
        self._reference: Reference | None = None

    def __len__(self) -> int:
        return len(self._surfaces)

    def add(self, scan: Surface, pose: Array) -> bool:
        """Take in a scan if the robot has moved enough; say whether it has become a key scan.

        Parameters
        ----------
        scan : in the laser frame.
        pose : (3,) of the laser, in the frame of the submap.
        """
        if self._stations:
            step = between(self._stations[-1], pose)
            if np.hypot(step[0], step[1]) < self._stride_m and abs(step[2]) < self._stride_rad:
                return False
        self._surfaces.append(scan.moved(pose))
        self._stations.append(pose)
        track = np.array(self._stations)[:, :2]
        legs = np.hypot(*np.diff(track, axis=0).T)
        way = float(legs.sum())
        for leg in legs[:-1]:
            if way <= self._travel_m:
                break
            way -= float(leg)
            self._surfaces.popleft()
            self._stations.popleft()
        self._reference = None
        return True

    def make_reference(self) -> Reference:
        """Return all key scans as one reference; the same one until the next key scan."""
        if self._reference is None:
            if not self._surfaces:
                raise NoAnswerError("the submap is empty: add a scan before matching to it")
            parts = list(self._surfaces)
            self._reference = Reference(
                Surface(
                    np.concatenate([s.points for s in parts]),
                    np.concatenate([s.normals for s in parts]),
                    np.concatenate([s.spacing_m for s in parts]),
                )
            )
        return self._reference
