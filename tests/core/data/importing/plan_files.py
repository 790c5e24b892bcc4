"""Small floor plans as nav2's map saver leaves them."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.data.importing.floor_plan_alignment import LaidFloorPlan

FREE, GREY, WALL = 254, 205, 0
SAID = """\
image: map.pgm
mode: trinary
resolution: 0.5
origin: [-1.0, 2.0, 0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def room() -> NDArray[np.uint8]:
    """Return 4 rows of 6 pixels: free, with a wall at the left of the upper row and one unknown at its right."""
    grey = np.full((4, 6), FREE, np.uint8)
    grey[0, 0] = WALL
    grey[0, 5] = GREY
    return grey


def write_plan(folder: Path, said: str = SAID, *, grey: NDArray[np.uint8] | None = None) -> Path:
    """Write `map.yaml` and `map.pgm` (H, W), by default `room()`; return the former."""
    pixels = room() if grey is None else grey
    height, width = pixels.shape
    (folder / "map.pgm").write_bytes(f"P5\n# CREATOR: map_saver\n{width} {height}\n255\n".encode() + pixels.tobytes())
    path = folder / "map.yaml"
    path.write_text(said, encoding="utf-8")
    return path


def laid_room() -> LaidFloorPlan:
    """Return a free floor of 8 m x 6 m with a wall around it, whose frame is that of the map."""
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return LaidFloorPlan(FloorPlan(cells, 0.1, np.array([-1.0, -1.0, 0.0])), np.zeros(3))


def write_png(folder: Path) -> None:
    """Write `room()` as `map.png`."""
    cv2.imwrite(str(folder / "map.png"), room())
