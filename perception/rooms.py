"""Names of rooms: polygons by name, from a file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from perception.errors import InputError
from perception.geometry import Array
from perception.rosmap import RosMap, load_yaml

_MOST_BYTES = 16 << 20


def read_rooms(path: str | Path, ros_map: RosMap) -> dict[str, list[Array]]:
    """Read the polygons of rooms in the map frame.

    Two forms are read: ``locations`` and ``polygons``, lists of names and of corners
    ``[x1, y1, x2, y2, ...]`` in pixels of the image, y down (what the BWI robots use); or
    ``rooms``, a mapping of names to corners ``[[x, y], ...]`` in the map frame, metres.

    Parameters
    ----------
    path : a yaml or JSON file.
    ros_map : the map that the pixels are of.

    Returns
    -------
    (n, 2) polygons by name; a name may have several.

    Raises
    ------
    InputError : the file cannot be read or has another form; all faults in one message.
    """
    path = Path(path)
    data = load_yaml(path, _MOST_BYTES)
    if isinstance(data, dict) and "polygons" in data:
        pairs, pixels = _pair_lists(path, data), True
    elif isinstance(data, dict) and isinstance(data.get("rooms"), dict):
        pairs, pixels = list(data["rooms"].items()), False
    else:
        raise InputError(
            f"{path}: expected 'locations' and 'polygons' (pixels), or 'rooms', a mapping of names "
            "to corners [[x, y], ...] in metres"
        )
    rooms: dict[str, list[Array]] = {}
    faults = []
    for number, (name, corners) in enumerate(pairs, 1):
        points = _as_points(corners, flat=pixels)
        if not isinstance(name, str | int) or isinstance(name, bool):
            faults.append(f"room {number}: its name is {name!r}, expected a text")
        elif points is None:
            faults.append(f"room {number} ({name}): expected at least 3 corners, as numbers")
        else:
            metres = ros_map.pixels_to_metres(points) if pixels else points
            rooms.setdefault(str(name), []).append(metres)
    if faults:
        more = f"; and {len(faults) - 10} more" if len(faults) > 10 else ""
        raise InputError(f"{path}: {'; '.join(faults[:10])}{more}")
    return rooms


def _pair_lists(path: Path, data: dict[str, Any]) -> list[tuple[Any, Any]]:
    names, polygons = data.get("locations"), data["polygons"]
    if not isinstance(names, list) or not isinstance(polygons, list) or len(names) != len(polygons):
        raise InputError(
            f"{path}: 'locations' and 'polygons' must be lists of the same length, a name for each "
            "polygon"
        )
    return list(zip(names, polygons, strict=True))


def _as_points(corners: Any, *, flat: bool) -> Array | None:  # noqa: ANN401
    """Return corners as (n, 2), None if they are no polygon."""
    try:
        points = np.array(corners, float)
    except (TypeError, ValueError):
        return None
    if flat and points.ndim == 1 and len(points) % 2 == 0:
        points = points.reshape(-1, 2)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        return None
    return points if math.isfinite(float(np.abs(points).sum())) else None
