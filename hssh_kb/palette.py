"""Colours: of paths, distinct for the colour-blind; of the rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hssh_kb.place_graph import PlaceGraph
from perception.grid import Image, classify

INK, PAPER, BLOCKED, DRIVE, ROUTE = "#1b1f24", "#ffffff", "#8a919c", "#97a0ac", "#ffc83d"
STUB = "#8a919c"

# Okabe and Ito's set without black and yellow (the route's), then darker kin of the same hues.
PATH_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#8c510a",
    "#5e3c99",
    "#00747a",
    "#b2182b",
    "#7f7f00",
)
_WALL, _FREE, _UNKNOWN = (58, 66, 79), (255, 255, 255), (236, 238, 241)


class Palette:
    """Gives every travelled path a colour; they repeat when there are more paths than colours."""

    def __init__(self, graph: PlaceGraph) -> None:
        travelled = [path.name for path in graph.paths if path.travelled]
        self._colours = {
            name: PATH_COLOURS[i % len(PATH_COLOURS)] for i, name in enumerate(travelled)
        }

    def colour(self, path: str) -> str:
        """Return the colour of a path; grey if it was never travelled."""
        return self._colours.get(path, STUB)


def paint_grid(image: Image) -> NDArray[np.uint8]:
    """Return a grid (H, W) as RGB (H, W, 3): corridors white, walls dark, the unknown pale.

    Examples
    --------
    >>> paint_grid(np.array([[0, 205, 254]], np.uint8))[0].tolist()
    [[58, 66, 79], [236, 238, 241], [255, 255, 255]]
    """
    cells = classify(image)
    painted = np.empty((*image.shape, 3), np.uint8)
    painted[cells.unknown] = _UNKNOWN
    painted[cells.free] = _FREE
    painted[cells.occupied] = _WALL
    return painted
