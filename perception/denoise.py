"""Mending grids whose cells were flipped at random."""

from __future__ import annotations

import math

import cv2
import numpy as np

from perception.grid import Cells, Mask


def estimate_noise(cells: Cells) -> tuple[float, float]:
    """Estimate the share of free cells that were flipped to occupied, and of occupied to free.

    The share is the typical density of a small window in free space, and in walls. A clean grid
    gives 0 for free space, as most windows in its free space hold no obstacle at all.

    Examples
    --------
    >>> import numpy as np
    >>> from perception.grid import classify
    >>> image = np.zeros((90, 90), np.uint8)
    >>> image[30:60, :] = image[:, 30:60] = 255
    >>> estimate_noise(classify(image))
    (0.0, 0.0)

    Source
    ------
    Ours.
    """
    solid = (~cells.free).view(np.uint8)
    known = (~cells.unknown).view(np.uint8) if cells.unknown.any() else None
    side = 5 if min(solid.shape) < 120 else 7
    count = cv2.boxFilter(solid, -1, (side, side), normalize=False, borderType=cv2.BORDER_REPLICATE)
    most = side * side + 1
    levels = cv2.calcHist([count], [0], known, [most], [0, most]).ravel().astype(np.int64)
    if not levels.any():
        return 0.0, 0.0
    split = _split(levels)
    low, high = _middle(levels[:split]), _middle(levels[split:]) + split
    return low / (side * side), 1.0 - high / (side * side)


def _split(levels: np.ndarray) -> int:
    """Return the level that parts a histogram best in two (Otsu); levels below are low."""
    weight = np.cumsum(levels)
    moment = np.cumsum(levels * np.arange(len(levels)))
    total, mean = weight[-1], moment[-1] / weight[-1]
    below = np.maximum(weight, 1)
    spread = (mean * weight - moment) ** 2 / (below * np.maximum(total - weight, 1))
    return int(np.argmax(spread[:-1])) + 1


def _middle(levels: np.ndarray) -> float:
    """Return the median level of a histogram."""
    if not levels.sum():
        return float(len(levels) - 1)
    return float(np.searchsorted(np.cumsum(levels), levels.sum() / 2))


def remove_noise(cells: Cells) -> Cells:
    """Mend a grid whose cells were flipped at random; a clean grid comes back as it was.

    Unknown cells stay unknown.

    Source
    ------
    Ours: a Gaussian vote whose width follows the estimated share of flipped cells.
    """
    flipped, holed = estimate_noise(cells)
    if flipped < 0.03:  # free space is clean; gaps in walls are not for a vote to close
        return cells
    solid = (~cells.free).astype(np.float32)
    sigma = (0.8 + 4.0 * max(flipped, holed) ** 2) * (1.0 if min(solid.shape) >= 120 else 0.8)
    smooth = cv2.GaussianBlur(solid, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
    occupied = (smooth > (flipped + 1.0 - holed) / 2) & ~cells.unknown
    _clear_specks(occupied, 10.0 * sigma**2)
    return Cells(occupied, ~(occupied | cells.unknown), cells.unknown)


def mend_walls(cells: Cells) -> Cells:
    """Close the gaps of walls that lack cells at random; a grid of whole walls is left alone.

    The share q of missing cells is read off how often, in a row of three, the middle one is
    missing; gaps are closed up to the length that is still to be expected somewhere.

    Source
    ------
    Ours.
    """
    occupied = cells.occupied
    whole = missing = 0
    middle = occupied[1:-1, 1:-1]
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        height, width = middle.shape
        ahead = occupied[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        behind = occupied[1 - dy : 1 - dy + height, 1 - dx : 1 - dx + width]
        pairs = ahead & behind
        both = int(np.count_nonzero(pairs & middle))
        whole, missing = whole + both, missing + int(np.count_nonzero(pairs)) - both
    share = missing / max(whole + missing, 1)
    if share < 0.02 or missing < 5:
        return cells
    expected = math.log(0.05 / (whole + missing)) / math.log(min(share, 0.6))
    gap = min(math.ceil(1.5 * expected) + 1, min(occupied.shape) // 12)
    side = gap // 2 * 2 + 1  # odd: the closing by an even one shifts walls and leaves gaps
    shape = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    closed = cv2.morphologyEx(occupied.view(np.uint8), cv2.MORPH_CLOSE, shape).astype(bool)
    return Cells(closed, cells.free & ~closed, cells.unknown & ~closed)


def _clear_specks(mask: Mask, most_cells: float) -> None:
    """Clear the groups of set cells that cover no more than a number of cells, in place.

    The cells within a contour are counted by Pick's theorem.
    """
    image = mask.view(np.uint8)
    found, hierarchy = cv2.findContours(image, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    specks = [
        contour
        for contour, (_, _, _, parent) in zip(found, _links(hierarchy), strict=True)
        if parent < 0
        and len(contour) <= 2 * most_cells
        and cv2.contourArea(contour) + len(contour) / 2 + 1 <= most_cells
    ]
    if specks:
        cv2.drawContours(image, specks, -1, 0, cv2.FILLED)


def _links(hierarchy: np.ndarray | None) -> list[list[int]]:
    """Return next, previous, child and parent of each contour; empty if there is none."""
    return [] if hierarchy is None else hierarchy[0].tolist()
