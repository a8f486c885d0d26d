"""Reading grids from image files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from perception.errors import InputError
from perception.grid import UNKNOWN, Image

MOST_CELLS = 100_000_000
"""Larger images are refused: their skeleton would need about 40 bytes a cell."""


def read_grey_image(path: Path | str, *, most_cells: int = MOST_CELLS) -> Image:
    """Read an image file as a grid.

    Colours become their luminance; 16-bit levels are divided by 257; where an alpha channel
    is less than half opaque the cell is unknown.

    Returns
    -------
    (H, W) uint8, dark occupied, light free; row 0 at the top.

    Raises
    ------
    InputError : the file is missing, a folder, empty, not an image, or too large.
    """
    path = Path(path)
    data = _read_bytes(path)
    raw = None
    try:
        raw = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise InputError(f"{path}: cannot be read as an image ({error.err})") from None
    if raw is None or not raw.size:
        raise InputError(f"{path}: is not an image; expected png, pgm, jpg or another grid image")
    height, width = raw.shape[:2]
    if height * width > most_cells:
        need = 40 * height * width / 1e9
        raise InputError(
            f"{path}: {width} x {height} cells would need about {need:.1f} GB of memory; "
            f"give a smaller image (at most {most_cells} cells) or allow more cells"
        )
    return _to_grey(raw, path)


def _read_bytes(path: Path) -> bytes:
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give an image file")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    if not data:
        raise InputError(f"{path}: is empty; expected an image")
    return data


def _to_grey(raw: np.ndarray, path: Path) -> Image:
    """Return any decoded image as uint8 grey."""
    if raw.dtype == np.uint16:
        raw = np.round(raw / 257.0).astype(np.uint8)
    elif raw.dtype != np.uint8:
        raise InputError(f"{path}: has {raw.dtype} levels; expected 8 or 16 bits a channel")
    if raw.ndim == 2:
        return np.ascontiguousarray(raw)
    channels = raw.shape[2]
    if channels == 1:
        return np.ascontiguousarray(raw[:, :, 0])
    if channels not in (2, 3, 4):
        raise InputError(f"{path}: has {channels} channels; expected grey, colour or alpha")
    grey = raw[:, :, 0].copy() if channels == 2 else cv2.cvtColor(raw[:, :, :3], cv2.COLOR_BGR2GRAY)
    if channels in (2, 4):
        grey[raw[:, :, -1] < 128] = UNKNOWN
    return np.ascontiguousarray(grey)
