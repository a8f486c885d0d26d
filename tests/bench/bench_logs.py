"""Recorded lidar logs, end to end: log in, knowledge base out.

Beside our figures stand those of the feasibility trial on the same logs and, for the trajectory,
the corrected poses that the logs carry. Places to find are listed by hand in
truth/corridor_places.json. Stars are compared three times: as each visit read them by itself;
"recalled", once the stored local map of a visit that surely was to the same place has shown what
this one could not look into, which is what ``build`` goes on with; and "told", with the readings
that visits near each other suggest to one another. The marks hold for the first and the second.
Corridor level is what ``hssh build`` does by default; door level (``--doors keep``) is shown for
information.

Where rooms have few listed crossings, the pairs of visits compared are those that passed one spot.
The trial took corrected poses only, and of the first log of rooms the visits to listed crossings:
these stand below, as the trial counted them.

Precision is given twice: raw, and with the side openings left out that the list of places lacked,
which truth/corridor_openings.json adds. Pictures show each visit that is wrong by the first, green
where the second leaves it out.
"""

from __future__ import annotations

import json
import resource
import time
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from hssh_kb.build import build
from hssh_kb.kb import KnowledgeBase
from perception.expectation import expect_readings
from perception.mapping import mean_distance_m
from perception.recall import recall_readings
from tests.bench.data import data_path
from tests.bench.pictures import save_sheet
from tests.bench.rate_logs import (
    PlaceRates,
    Stars,
    list_stars,
    pair_visits,
    rate_closures,
    rate_places,
    rate_stars,
)

LOGS = {
    name: ("radish", f"{name}-corrected.log.xz")
    for name in ("aces", "seattle", "infinite-corridor", "intel", "freiburg-079")
} | {"killian": ("killian", "killian-laser.g2o.xz")}
TRIAL = {
    "aces": "1.00  .94-1.00  1.00",
    "seattle": " .90      1.00   .64",
    "infinite-corridor": " .96       .77   .81",
    "intel": " .75         -   .44",
    "freiburg-079": "   -         -   .77",
}
"""Recall, precision and agreement of stars of the trial, its best setting for each log."""
ROOMS = {"intel": 0.44, "freiburg-079": 0.77}
"""Logs of furnished rooms, with the agreement of stars to be bettered."""

TRUTH = Path(__file__).parent / "truth" / "corridor_places.json"
OPENINGS = Path(__file__).parent / "truth" / "corridor_openings.json"
CROP_M, CROP_SCALE = 9.0, 3
MAX_MEAN_M = 0.30
DOOR_LEVEL = ("aces", "seattle")


def run() -> bool:
    """Build every log in both modes and print the tables; False where a figure is missed."""
    truth = json.loads(TRUTH.read_text())
    print(
        f"{'log':18}{'poses':>10}{'scans':>6}{'visits':>7}{'places':>7}{'cpu s':>7}{'drive s':>8}"
        f"{'MB':>5}{'mean m':>7}{'closures P':>11}{'R':>5}{'recall':>7}{'prec.':>6}{'listed':>7}"
        f"{'all':>5}"
        f"{'arms':>5}{'pairs':>6}{'equal':>6}{'2 best':>7}{'recalled':>9}{'2 best':>7}{'told':>5}"
        "   trial: recall, precision, equal"
    )
    print(
        f"{'asked':18}{'':62}{'1.00':>7}{'.80':>5}{'.95':>7}{'.95':>6}{'.95':>7}{'':16}{'.90':>6}{'.98':>7}"
        f"{'.90':>9}{'.98':>7}"
    )
    good = True
    for name, parts in LOGS.items():
        path = data_path("logs", *parts)
        if path is None:
            continue
        for mode in ("corrected", "odometry"):
            good &= _report(name, mode, *_build(path, mode), truth[name])
    print("\ndoor level, for information")
    for name in DOOR_LEVEL:
        path = data_path("logs", *LOGS[name])
        if path is not None:
            _report(name, "corrected", *_build(path, "corrected", doors="keep"), truth[name])
    return good


def _build(path: Path, mode: str, **options: str) -> tuple[KnowledgeBase, list[Stars], float]:
    """Return the knowledge base, the stars as read and as recalled, and the seconds."""
    start = time.process_time()
    with (
        patch("perception.recall.recall_readings", wraps=recall_readings) as recall,
        patch("perception.expectation.expect_readings", wraps=expect_readings) as expect,
    ):
        kb = build(path, poses=mode, **options)
    stars: list[Stars] = [
        [tuple(r.star for r in visit.readings) for visit in stage.call_args.args[0]]
        for stage in (recall, expect)
    ]
    return kb, stars, time.process_time() - start


