"""Stars by our skeleton and by those of scikit-image, on the same images, noise level by level.

Needs the extra ``bench`` (scikit-image, sknw). The peers get the image as it is and, beside that,
mended by our own removal of noise and small islands; see :mod:`tests.bench.skeleton_peers` for what
else they get. The public C++ program evg-thin is not run: the times it took for the skeleton alone,
on a machine of this class, are quoted beside ours for the whole way to the star of the same images.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from perception.denoise import remove_noise
from perception.grid import classify
from perception.star import Star
from perception.topology import local_topology
from tests.bench.data import data_path
from tests.bench.floor_truth import read_levels
from tests.bench.skeleton_peers import read_peer_star
from tests.perception.corpus import PLUS, SHAPES, Shape, draw_fine, flip, scale, shape_corpus

LEVELS = (0, 5, 10, 20, 30, 40, 50)
EVG_THIN_S = {
    "evg_thin/test1.pgm.xz": 0.042,
    "evg_thin/test2.pgm.xz": 0.042,
    "ipa_room_segmentation/Freiburg52_scan.png": 0.11,
    "ipa_room_segmentation/lab_intel.png": 0.29,
    "ipa_room_segmentation/lab_a_scan.png": 0.26,
    "ipa_room_segmentation/lab_ipa.png": 0.18,
    "ipa_room_segmentation/NLB.png": 0.63,
    "ipa_room_segmentation/Freiburg101_scan.png": 0.97,
    "ipa_room_segmentation/office_i.png": 3.1,
}
"""The best of its times for a skeleton, in seconds."""
MOST_RAW = 10
"""Without mending, more noise than this gives graphs of ten thousand junctions and no star."""
Chain = Callable[[np.ndarray], Star]


def run() -> bool:
    """Print accuracy by noise level and time; ours is to be ahead, and within 1.5 x the time."""
    cv2.setNumThreads(1)
    good = _compare_with_evg_thin()
    try:
        chains = _make_chains()
    except ImportError as error:
        print(f"left out: {error.name} is not installed (pip install '.[bench]')")
        return good
    good &= _compare("+, 10 turns x 3 sizes", (PLUS,), range(0, 50, 5), (99, 199, 299), chains)
    good &= _compare("ten other shapes, 3 turns, 240 cells", SHAPES, (0, 25, 70), (240,), chains)
    return good & _compare_times(chains)


def _compare_with_evg_thin() -> bool:
    """Time the widest spot of public maps, image to star, beside a skeleton by evg-thin."""
    print(f"{'CPU ms':44s} {'cells':>12s} {'ours, to star':>14s} {'evg-thin':>9s}")
    good = True
    for name, published_s in EVG_THIN_S.items():
        path = data_path("maps", *name.split("/"))
        if path is None:
            continue
        image = read_levels(path)
        clearance = cv2.distanceTransform(classify(image).free.view(np.uint8), cv2.DIST_L2, 5)
        row, column = np.unravel_index(int(clearance.argmax()), clearance.shape)
        ours = _time(lambda grid, at=(column, row): local_topology(grid, robot_px=at), image, 5)
        good &= ours <= 1.5e3 * published_s
        size = "{1} x {0}".format(*image.shape)
        print(f"{name:44s} {size:>12s} {ours:14.1f} {1e3 * published_s:9.0f}")
    return good


def _make_chains() -> dict[str, Chain]:
    import sknw  # noqa: F401
    from skimage.morphology import medial_axis, skeletonize

    chains: dict[str, Chain] = {"ours": lambda image: local_topology(image).star}
    for name, find in (("skeletonize", skeletonize), ("medial_axis", medial_axis)):
        for label, mend, pruned in (
            ("", False, False),
            (", mended", True, False),
            (", mended, pruned", True, True),
        ):
            chains[f"{name}{label}"] = _make_chain(find, mend, pruned)
    return chains


def _make_chain(find: Callable[[np.ndarray], np.ndarray], mend: bool, pruned: bool) -> Chain:
    def read(image: np.ndarray) -> Star:
        free = _mend(image) if mend else image > 0
        return read_peer_star(free, find, pruned=pruned)

    return read


def _mend(image: np.ndarray) -> np.ndarray:
    """Return the free cells after our removal of noise, without islands off the border."""
    free = remove_noise(classify(image)).free
    solid = (~free).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(solid, connectivity=8)
    most = min(image.shape) / 5
    x, y, w, h = stats[:count, :4].T
    inner = (x > 0) & (y > 0) & (x + w < image.shape[1]) & (y + h < image.shape[0])
    island = inner & (np.maximum(w, h) < most)
    island[0] = False
    return free | island[labels]


def _takes_noise(name: str) -> bool:
    return name == "ours" or "mended" in name


def _compare(
    title: str,
    shapes: Sequence[Shape],
    turns: Sequence[int],
    sides: Sequence[int],
    chains: dict[str, Chain],
) -> bool:
    print(f"\n{title + ': right stars, %, at noise of':44s}", *(f"{n:>4d} %" for n in LEVELS))
    count = len(shapes) * len(turns) * len(sides)
    shares: dict[str, list[float]] = {}
    for name, read in chains.items():
        levels = [n for n in LEVELS if n <= MOST_RAW or _takes_noise(name)]
        right = dict.fromkeys(levels, 0)
        for shape in shapes:
            for image, _, _, percent in shape_corpus(shape, turns, sides, levels, seed=(11,)):
                right[percent] += bool(read(image).isomorphisms(shape.truth))
        shares[name] = [100 * right[n] / count for n in levels]
        print(f"{name:44s}", *(f"{share:6.1f}" for share in shares[name]), flush=True)
    good = all(
        ours >= peer and (ours > peer or ours == 100)
        for name in chains
        for ours, peer in zip(shares["ours"], shares[name], strict=False)
        if name != "ours"
    )
    print("ahead of each peer at every level" if good else "MISSED: a peer is ahead somewhere")
    return good


def _compare_times(chains: dict[str, Chain]) -> bool:
    print(f"\n{'CPU ms, 300 x 300, image to star':44s} {'clean':>6s} {'20 %':>6s}")
    clean = scale(draw_fine(PLUS, 20), 300)
    noisy = flip(clean, 0.2, np.random.default_rng(1))
    found = {}
    for name, read in chains.items():
        images = (clean, noisy) if _takes_noise(name) else (clean,)
        found[name] = [_time(read, image) for image in images]
        print(f"{name:44s}", *(f"{ms:6.1f}" for ms in found[name]), flush=True)
    return all(
        ours <= 1.5 * peer
        for name in chains
        for ours, peer in zip(found["ours"], found[name], strict=False)
    )


def _time(read: Callable[[np.ndarray], object], image: np.ndarray, repeats: int = 15) -> float:
    """Return the least CPU milliseconds of some runs."""
    best = np.inf
    for _ in range(repeats):
        started = time.process_time()
        read(image)
        best = min(best, time.process_time() - started)
    return 1e3 * float(best)


if __name__ == "__main__":
    raise SystemExit(not run())
