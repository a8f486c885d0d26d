"""How well the places, stars and closures of a knowledge base agree with lists drawn by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hssh_kb.kb import KnowledgeBase
from perception.geometry import wrap_angle
from perception.star import Star

HIT_M, ALSO_M = 3.5, 2.6
"""A visit so near to a listed place, while it is passed, is a hit; one so near to an opening that
may or may not count is neither right nor wrong."""
NEAR_M, LEFT_M = 3.0, 5.0
"""A passage begins so near to a place, and ends so far from it."""
Stars = Sequence[tuple[Star, ...]]
"""Of each visit the stars that were read there, best first."""

SAME_M, OTHER_M = 1.5, 4.0
"""Visits nearer than the one are to one place, farther apart than the other to two."""


@dataclass(frozen=True)
class PlaceRates:
    """Shares of listed passages found, of visits that are right, of stars that agree.

    Attributes
    ----------
    passages : how often the drive passes a listed place. recall : share of them with a visit.
    raw : share of all visits that are at a listed place. precision : the same, visits at listed
        side openings and doors left out.
    listed : the same, visits at openings that the list lacked left out too.
    wrong : of each visit that is wrong by ``precision`` its number, and whether ``listed`` leaves
        it out.
    arms : share of hits whose best star has the listed arms.
    pairs, equal : pairs of visits to one listed place, and the share with equal best stars, as
        each visit read them by itself: neither has been told what the other saw.
    second : share of (visit, other visit) whose best star is one of the two best of the other.
    recalled_equal, recalled_second : the same once each visit knows what others nearby saw where
        it could not look.
    told : as ``second``, with the readings that other visits suggested, too.
    """

    passages: int
    recall: float
    raw: float
    precision: float
    listed: float
    wrong: tuple[tuple[int, bool], ...]
    arms: float
    pairs: int
    equal: float
    second: float
    recalled_equal: float
    recalled_second: float
    told: float


def rate_places(
    kb: KnowledgeBase,
    truth: dict,
    stars: Stars,
    openings: Sequence[Sequence[float]] = (),
    recalled: Stars | None = None,
) -> PlaceRates:
    """Compare the visits, and the stars read at them, with a list of places, openings and doors.

    Parameters
    ----------
    truth : entry of truth/corridor_places.json. openings : (k, 2) that this list lacks, the same
        frame. stars : as each visit read them by itself.
    recalled : the same stars after each visit was told what others saw; ``stars`` by default.
    """
    poses, scans = kb.trajectory.corrected, kb.trajectory.visit_scans
    listed = truth["places"]
    also = np.array([*truth["also"], *truth.get("doors", [])], float).reshape(-1, 2)
    passages = _find_passages(poses, [place["at"] for place in listed])
    used: dict[int, int] = {}
    for first, last, k in passages:
        away = np.hypot(*(poses[scans, :2] - listed[k]["at"]).T)
        near = [
            (away[v], v)
            for v in range(len(scans))
            if v not in used and first <= scans[v] <= last and away[v] < HIT_M
        ]
        if near:
            used[min(near)[1]] = k
    rest = [v for v in range(len(scans)) if v not in used]
    wrong = [v for v in rest if not _is_near(poses[scans[v], :2], also)]
    late = [_is_near(poses[scans[v], :2], openings) for v in wrong]
    pairs = [(a, b) for a, b in combinations(sorted(used), 2) if used[a] == used[b]]
    arms = [_arms_agree(kb, v, listed[k]["arms"]) for v, k in used.items()]
    return PlaceRates(
        len(passages),
        len(used) / max(len(passages), 1),
        len(used) / max(len(scans), 1),
        len(used) / max(len(used) + len(wrong), 1),
        len(used) / max(len(used) + len(wrong) - sum(late), 1),
        tuple(zip(wrong, late, strict=True)),
        float(np.mean(arms or [0])),
        len(pairs),
        *rate_stars(stars, pairs),
        *rate_stars(stars if recalled is None else recalled, pairs),
        rate_stars(list_stars(kb), pairs)[1],
    )


def _is_near(at: np.ndarray, points: Sequence[Sequence[float]] | np.ndarray) -> bool:
    """Tell whether one of the points (k, 2) may have been taken for a place here."""
    away = np.asarray(points, float).reshape(-1, 2) - at
    return bool(np.hypot(*away.T).min(initial=np.inf) <= ALSO_M)


def rate_stars(stars: Stars, pairs: list[tuple[int, int]]) -> tuple[float, float]:
    """Return the shares of pairs with equal best stars, and of best stars among the two best."""
    equal, second = list[bool](), list[bool]()
    for a, b in pairs:
        equal.append(_are_equal(stars[a][0], stars[b][0]))
        second.append(any(_are_equal(stars[a][0], star) for star in stars[b][:2]))
        second.append(any(_are_equal(stars[b][0], star) for star in stars[a][:2]))
    return float(np.mean(equal or [1])), float(np.mean(second or [1]))


def list_stars(kb: KnowledgeBase) -> Stars:
    """Return the stars of each visit in a knowledge base, best first, suggested ones included."""
    return [tuple(r.star for r in visit.readings) for visit in kb.experience.visits]


def _are_equal(a: Star, b: Star) -> bool:
    return bool(a.isomorphisms(b))


def pair_visits(kb: KnowledgeBase) -> list[tuple[int, int]]:
    """Return the pairs of visits to one spot, for rooms without a list of crossings."""
    at = kb.trajectory.corrected[kb.trajectory.visit_scans, :2]
    pairs = combinations(range(len(at)), 2)
    return [(a, b) for a, b in pairs if np.hypot(*(at[a] - at[b])) <= SAME_M]


def rate_closures(kb: KnowledgeBase) -> tuple[float, float]:
    """Precision and recall of "these two visits are one place" against the corrected poses.

    Neighbouring doors lie two to four metres apart, and the robot passes a place up to two metres
    from its centre: pairs in between are left open.
    """
    at = kb.trajectory.corrected[kb.trajectory.visit_scans, :2]
    visits = kb.hypotheses[0].visits
    right = claimed = same = 0
    for a, b in combinations(range(len(visits)), 2):
        apart = float(np.hypot(*(at[a] - at[b])))
        if SAME_M < apart < OTHER_M:
            continue
        truly, says = apart <= SAME_M, visits[a] == visits[b]
        claimed += says
        same += truly
        right += says and truly
    return right / max(claimed, 1), right / max(same, 1)


def _find_passages(poses: np.ndarray, places: list[list[float]]) -> list[tuple[int, int, int]]:
    """Return (first scan, last scan, place) of each passage, within three metres of a place.

    A drive that comes back to a place without another one between has passed it once.
    """
    found = list[tuple[int, int, int]]()
    for k, at in enumerate(places):
        distance = np.hypot(*(poses[:, :2] - at).T)
        i = 0
        while i < len(distance):
            if distance[i] >= NEAR_M:
                i += 1
                continue
            j = i
            while j + 1 < len(distance) and distance[j + 1] < LEFT_M:
                j += 1
            found.append((i, j, k))
            i = j + 1
    out = list[tuple[int, int, int]]()
    for first, last, k in sorted(found):
        if out and out[-1][2] == k:
            out[-1] = (out[-1][0], last, k)
        else:
            out.append((first, last, k))
    return out


def _arms_agree(kb: KnowledgeBase, v: int, arms_deg: list[float]) -> bool:
    """Tell whether the best star has the listed arms, each within 45 degrees."""
    reading = kb.experience.visits[v].readings[0]
    # Headings are in the drive frame; the heading of the visit in the corrected frame is found
    # from the laser, whose pose the log gives in both.
    turn = _drive_turn(kb, v)
    have = sorted(
        (h + turn) % (2 * np.pi)
        for h, alpha in zip(reading.headings, reading.star.alpha, strict=True)
        if alpha
    )
    want = sorted(np.deg2rad(arms_deg) % (2 * np.pi))
    if len(have) != len(want):
        return False
    n = len(want)
    return any(
        all(abs(wrap_angle(have[(q + s) % n] - want[q])) < np.pi / 4 for q in range(n))
        for s in range(n)
    )


def _drive_turn(kb: KnowledgeBase, v: int) -> float:
    if kb.record.options["poses"] == "corrected":
        return 0.0
    hypothesis, scan = kb.hypotheses[0], int(kb.trajectory.visit_scans[v])
    laid = kb.layouts[0].poses[hypothesis.places.index(hypothesis.visits[v]), 2]
    return float(kb.trajectory.corrected[scan, 2] - kb.trajectory.poses[scan, 2] + laid)
