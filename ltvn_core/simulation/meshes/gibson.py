"""Reads the folder of a Gibson space: a mesh with z up, the heights of its floors, and traversability maps.

A map has 1 cm per pixel and the world's origin in its middle, x along columns and y along rows; white is free.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError

MESH_FILE = "mesh_z_up.obj"
_PIXELS_PER_METRE = 100


def find_mesh(folder: Path) -> Path:
    """Return the path of the folder's mesh.

    Raises:
        SceneError: The folder is not in Gibson layout.
    """
    if not (folder / MESH_FILE).is_file():
        raise SceneError(
            f"{folder} has no {MESH_FILE}, so it is not a scene in Gibson layout. Give a folder with {MESH_FILE} (and, "
            "where they exist, floors.txt and floor_trav_0.png), or the mesh file itself."
        )
    return folder / MESH_FILE


def floor_heights(folder: Path) -> list[float] | None:
    """Return the heights in metres of `floors.txt` from low to high; None if there is no such file.

    Raises:
        SceneError: The file is not a list of numbers.
    """
    path = folder / "floors.txt"
    if not path.is_file():
        return None
    try:
        heights = sorted(float(word) for word in path.read_text(encoding="utf-8").split())
    except (OSError, ValueError) as error:
        raise SceneError(
            f"{path} must contain one height in metres per line ({error}). Correct it, or remove it."
        ) from error
    if not heights or not np.all(np.isfinite(heights)):
        raise SceneError(f"{path} contains no heights. Write one height in metres per line, or remove it.")
    return heights


class TraversabilityMap:
    """The free floor of one storey, from an image. Implements `floor_detection.KnownFloor`."""

    def __init__(self, path: Path) -> None:
        """Read `floor_trav_N.png`.

        Raises:
            SceneError: The file is not an image.
        """
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise SceneError(f"{path} is not an image. Copy the map of the floor there again, or remove it.")
        self._free = image >= 128

    def __call__(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which cells (rows, columns) at x (columns,) and y (rows,) are free; none outside the map."""
        rows, columns = self._free.shape
        column = np.floor(x_m * _PIXELS_PER_METRE + columns / 2).astype(np.intp)
        row = np.floor(y_m * _PIXELS_PER_METRE + rows / 2).astype(np.intp)
        inside = ((row >= 0) & (row < rows))[:, None] & ((column >= 0) & (column < columns))
        return self._free[np.ix_(row.clip(0, rows - 1), column.clip(0, columns - 1))] & inside


def traversable_map(folder: Path, number: int) -> TraversabilityMap | None:
    """Return the map of a floor, counted from 0 at the lowest; None if there is no such file."""
    path = folder / f"floor_trav_{number}.png"
    return TraversabilityMap(path) if path.is_file() else None
