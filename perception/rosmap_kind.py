"""Telling a ROS map from other files, without the libraries that reading it takes."""

from __future__ import annotations

import re
from pathlib import Path

_KEY = re.compile(rb"^[ \t]*(image|resolution|origin|occupied_thresh)[ \t]*:", re.MULTILINE)


def looks_like_ros_map(path: str | Path) -> bool:
    """Tell a ROS map by its first lines: a yaml file that names an image and a resolution."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(4096)
    except OSError:
        return False
    if b"\0" in head:
        return False
    keys = len(set(_KEY.findall(head)))
    return keys >= 2 or Path(path).suffix.lower() in (".yaml", ".yml")