def _report(
    name: str, mode: str, kb: KnowledgeBase, stars: list[Stars], seconds: float, truth: dict
) -> bool:
    drive = kb.trajectory
    mean = mean_distance_m(drive.poses, drive.corrected)
    drive_s = float(drive.times_s[-1] - drive.times_s[0])
    has_clock = 10 < drive_s < 1e5  # one of the logs has lost its clock
    shown = f"{drive_s:8.0f}" if has_clock else f"{'-':>8}"
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    precision, recall = rate_closures(kb)
    listed = [entry["at"] for entry in json.loads(OPENINGS.read_text()).get(name, [])]
    rates = rate_places(kb, truth, stars[0], listed, stars[1])
    equal, second, told, pairs = rates.equal, rates.second, rates.told, rates.pairs
    recalled = rates.recalled_equal, rates.recalled_second
    if name in ROOMS:
        found = pair_visits(kb)
        equal, second = rate_stars(stars[0], found)
        recalled = rate_stars(stars[1], found)
        told = rate_stars(list_stars(kb), found)[1]
        pairs = len(found)
    print(
        f"{name:18}{mode:>10}{kb.record.scans:6}{len(kb.experience):7}{kb.rows[0].places:7}"
        f"{seconds:7.1f}{shown}{memory_mb:5.0f}{mean:7.2f}{precision:11.2f}{recall:5.2f}"
        f"{rates.recall:7.2f}{rates.precision:6.2f}"
        f"{rates.listed:7.2f}{rates.raw:5.2f}{rates.arms:5.2f}{pairs:6}"
        f"{equal:6.2f}{second:7.2f}{recalled[0]:9.2f}{recalled[1]:7.2f}{told:5.2f}"
        f"   {TRIAL.get(name, '')}",
        flush=True,
    )
    if name in ROOMS:
        print(
            f"{'':18}at listed crossings {rates.pairs} pairs, equal {rates.equal:.2f}", flush=True
        )
    _show_wrong(f"logs_{name}_{mode}_doors_{kb.record.options['doors']}", kb, rates)
    in_time = seconds < (drive_s if has_clock else 0.5 * drive.length_m)  # at 2 m/s
    straight = mode != "corrected" or mean <= MAX_MEAN_M
    closed = mode != "odometry" or (precision == 1.0 and recall >= 0.80)
    if name in ROOMS:
        return in_time and straight and closed and min(equal, recalled[0]) > ROOMS[name]
    return in_time and straight and closed and _reaches(rates)


def _reaches(rates: PlaceRates) -> bool:
    """Tell whether the figures asked of corridors are reached."""
    found = rates.recall >= 0.95 and rates.listed >= 0.95
    equal = min(rates.equal, rates.recalled_equal)
    return found and equal >= 0.90 and min(rates.second, rates.recalled_second) >= 0.98


def _show_wrong(name: str, kb: KnowledgeBase, rates: PlaceRates) -> None:
    """Save the surroundings of each visit that is not at a listed place or opening."""
    raster, pictures = kb.global_map, list[np.ndarray]()
    if raster is None:
        return
    half = round(CROP_M / raster.frame.resolution_m)
    padded = cv2.copyMakeBorder(raster.image, *[half] * 4, cv2.BORDER_CONSTANT, value=205)
    for v, is_listed in rates.wrong:
        scan = int(kb.trajectory.visit_scans[v])
        column, row = (
            round(float(x)) for x in raster.frame.to_pixels(kb.trajectory.poses[scan, :2])
        )
        crop = cv2.cvtColor(
            padded[row : row + 2 * half + 1, column : column + 2 * half + 1], cv2.COLOR_GRAY2BGR
        )
        crop = cv2.resize(crop, None, fx=CROP_SCALE, fy=CROP_SCALE, interpolation=cv2.INTER_NEAREST)
        colour = (0, 160, 0) if is_listed else (0, 0, 255)
        cv2.circle(crop, (half * CROP_SCALE, half * CROP_SCALE), 6, colour, -1)
        x, y = kb.trajectory.corrected[scan, :2]
        cv2.putText(
            crop, f"visit {v}: ({x:.1f}, {y:.1f})", (6, 16), cv2.FONT_HERSHEY_PLAIN, 1.0, colour
        )
        pictures.append(crop)
    path = save_sheet(name, pictures, columns=3)
    if pictures:
        print(f"{'':18}visits at no listed place, green at openings listed since: {path}")
