"""The posterior score of a map: every addend of its log posterior, by name, with its units.

The layout counts by *normalised densities*: a closure has the density of its innovation, a new
place has the density of places, one per ``area_m2``. A bare chi-square with a price per place
would make thousands of maps nearly equal and reward wrong closures when the drift is large.
Where all corridors are much alike, a travel says little about which of them it went through: what
it would have been through a corridor not known yet is taken off where the corridor is known.

Source: Beeson 2008, sections 9.2 and 10.1.2 (posterior over maps); the terms are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hssh_kb.errors import InputError
from hssh_kb.experience import Displacement, Experience
from hssh_kb.heading_noise import estimate_heading_noise
from hssh_kb.place_filter import Array, Innovation, Prediction
from hssh_kb.travel_prior import TravelPrior, estimate_travel_prior

TERMS = ("layout", "heading", "exclusion", "readings", "places", "doubts", "lpm", "travels")
_LOG_2PI = math.log(2 * math.pi)
_LOST_PLACES = 25.0  # a robot that may be at any of so many places is lost


class Addends(NamedTuple):
    """What one visit adds to the log posterior; see :class:`Score`."""

    layout: float
    heading: float
    exclusion: float
    readings: float
    places: float
    doubts: float
    lpm: float = 0.0
    travels: float = 0.0


@dataclass(frozen=True)
class Score:
    """The parameters of the log posterior.

    Attributes
    ----------
    area_m2 : area per place, m2: a new place has the density 1 / area_m2.
    spacing_m : distinct places seldom lie closer than this, m: two at distance d have room
        side by side with probability 1 - exp(-d2 / 2 spacing_m2).
    length_m : typical length of a travel, m.
    spread_m : standard deviation between the origins of two visits to one place, m, per axis.
    dlp_heading_rad : standard deviation of the heading of one dlp as seen at a visit, rad.
    frame_heading_rad : standard deviation of the heading of a visit about its place where both
        share a frame, rad.
    frames : how the frame of a visit is turned against its place where readings carry no
        headings: ``"shared"`` (they are one frame, as the definition of lambda has it) or
        ``"free"`` (unknown; closures then speak of positions only).
    bearing_rad : standard deviation of the direction of a travel against an evenly spaced
        star, rad; used only where readings carry no headings.
    outlier : share of closures whose innovation is three times as wide as it should be.
    askew : share of closures whose headings say nothing: gateways were seen from aside, or half
        of them only.
    floor : no single doubt about one visit (heading, exclusion) costs more than this (< 0).
    place_prior : log prior of each place beyond the first (<= 0).
    slip : probability that a place goes unnoticed during one travel, as expected beforehand.
    slip_travels : so many travels that expectation is worth; the rest a map tells itself.
    travels : what all corridors have in common; None if nothing that helps.
    """

    area_m2: float = 1.0
    spacing_m: float = 0.5
    length_m: float = 1.0
    spread_m: float = 0.0
    dlp_heading_rad: float = math.radians(5.0)
    frame_heading_rad: float = 1e-3
    frames: str = "shared"
    bearing_rad: float = 0.4
    outlier: float = 0.0
    askew: float = 0.0
    floor: float = -10.0
    place_prior: float = 0.0
    slip: float = 0.0
    slip_travels: float = 10.0
    travels: TravelPrior | None = None

    def __post_init__(self) -> None:
        for name in ("area_m2", "spacing_m", "length_m", "bearing_rad", "dlp_heading_rad"):
            if not getattr(self, name) > 0:
                raise InputError(f"score: {name} must be positive, got {getattr(self, name)!r}")
        if self.frames not in ("shared", "free"):
            raise InputError(f"score: frames must be 'shared' or 'free', got {self.frames!r}")
        if not all(0 <= share < 1 for share in (self.slip, self.outlier, self.askew)):
            raise InputError("score: slip, outlier and askew are probabilities below 1")

    def weigh_new(self, prediction: Prediction) -> tuple[float, float]:
        """Return the layout and exclusion addends of a new place."""
        layout = -math.log(self.area_m2)
        if prediction.unknown:
            return layout, 0.0
        chance = np.minimum(self._guess_overlap(prediction), -np.expm1(self.floor))
        return layout, max(float(np.log1p(-chance).sum()), self.floor)

    def _guess_overlap(self, prediction: Prediction) -> Array:
        """Return the chance (n,) that each place leaves no room for a new one at the visit.

        Distinct places at distance d both have room with probability 1 - exp(-d2 / 2 spacing2);
        this is the mean over where the visit and the place may be.
        """
        gap, spread, near = prediction.gap, prediction.spread, self.spacing_m**2
        extra = 2 * self.spread_m**2 + near + 1e-12
        a, b, d = spread[:, 0, 0] + extra, spread[:, 0, 1], spread[:, 1, 1] + extra
        det = a * d - b * b
        x, y = gap[:, 0], gap[:, 1]
        chi2 = (d * x * x - 2 * b * x * y + a * y * y) / det
        return np.asarray(near / np.sqrt(det) * np.exp(-0.5 * chi2))

    def expect_closures(self, prediction: Prediction) -> Array:
        """Return the layout addend (n,) of a closure at each place, outliers aside."""
        if prediction.unknown:
            return np.full(len(prediction.gap), -math.log(self.area_m2))
        gap, spread = prediction.gap, prediction.spread
        extra = self.spread_m**2 + 1e-12
        a, b, d = spread[:, 0, 0] + extra, spread[:, 0, 1], spread[:, 1, 1] + extra
        det = np.maximum(a * d - b * b, 1e-24)
        x, y = gap[:, 0], gap[:, 1]
        chi2 = (d * x * x - 2 * b * x * y + a * y * y) / det
        if self.outlier:
            chi2 = np.minimum(chi2, chi2 / 9 + 8.0)
        return np.asarray(-0.5 * chi2 - 0.5 * np.log(np.minimum(det, self._widest)) - _LOG_2PI)

    @property
    def _widest(self) -> float:
        """The determinant beyond which a robot is lost, and no place is any less probable."""
        return (_LOST_PLACES * self.area_m2) ** 2

    def weigh_closure(
        self, prediction: Prediction, innovation: Innovation, turn_var: float
    ) -> tuple[float, float, tuple[float, float, float]]:
        """Return the layout and heading addends of a closure, and the noise to close with.

        Agreement of headings never speaks for a closure (all places of a building share a few
        headings), disagreement beyond what the noise explains speaks against it.

        Parameters
        ----------
        prediction, innovation : of the visit at the place.
        turn_var : variance [rad2] of the turn between the frames of visit and place; infinite
            if it is unknown.
        """
        if prediction.unknown:
            free = (self.spread_m**2 + 1e-9, self.spread_m**2 + 1e-9, turn_var)
            return -math.log(self.area_m2), 0.0, free
        (a, b, e), (_, d, f), (_, _, g) = innovation.cov
        x, y, t = innovation.residual
        extra = self.spread_m**2 + 1e-12
        a, d = a + extra, d + extra
        det = max(a * d - b * b, 1e-24)
        chi2 = (d * x * x - 2 * b * x * y + a * y * y) / det
        layout, wide = self._weigh_innovation(chi2, det)
        grow = 8.0 if wide else 0.0
        noise_x, noise_y = extra + grow * a, extra + grow * d
        if math.isinf(turn_var):
            return layout, 0.0, (noise_x, noise_y, math.inf)
        p, q = (d * e - b * f) / det, (a * f - b * e) / det
        var = max(g + turn_var - p * e - q * f, 1e-12)
        left = t - p * x - q * y
        heading, counts = self._weigh_disagreement(left * left / var - 1.0, self.floor)
        return layout, heading, (noise_x, noise_y, turn_var if counts else math.inf)

    def _weigh_disagreement(self, excess: float, floor: float) -> tuple[float, bool]:
        """Return the addend of headings that disagree, and whether they are to be counted at all.

        Parameters
        ----------
        excess : chi-square beyond what the noise explains. floor : the most it costs.
        """
        plain = -0.5 * max(excess, 0.0)
        if not self.askew:
            return max(plain, floor), plain >= floor
        told = (1 - self.askew) * math.exp(plain)
        return max(math.log(told + self.askew), floor), told >= self.askew

    def _weigh_innovation(self, chi2: float, det: float) -> tuple[float, bool]:
        """Return the log density, and whether the wide part of the mixture explains it better."""
        wide = 0.5 * math.log(min(det, self._widest))
        plain = -0.5 * chi2 - _LOG_2PI - wide
        if not self.outlier:
            return plain, False
        inner = math.log1p(-self.outlier) + plain
        outer = math.log(self.outlier / 9) - chi2 / 18 - _LOG_2PI - wide
        top = max(inner, outer)
        return top + math.log(math.exp(inner - top) + math.exp(outer - top)), outer > inner

    def bound_travel(self, cov: Sequence[Sequence[float]] | None) -> float:
        """Return the most that one travel can ever add to the layout term (a safe bound).

        No innovation is narrower than the displacement it comes from.
        """
        new = -math.log(self.area_m2)
        if cov is None:
            return new
        extra = self.spread_m**2
        det = (cov[0][0] + extra) * (cov[1][1] + extra) - cov[0][1] ** 2
        return max(new, -_LOG_2PI - 0.5 * math.log(max(det, 1e-24)))

    def weigh_doubt(self, doubted: bool, doubts: int, travels: int) -> float:
        """Return the addend of a travel that is doubted, or believed.

        Where places are often missed, in rooms say, each one missed makes the next less surprising.

        Parameters
        ----------
        doubted : whether it is doubted. doubts, travels : how many of how many travels before are.

        Source
        ------
        Ours: the probability of a slip is unknown, with a beta distribution beforehand.

        Examples
        --------
        >>> score = Score(slip=0.1)
        >>> [round(score.weigh_doubt(True, doubts, 20), 1) for doubts in (0, 5)]
        [-3.4, -1.6]
        """
        if not self.slip:
            return 0.0
        share = (self.slip * self.slip_travels + doubts) / (self.slip_travels + travels)
        return math.log(share) if doubted else math.log1p(-share)

    def match_headings(
        self,
        at_place: Sequence[float],
        at_visit: Sequence[float],
        offset: int,
        alpha: Sequence[int],
    ) -> tuple[float, float, float]:
        """Return the turn of the visit's frame in the place's, its variance, and the misfit.

        Parameters
        ----------
        at_place, at_visit : headings [rad] of the dlps, each in its own frame; if either is
            empty the turn is 0 (shared frames) or unknown (free frames).
        offset : dlp k of the visit is dlp (k + offset) mod m of the place.
        alpha : of the dlps of the visit; only headings of dlps with a gateway are compared
            (of the others only the opposite was seen), unless there is none.

        Returns
        -------
        turn_rad, variance, misfit : the misfit (<= 0) is the part of the disagreement of
            the headings that no turn explains.
        """
        size = len(at_visit)
        if not size or len(at_place) != size:
            var = self.frame_heading_rad**2 if self.frames == "shared" else math.inf
            return 0.0, var, 0.0
        seen = [k for k in range(size) if alpha[k]] or range(size)
        turns = [at_place[(k + offset) % size] - at_visit[k] for k in seen]
        turn = math.atan2(sum(map(math.sin, turns)), sum(map(math.cos, turns)))
        var = 2 * self.dlp_heading_rad**2
        rest = 0.0
        for one in turns:
            left = (one - turn + math.pi) % (2 * math.pi) - math.pi
            rest += left * left
        free = len(turns) - 1
        misfit, _ = self._weigh_disagreement(rest / var - free, 0.6 * self.floor)
        if self.askew and free:
            var = max(var, rest / free)  # what does not agree tells the turn less exactly
        return turn, var / len(turns), misfit

    def weigh_bearing(self, known: complex, seen: complex) -> float:
        """Return the addend (<= 0) for the direction of a travel at a place.

        Parameters
        ----------
        known : sum of the unit vectors of the star's direction as told by earlier travels
            (0 if none).
        seen : unit vector told by this travel.
        """
        if abs(known) < 1e-9:
            return 0.0
        turn = seen * known.conjugate()
        off = math.atan2(turn.imag, turn.real) / self.bearing_rad
        return max(-0.5 * max(off * off - 1.0, 0.0), 0.4 * self.floor)


def estimate_score(experience: Experience, **overrides: Any) -> Score:  # noqa: ANN401
    """Return the score whose scales fit an experience.

    The area per place is the square of the median travel, the spacing half of a short travel
    (5th percentile), both freed from the noise of the displacements. Each place has a log prior
    of -1.5: with it the probabilities of the maps of simulated walks are about the frequencies
    with which they are right. Where the experience admits slips (a robot's log), origins of
    visits spread by 0.3 m (at most a tenth of the median travel), one closure in twenty is an
    outlier, and the headings of one in ten say nothing (recorded logs). Without headings the
    frames are taken to be shared if no travel turns by more than 0.5 rad (frames that all point
    one way), else free. What the corridors have in common, if they do, is learned from all
    travels (:mod:`hssh_kb.travel_prior`); how exact the headings of dlps are, from visits that
    soon come back (:mod:`hssh_kb.heading_noise`).

    Parameters
    ----------
    experience : whose displacements are looked at.
    overrides : values of :class:`Score` to use instead.

    Source
    ------
    Ours.
    """
    moves = [v.displacement for v in experience.visits if v.displacement is not None]
    values: dict[str, Any] = {"slip": experience.slip, "place_prior": -1.5}
    typical, short = _measure_travels(moves)
    if typical > 0:
        values |= {"length_m": typical, "area_m2": typical**2, "spacing_m": 0.5 * short}
        if experience.slip > 0:
            values |= {"spread_m": min(0.3, 0.1 * typical), "outlier": 0.05, "askew": 0.1}
    turned = [abs((d.theta + math.pi) % (2 * math.pi) - math.pi) for d in moves]
    values["frames"] = "shared" if max(turned, default=0.0) <= 0.5 else "free"
    values["travels"] = estimate_travel_prior(experience)
    noise = estimate_heading_noise(experience, values.get("area_m2", Score.area_m2))
    if noise is not None:
        values["dlp_heading_rad"] = noise
    return Score(**(values | overrides))


def _measure_travels(moves: Sequence[Displacement]) -> tuple[float, float]:
    """Return the lengths [m] of a typical and of a short travel, the noise taken out; 0 if none.

    Noise spreads the lengths and makes them longer: across the travel as a whole, along it
    about their median.
    """
    lengths = np.array([length for d in moves if (length := math.hypot(d.x, d.y)) > 0])
    if not len(lengths):
        return 0.0, 0.0
    noise = float(np.median([(d.cov[0][0] + d.cov[1][1]) / 2 for d in moves]))
    median, low = float(np.median(lengths)), float(np.quantile(lengths, 0.05))
    typical = math.sqrt(max(median**2 - noise, median**2 / 4))
    kept = math.sqrt(max(1 - noise / max(float(lengths.var()), 1e-12), 0.0))
    return typical, typical - (median - low) * kept
