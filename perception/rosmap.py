"""ROS maps: a yaml file with resolution, origin and thresholds, and the image it names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from perception.errors import InputError
from perception.files import read_bytes
from perception.geometry import Array
from perception.grid import FREE, OCCUPIED, UNKNOWN, Frame, Image
from perception.image_header import ImageHeader
from perception.images import load_image

MOST_CELLS = 60_000_000
BYTES_A_CELL = 30
"""Memory that exploring a map takes: twice what a floor of 4 million cells took."""

_MOST_YAML_BYTES = 1 << 20
_PACKED = (".xz", ".gz", ".bz2")
_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
_NEEDED = ("image", "resolution", "origin")
_MODES = ("trinary", "scale", "raw")


@dataclass(frozen=True, eq=False)
class RosMap:
    """A finished occupancy grid.

    Attributes
    ----------
    source, image_path : the yaml file and the image.
    image : (H, W) uint8 of OCCUPIED, UNKNOWN and FREE; row 0 at the top, upright in the map frame.
    frame : where it lies in the map frame.
    source_shape : rows and columns of the image file.
    origin : pose of the lower left corner of the image file in the map frame; m, m, rad.
    notices : remarks of the reader that the user should see.
    """

    source: str
    image_path: str
    image: Image
    frame: Frame
    source_shape: tuple[int, int]
    origin: tuple[float, float, float]
    notices: tuple[str, ...] = ()

    def pixels_to_metres(self, points_px: Array) -> Array:
        """Carry points (n, 2) of the image file (column, row; edges of pixels) to the map frame."""
        points = np.asarray(points_px, float).reshape(-1, 2)
        height = self.source_shape[0]
        local = np.column_stack([points[:, 0], height - points[:, 1]]) * self.frame.resolution_m
        x, y, yaw = self.origin
        c, s = math.cos(yaw), math.sin(yaw)
        return np.asarray(local @ np.array([[c, s], [-s, c]]) + np.array([x, y]))


@dataclass(frozen=True)
class _Header:
    image: str
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool
    occupied: float
    free: float
    mode: str


def read_ros_map(path: str | Path, *, force: bool = False) -> RosMap:
    """Read a ROS map.

    Parameters
    ----------
    path : the yaml file. The image is looked for beside it, also packed as ``NAME.xz``, ``.gz`` or
        ``.bz2``.
    force : read images of more than 60 million cells too.

    Raises
    ------
    InputError : a file is missing or cannot be read, or the yaml breaks the format (all its faults
        in one message); the image is too large, one cell wide, or has nothing free in it.

    Source
    ------
    The format of ROS map_server: occupancy is 1 - level / 255, or level / 255 with ``negate``.
    Graded cells of mode ``scale`` are read by ROS's usual thresholds 0.65 and 0.196 (ours).
    """
    path = Path(path)
    header = _parse_header(path)
    image_path = _find_image(path, header.image)
    levels, opaque, notices = _read_levels(image_path, force)
    cells = _classify(levels, opaque, header)
    _check_cells(cells, path, image_path, header)
    height, width = cells.shape
    image, frame = _make_upright(cells, header)
    return RosMap(
        str(path), str(image_path), image, frame, (height, width), header.origin, tuple(notices)
    )


def load_yaml(path: Path, most_bytes: int) -> Any:  # noqa: ANN401
    """Read a yaml file with one document.

    Raises
    ------
    InputError : missing, too long, no text or no yaml.
    """
    data = read_bytes(path)
    if len(data) > most_bytes:
        raise InputError(f"{path}: {len(data)} bytes are too many; expected at most {most_bytes}")
    try:
        return yaml.safe_load(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8 text; expected yaml") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error) or "nested too deeply"
        raise InputError(f"{path}{where}: not valid yaml ({problem})") from None


def _parse_header(path: Path) -> _Header:
    """Read the yaml file; all its faults in one message."""
    data = load_yaml(path, _MOST_YAML_BYTES)
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected the keys of a ROS map, {', '.join(_KEYS)}")
    faults = [f"'{key}' is missing" for key in _NEEDED if key not in data]
    image = data.get("image", "?")
    if not isinstance(image, str) or not image.strip():
        faults.append(f"'image' must be the name of a file, found {image!r}")
    resolution = _as_number(data.get("resolution", 1.0))
    if resolution is None or resolution <= 0:
        faults.append(
            f"'resolution' must be metres a cell, more than 0, found {data['resolution']!r}"
        )
    origin = data.get("origin", [0, 0, 0])
    pose = [_as_number(v) for v in origin] if isinstance(origin, list) else []
    if len(pose) not in (2, 3) or None in pose:
        faults.append(f"'origin' must be [x, y, yaw] in metres and radians, found {origin!r}")
    negate = data.get("negate", 0)
    if not isinstance(negate, int) or negate not in (0, 1):
        faults.append(f"'negate' must be 0 or 1, found {negate!r}")
    occupied = _as_number(data.get("occupied_thresh", 0.65))
    free = _as_number(data.get("free_thresh", 0.196))
    for key, value in (("occupied_thresh", occupied), ("free_thresh", free)):
        if value is None or not 0 <= value <= 1:
            faults.append(f"'{key}' must be between 0 and 1, found {data.get(key)!r}")
    if occupied is not None and free is not None and free >= occupied:
        faults.append(f"'free_thresh' ({free:g}) must be below 'occupied_thresh' ({occupied:g})")
    mode = data.get("mode", "trinary")
    if mode not in _MODES:
        faults.append(f"'mode' must be {', '.join(_MODES[:-1])} or {_MODES[-1]}, found {mode!r}")
    if faults:
        raise InputError(f"{path}: {'; '.join(faults)}")
    x, y, yaw = (*[v or 0.0 for v in pose], 0.0)[:3]
    return _Header(
        image.strip(),
        resolution or 1.0,
        (x, y, yaw),
        bool(negate),
        occupied or 0.0,
        free or 0.0,
        mode,
    )


def _as_number(value: Any) -> float | None:  # noqa: ANN401
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def _find_image(path: Path, name: str) -> Path:
    """Return the image file; it must lie in the folder of the yaml file or below."""
    folder = path.parent.resolve()
    image = folder / name
    for found in (image, *(image.with_name(image.name + ending) for ending in _PACKED)):
        resolved = found.resolve()
        if not resolved.is_relative_to(folder):
            raise InputError(
                f"{path}: 'image' names {name}, outside the folder of the yaml file; put the image "
                "beside it and name it without a folder"
            )
        if resolved.is_file():
            return path.parent / resolved.relative_to(folder)
    raise InputError(f"{path}: 'image' names {name}, but there is no such file in {path.parent}")


def _read_levels(
    path: Path, force: bool
) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None, list[str]]:
    """Return the grey levels of an image, where it is opaque (None: everywhere), and notices."""
    raw, _ = load_image(path, lambda header: _check_size(path, header, force=force))
    notices = []
    if raw.dtype == np.uint16:
        notices.append(f"{path}: 16 bits a level; they are read as 8")
        raw = np.round(raw / 257.0).astype(np.uint8)
    if raw.dtype != np.uint8:
        raise InputError(f"{path}: has levels of type {raw.dtype}; expected 8 or 16 bits")
    opaque = None
    if raw.ndim == 3 and raw.shape[2] in (2, 4):
        opaque = raw[:, :, -1] >= 128
        raw = raw[:, :, :-1]
        if not opaque.all():
            notices.append(f"{path}: {int((~opaque).sum())} transparent cells are read as unknown")
    if raw.ndim == 3:
        raw = np.round(raw.mean(axis=2))
    return np.asarray(raw, np.uint8), opaque, notices


def _check_size(path: Path, header: ImageHeader, *, force: bool) -> None:
    width, height = header.width, header.height
    if width * height > MOST_CELLS and not force:
        need = BYTES_A_CELL * width * height / 1e9
        raise InputError(
            f"{path}: {width} x {height} cells would need about {need:.1f} GB of memory; use a "
            "coarser map or a part of it, or force it (--force)"
        )
    if min(width, height) < 3:
        raise InputError(f"{path}: {width} x {height} cells are no map; expected at least 3 x 3")


def _classify(
    levels: NDArray[np.uint8], opaque: NDArray[np.bool_] | None, header: _Header
) -> Image:
    """Return the cells as OCCUPIED, UNKNOWN and FREE, by a table over the 256 levels."""
    level = np.arange(256, dtype=float)
    if header.negate:
        level = 255.0 - level
    table = np.full(256, UNKNOWN, np.uint8)
    if header.mode == "raw":
        percent = np.where(level <= 100, level, np.nan)
        table[percent >= 65] = OCCUPIED
        table[percent <= 19.6] = FREE
    else:
        occupancy = 1.0 - level / 255.0
        table[occupancy > header.occupied] = OCCUPIED
        table[occupancy < header.free] = FREE
        if header.mode == "scale":
            graded = (occupancy - header.free) / (header.occupied - header.free)
            table[graded >= 0.65] = OCCUPIED
            table[graded <= 0.196] = FREE
    cells = np.take(table, levels)
    if opaque is not None:
        cells[~opaque] = UNKNOWN
    return np.ascontiguousarray(cells)


def _check_cells(cells: Image, path: Path, image_path: Path, header: _Header) -> None:
    if (cells == FREE).any():
        return
    kind = {OCCUPIED: "occupied", UNKNOWN: "unknown"}.get(int(cells[0, 0]), "unknown")
    what = (
        f"every cell of {image_path.name} is {kind}"
        if (cells == cells[0, 0]).all()
        else (f"no cell of {image_path.name} is free")
    )
    raise InputError(
        f"{path}: {what} by its thresholds (free below {header.free:g}, occupied above "
        f"{header.occupied:g}, negate {int(header.negate)}, mode {header.mode}); correct them"
    )


def _make_upright(cells: Image, header: _Header) -> tuple[Image, Frame]:
    """Return the cells with their axes along the map frame; turned cells are resampled."""
    x, y, yaw = header.origin
    resolution = header.resolution_m
    height, width = cells.shape
    if abs(math.remainder(yaw, 2 * math.pi)) < 1e-9:
        return cells, Frame(x, y + height * resolution, resolution)
    c, s = math.cos(yaw), math.sin(yaw)
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]], float) * resolution
    turned = corners @ np.array([[c, s], [-s, c]]) + np.array([x, y])
    low, high = turned.min(axis=0), turned.max(axis=0)
    columns, rows = (int(v) for v in np.ceil((high - low) / resolution - 1e-9))
    frame = Frame(float(low[0]), float(low[1]) + rows * resolution, resolution)
    target = frame.to_metres(np.array([[0, 0], [1, 0], [0, 1]], float))
    local = (target - np.array([x, y])) @ np.array([[c, -s], [s, c]]) / resolution
    source = np.column_stack([local[:, 0] - 0.5, height - local[:, 1] - 0.5])
    matrix = np.column_stack([source[1] - source[0], source[2] - source[0], source[0]])
    upright = cv2.warpAffine(
        cells,
        matrix,
        (columns, rows),
        flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=UNKNOWN,
    )
    return np.asarray(upright, np.uint8), frame
