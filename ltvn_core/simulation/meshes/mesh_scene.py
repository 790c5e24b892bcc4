"""Loads a mesh as a scene: read, align, detect the floor, divide it into places to visit, mark what is overhead."""

import logging
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.meshes import gibson
from ltvn_core.simulation.meshes.floor_detection import StoreyFloor, detect_floor
from ltvn_core.simulation.meshes.mesh_alignment import align_z_up, read_mesh_settings
from ltvn_core.simulation.meshes.mesh_file import read_mesh
from ltvn_core.simulation.rooms import Room, RoomKind
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.surfaces import Surfaces

log = logging.getLogger(__name__)

_PLACE_M = 3.5
"""Side of the squares that stand for rooms in a tour, because a mesh does not say where its rooms are."""
_LEAST_PLACE_M2 = 0.5
"""Navigable area that a square needs."""
_HIGH_M = 1.3
"""Level surfaces higher than this are overhead, except on top of walls and shelves."""
_LEVEL = 0.3
"""Vertical component of the unit normal of a level surface; small, so that sloping ceilings are included."""
_STOREY_M = 4.0
"""Everything higher than this is overhead."""


@lru_cache(maxsize=2)
def load_mesh_scene(source: Path) -> Scene:
    """Load a mesh file or a folder in Gibson layout.

    A file `house.json` beside `house.glb` may set `up` ("y" or "z"), `scale` (metres per unit) and `floor_height`.

    Raises:
        SceneError: The mesh cannot be read, or has no floor for a robot.
    """
    if source.name == gibson.MESH_FILE:
        source = source.parent
    mesh = gibson.find_mesh(source) if source.is_dir() else source
    settings = read_mesh_settings(mesh)
    content = read_mesh(mesh)
    for doubt in content.doubts:
        log.warning(doubt)
    surfaces = align_z_up(content.surfaces, mesh, settings)
    heights = gibson.floor_heights(source) if source.is_dir() else None
    floor_height_m = heights[0] if heights is not None and settings.floor_height is None else settings.floor_height
    storey = 0
    if heights is not None and floor_height_m is not None:
        storey = int(np.argmin(np.abs(np.array(heights) - floor_height_m)))
    known = gibson.traversable_map(source, storey) if source.is_dir() else None
    floor = detect_floor(surfaces.vertices[surfaces.faces].astype(np.float64), str(mesh), floor_height_m, known)
    standing = replace(surfaces, vertices=surfaces.vertices - np.array([0, 0, floor.height_m], np.float32))
    return Scene(
        name=source.name if source.is_dir() else source.stem,
        area_m2=round(floor.area_m2, 2),
        rooms=_places(floor.clearance),
        clearance=floor.clearance,
        surfaces=replace(standing, overhead=_overhead(standing, floor)),
        source=source,
        doubts=content.doubts,
    )


def _places(clearance: ClearanceMap) -> tuple[Room, ...]:
    """Divide the floor into squares, and leave out those with hardly any navigable floor."""
    rows, columns = np.nonzero(clearance.navigable)
    xy = clearance.origin + (np.column_stack([columns, rows]) + 0.5) * clearance.resolution_m
    low, high = xy.min(axis=0), xy.max(axis=0)
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
