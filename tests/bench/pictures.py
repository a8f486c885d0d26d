"""Pictures that benchmarks leave behind to be looked at, in build/bench (not committed)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

FOLDER = Path(__file__).resolve().parents[2] / "build" / "bench"


def save_sheet(name: str, pictures: Sequence[np.ndarray], columns: int = 4) -> Path:
    """Put pictures side by side into one PNG, or remove an old one if there are none."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = FOLDER / f"{name}.png"
    path.unlink(missing_ok=True)
    if pictures:
        height, width = (max(p.shape[k] for p in pictures) for k in (0, 1))
        padded = [
            cv2.copyMakeBorder(
                p, 0, height - p.shape[0], 0, width - p.shape[1], 0, value=(255, 255, 255)
            )
            for p in pictures
        ]
        padded += [np.full_like(padded[0], 255)] * (-len(padded) % columns)
        rows = [np.hstack(padded[k : k + columns]) for k in range(0, len(padded), columns)]
        cv2.imwrite(str(path), np.vstack(rows))
    return path
