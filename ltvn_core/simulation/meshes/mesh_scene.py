"""Loads a mesh as a scene: reads and aligns it, detects the floor, divides it into places, marks overhead surfaces.

Reads the folder of a Gibson space too: a mesh with z up, the heights of its floors, and traversability maps. A map has
1 cm per pixel and the world's origin in its middle, x along columns and y along rows; white is free.
"""

import logging
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.meshes.mesh_alignment import (
    StoreyFloor,
    align_z_up,
    detect_floor,
    read_mesh_settings,
    side_doubt,
)
from ltvn_core.simulation.rooms import Room, RoomKind
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.surfaces import Surfaces

GIBSON_MESH = "mesh_z_up.obj"
_PIXELS_PER_METRE = 100
log = logging.getLogger(__name__)
_PLACE_M = 3.5
"""Side in metres of the squares that replace rooms in a tour, because a mesh does not describe its rooms."""
_LEAST_PLACE_M2 = 0.5
"""Least navigable area of a square, in square metres."""
_HIGH_M = 1.3
"""Height in metres above which level surfaces are overhead, except the tops of walls and shelves."""
_LEVEL = 0.3
"""Vertical component of the unit normal of a level surface; small, so that sloping ceilings are included."""
_STOREY_M = 4.0
"""Height in metres above which everything is overhead."""


def find_mesh(folder: Path) -> Path:
    """Return the path of the folder's mesh.

    Raises:
        SceneError: The folder is not in Gibson layout.
    """
    if not (folder / GIBSON_MESH).is_file():
        raise SceneError(
            f"{folder} has no {GIBSON_MESH}, so it is not a scene in Gibson layout. Give a folder with {GIBSON_MESH} "
            "(and, where they exist, floors.txt and floor_trav_0.png), or the mesh file itself."
        )
    return folder / GIBSON_MESH


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
    """The free floor of one storey, from an image. Implements `mesh_alignment.KnownFloor`."""

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


@lru_cache(maxsize=2)
def load_mesh_scene(source: Path) -> Scene:
    """Load a mesh file or a folder in Gibson layout.

    A file `house.json` beside `house.glb` may set `up` ("y" or "z"), `scale` (metres per unit) and `floor_height`.

    Raises:
        SceneError: The mesh cannot be read, or has no floor for a robot.
    """
    if source.name == GIBSON_MESH:
        source = source.parent
    mesh = find_mesh(source) if source.is_dir() else source
    from ltvn_core.simulation.meshes.mesh_file import read_mesh  # Imports trimesh, which takes long.

    settings = read_mesh_settings(mesh)
    content = read_mesh(mesh)
    surfaces = align_z_up(content.surfaces, mesh, settings)
    lying = side_doubt(surfaces, mesh, settings)
    doubts = content.doubts if lying is None else (*content.doubts, lying)
    for doubt in doubts:
        log.warning(doubt)
    heights = floor_heights(source) if source.is_dir() else None
    floor_height_m = heights[0] if heights is not None and settings.floor_height is None else settings.floor_height
    storey = 0
    if heights is not None and floor_height_m is not None:
        storey = int(np.argmin(np.abs(np.array(heights) - floor_height_m)))
    known = traversable_map(source, storey) if source.is_dir() else None
    floor = detect_floor(surfaces.vertices[surfaces.faces].astype(np.float64), str(mesh), floor_height_m, known)
    standing = replace(surfaces, vertices=surfaces.vertices - np.array([0, 0, floor.height_m], np.float32))
    return Scene(
        name=source.name if source.is_dir() else source.stem,
        area_m2=round(floor.area_m2, 2),
        rooms=_places(floor.clearance),
        clearance=floor.clearance,
        surfaces=replace(standing, overhead=_overhead(standing, floor)),
        source=source,
        doubts=doubts,
    )


def _places(clearance: ClearanceMap) -> tuple[Room, ...]:
    """Divide the floor into squares, and leave out those with hardly any navigable floor."""
    rows, columns = np.nonzero(clearance.navigable)
    xy = clearance.origin + (np.column_stack([columns, rows]) + 0.5) * clearance.resolution_m
    low = xy.min(axis=0)
    high = xy.max(axis=0)
    count = np.maximum(np.rint((high - low) / _PLACE_M).astype(int), 1)
    side = (high - low) / count + 1e-6
    tiles, cells = np.unique(np.floor((xy - low) / side).astype(int), axis=0, return_counts=True)
    large = cells * clearance.resolution_m**2 >= _LEAST_PLACE_M2
    corners = low + tiles[large if large.any() else np.ones(len(tiles), bool)] * side
    edges = np.column_stack([corners, corners + side]).tolist()
    return tuple(Room(kind=RoomKind.UNNAMED, x0=x0, y0=y0, x1=x1, y1=y1) for x0, y0, x1, y1 in edges)


def _overhead(surfaces: Surfaces, floor: StoreyFloor) -> NDArray[np.bool_]:
    """Mark (F,) ceilings, lamps and upper storeys, but not the tops of walls and shelves."""
    corners = surfaces.vertices[surfaces.faces]
    lowest = corners[:, :, 2].min(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = np.abs(normal[:, 2]) > _LEVEL * np.linalg.norm(normal, axis=1)
    high = np.flatnonzero(level & (lowest > _HIGH_M))
    samples = np.einsum("sc,fcx->fsx", _INSIDE, corners[high][:, :, :2])
    cell = np.floor((samples - floor.clearance.origin) / floor.clearance.resolution_m).astype(np.intp)
    rows, columns = floor.tall.shape
    on_grid = (cell >= 0).all(-1) & (cell[..., 0] < columns) & (cell[..., 1] < rows)
    tall = floor.tall[cell[..., 1].clip(0, rows - 1), cell[..., 0].clip(0, columns - 1)]
    overhead = lowest > _STOREY_M
    overhead[high] |= ~(tall | ~on_grid).all(axis=1)
    return overhead


def _lattice(steps: int) -> NDArray[np.float32]:
    """Return barycentric weights (S, 3) of points spread over the inside of a triangle."""
    parts = [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]
    return ((np.array(parts, np.float32) + 1 / 3) / (steps + 1)).astype(np.float32)


_INSIDE = _lattice(4)
