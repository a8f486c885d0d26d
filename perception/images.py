"""Reading grids from image files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from perception.errors import InputError
from perception.files import read_bytes
from perception.grid import UNKNOWN, Image
from perception.image_header import ImageHeader, find_damage, read_image_header

MOST_CELLS = 100_000_000
BYTES_A_CELL = 35
"""Memory that reading an image and finding its skeleton takes at most, as measured."""

_KINDS = "png, pgm, pbm, ppm, jpg, bmp, tiff, webp or gif"


def read_grey_image(path: Path | str, *, most_cells: int | None = MOST_CELLS) -> Image:
    """Read an image file as a grid.

    The file may be packed (gzip, xz, bzip2). Colours become their luminance; levels of 16 bits are
    divided by 257 (in a PGM file, scaled by the level it says is white); where an alpha channel is
    less than half opaque, the cell is unknown.

    Parameters
    ----------
    most_cells : larger images are refused before they are decoded; None for no limit.

    Returns
    -------
    (H, W) uint8, dark occupied, light free; row 0 at the top.

    Raises
    ------
    InputError : the file is missing, a folder, empty, not an image of a known kind, cut off or
        damaged, or too large.
    """
    path = Path(path)
    raw, header = load_image(path, lambda header: _check_size(path, header, most_cells))
    return _to_grey(raw, path, header)


def load_image(
    path: Path, check_size: Callable[[ImageHeader], None]
) -> tuple[np.ndarray, ImageHeader]:
    """Decode an image file, packed or not, with the channels and levels it has.

    Parameters
    ----------
    check_size : called with the header before the image is decoded, to refuse what is too large.

    Raises
    ------
    InputError : the file is missing, a folder, empty, not an image of a known kind, cut off or
        damaged.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give an image file")
    data = read_bytes(path)
    header = read_image_header(data)
    if header is None:
        raise InputError(f"{path}: is not an image; expected {_KINDS}")
    check_size(header)
    fault = find_damage(data, header)
    if fault is not None:
        raise InputError(f"{path}: this {header.kind} image is broken: {fault}; get a whole copy")
    quiet = cv2.utils.logging
    level = quiet.getLogLevel()
    quiet.setLogLevel(quiet.LOG_LEVEL_SILENT)
    try:
        raw = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise InputError(f"{path}: cannot be read as an image ({error.err})") from None
    finally:
        quiet.setLogLevel(level)
    if raw is None or not raw.size:
        raise InputError(
            f"{path}: is not an image that can be read: it starts as {header.kind}, but the rest "
            "does not follow; get a whole copy"
        )
    return raw, header


def _check_size(path: Path, header: ImageHeader, most_cells: int | None) -> None:
    cells = header.width * header.height
    if most_cells is not None and cells > most_cells:
        raise InputError(
            f"{path}: {header.width} x {header.height} cells would need about "
            f"{BYTES_A_CELL * cells / 1e9:.1f} GB of memory; give a smaller image (at most "
            f"{most_cells} cells), or force it (--force)"
        )


def _to_grey(raw: np.ndarray, path: Path, header: ImageHeader) -> Image:
    """Return any decoded image as uint8 grey."""
    if raw.dtype == np.uint16:
        white = header.most_level if header.kind == "pnm" and header.most_level else 65535
        raw = np.round(np.minimum(raw, white) * (255.0 / white)).astype(np.uint8)
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
