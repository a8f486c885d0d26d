"""The metrical parts of a knowledge base, beside experience and hypotheses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perception.geometry import Array
from perception.grid import Frame, Image


@dataclass(frozen=True)
class PlaceLayout:
    """Chi: where the places of one hypothesis lie.

    Attributes
    ----------
    poses : (p, 3) place frames in the map frame, in the order of ``Hypothesis.places``; m, rad.
    covariances : (p, 3, 3) of the poses.
    chi2 : sum of squared residuals over sigma of the displacements.
    """

    poses: Array
    covariances: Array
    chi2: float


@dataclass(frozen=True)
class Raster:
    """A grey grid image with its place in a metric frame.

    Attributes
    ----------
    image : (H, W) uint8; dark occupied, light free, unknown in between.
    frame : where it lies: in the place frame of its visit for a local perceptual map, in the map
        frame for the global map.
    """

    image: Image
    frame: Frame


@dataclass(frozen=True)
class Trajectory:
    """The drive, laid out on the places of the first hypothesis.

    Attributes
    ----------
    poses : (n, 3) in the map frame, one a scan; m, rad.
    times_s : (n,) of the scans.
    visit_scans : (v,) index of the scan at which each visit happened; empty if unknown.
    odometry, corrected : (n, 3) poses found in the log, each in its own frame; None if absent.
    """

    poses: Array
    times_s: Array
    visit_scans: NDArray[np.int64]
    odometry: Array | None = None
    corrected: Array | None = None

    @property
    def length_m(self) -> float:
        """Length of the drive, metres."""
        return float(np.linalg.norm(np.diff(self.poses[:, :2], axis=0), axis=1).sum())


@dataclass(frozen=True)
class BuildRecord:
    """How a knowledge base came about.

    Attributes
    ----------
    source : name of the input file.
    version : version of the program.
    scans : number of scans read; 0 for a trace.
    seconds : time spent, by stage.
    notices : what the user was told on the way.
    options : the options it was built with.
    """

    source: str = ""
    version: str = ""
    scans: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
