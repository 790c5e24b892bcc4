"""Alignment of a mesh, with z up and lengths in metres, and detection of its floor.

Reads the settings that a user may write beside a mesh (`house.json` for `house.glb`), and estimates the upward axis
without them. GLB files of Habitat and Gibson have z up although the standard says y, so the estimate uses the geometry
in every format. Detects the height of the floor and the free cells on it: which level surface is a floor and not a
table or a roof, and which cells are indoors.
"""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.simulation.triangle_rasterization import Mask, RasterGrid, Triangles, clip_to_heights
from ltvn_core.structured_text import parse_json

log = logging.getLogger(__name__)
_SURE = 1.3
"""Least ratio of level areas, other axis to standard axis of the file format, at which the other axis points up."""
_SLAB_M = 0.1
"""Thickness of a slab, in metres."""
_LEAST_SPAN_M = 1.0
_MOST_SPAN_M = 150.0
_MOST_HEIGHT_M = 40.0
_MOST_DISTANCE_M = 10_000.0
"""Largest distance of a mesh from its origin, in metres; vertices with 32 bits are exact to a millimetre there."""
_STOREY_M = (2.0, 4.0)
"""Usual height of a storey, least and greatest, in metres."""
_HIGH_STOREY_M = 4.5
"""Height in metres above which a mesh is more than one usual storey."""
_ADVICE = "docs/how-to/change-the-world.md tells how to correct a mesh."
CELL_M = 0.05
"""Side of a cell of the clearance map."""
_FINE = 2
"""Subdivisions of a cell's side when triangles are rasterized."""
_STEP_M = 0.06
"""Height above the floor below which surfaces are not obstacles (rugs, thresholds, noise of scans), in metres."""
_HOLLOW_M = 0.1
"""Greatest depth below the floor's height at which surfaces still belong to the floor, in metres."""
_CEILING_M = 1.8
"""Least height above the floor of surfaces that are ceilings, in metres."""
_HOLE_M = 0.5
"""Half of the greatest width of a ceiling's hole that is ignored, in metres; the floor below it counts as indoors."""
_ROOFED_SHARE = 0.3
"""Least share of the free floor under a ceiling; with less, the mesh counts as having no ceiling, and walls decide what
is indoors."""
_LEVEL = 0.9
"""Vertical component of the unit normal above which a surface is level enough to be a floor."""
_CANDIDATES = 6
"""Maximum number of heights that are examined."""
_LEAST_FLOOR_M2 = 1.0
"""Least navigable area of a floor, in square metres."""
_START_CLEARANCE_M = 0.4
"""Least clearance in metres of the widest place of a floor, so that a robot can turn there."""
_GROUND_SHARE = 0.5
"""Least share of the floor in a map that must exist in the mesh, too; scans have holes, but not over half of the
floor."""
KnownFloor = Callable[[NDArray[np.float64], NDArray[np.float64]], Mask]
"""Returns for x (columns,) and y (rows,) in metres which cells (rows, columns) are known to be free floor."""


@dataclass(frozen=True, slots=True)
class MeshSettings:
    """Settings in the JSON file beside a mesh; the names are keys of that file."""

    up: str | None = None
    """The axis that points up, `y` or `z`."""
    scale: float = 1.0
    """Metres per unit of the file."""
    floor_height: float | None = None
    """Height of the floor in metres above the file's origin."""


def read_mesh_settings(mesh: Path) -> MeshSettings:
    """Read the JSON file beside a mesh; without one, return the defaults.

    Raises:
        SceneError: The file is not JSON, or a value is not valid.
    """
    path = mesh.with_suffix(".json")
    if not path.is_file():
        return MeshSettings()
    try:
        content: Any = parse_json(path.read_text(encoding="utf-8"))
        floor = content.get("floor_height")
        settings = MeshSettings(
            up=content.get("up"),
            scale=_number(content.get("scale", 1.0)),
            floor_height=None if floor is None else _number(floor),
        )
    except (OSError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise SceneError(f'{path} cannot be read ({error}). Write for instance {{"up": "z", "scale": 1.0}}.') from error
    if notes := content.keys() - {field.name for field in fields(MeshSettings)}:
        log.info("%s: only up, scale and floor_height are settings; not read: %s.", path, ", ".join(sorted(notes)))
    if settings.up not in (None, "y", "z") or settings.scale <= 0:
        raise SceneError(
            f'{path}: "up" must be "y" or "z", and "scale" a positive number, got {settings.up!r}, {settings.scale}.'
        )
    return settings


def _number(value: object) -> float:
    """Return a finite number. Raises ValueError for anything else, such as NaN, which JSON should not hold."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a finite number")
    return float(value)


def align_z_up(surfaces: Surfaces, mesh: Path, settings: MeshSettings) -> Surfaces:
    """Return the surfaces with z up and in metres, without stray triangles far outside.

    Raises:
        SceneError: The size is impossible for an indoor scene, or the mesh is far from its origin.
    """
    up = _known_up(mesh, settings) or _guess_up(surfaces, mesh, settings.scale)
    vertices = (surfaces.vertices * settings.scale).astype(np.float32)
    if up == "y":
        # This is a quarter turn about x; a mere exchange of axes would mirror the scene.
        vertices = vertices[:, [0, 2, 1]] * np.array([1, -1, 1], np.float32)
    turned = replace(surfaces, vertices=vertices)
    low, high = _extent(turned)
    _check_size(high - low, mesh)
    _check_place((low + high) / 2, mesh)
    corners = vertices[surfaces.faces]
    margin = 0.5 * (high - low).max() + 1
    return turned.only(((corners > low - margin) & (corners < high + margin)).all(axis=(1, 2)))


def side_doubt(aligned: Surfaces, mesh: Path, settings: MeshSettings) -> str | None:
    """Return a sentence if the guessed upward axis makes a mesh too high for a storey, and the other axis does not.

    A scan without a floor has its largest level surfaces along walls, so it may lie on its side.
    """
    if _known_up(mesh, settings):
        return None
    # Whichever of y and z was taken as up, the other one is now second.
    _, depth, height = np.ptp(aligned.vertices[aligned.faces].reshape(-1, 3), axis=0)
    if height <= _HIGH_STOREY_M or not _STOREY_M[0] <= depth <= _STOREY_M[1]:
        return None
    return (
        f"{mesh.name} is {height:.1f} m high and {depth:.1f} m wide as it stands, so it may lie on its side, with a "
        'wall as its floor. Write {"up": "y"} or {"up": "z"}, the axis of the file that points up, into '
        f"{mesh.with_suffix('.json').name}, and check that the mesh has a floor."
    )


def _known_up(mesh: Path, settings: MeshSettings) -> str | None:
    return settings.up or ("z" if mesh.stem.startswith("mesh_z_up") else None)


def _guess_up(surfaces: Surfaces, mesh: Path, scale: float) -> str:
    """Return `y` or `z`: the axis along which the largest slab is level, because that is a floor, ceiling or roof."""
    slab: dict[str, float] = {axis: _largest_slab(surfaces, column, scale) for axis, column in (("y", 1), ("z", 2))}
    standard, other = ("z", "y") if mesh.suffix.lower() == ".ply" else ("y", "z")
    up = other if slab[other] > _SURE * slab[standard] else standard
    log.info('%s: taken as %s-up; if that is wrong, write {"up": "%s"} into %s.', mesh.name, up, "yz".replace(up, ""),
             mesh.with_suffix(".json").name)  # fmt: skip
    return up


def _largest_slab(surfaces: Surfaces, axis: int, scale: float) -> float:
    """Return the largest area in square metres, over pairs of neighbouring slabs, of faces perpendicular to an axis."""
    corners = surfaces.vertices[surfaces.faces].astype(np.float64) * scale
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2
    along = np.abs(normal[:, axis]) > 0.9 * 2 * area
    if not along.any():
        return 0.0
    slabs = np.floor(corners[along][:, :, axis].mean(1) / _SLAB_M).astype(np.int64)
    _, number = np.unique(slabs, return_inverse=True)
    sums = np.bincount(number, weights=area[along])
    return float((sums + np.append(sums[1:], 0)).max())


def _extent(surfaces: Surfaces) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the low and high corner (3,) of the box between the 1st and 99th percentile of the area per axis."""
    corners = surfaces.vertices[surfaces.faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    ends = []
    for axis in range(3):
        order = np.argsort(corners[:, :, axis].ravel())
        share = np.cumsum(np.repeat(area, 3)[order]) / (3 * area.sum())
        values = corners[:, :, axis].ravel()[order]
        ends.append((values[np.searchsorted(share, 0.01)], values[min(np.searchsorted(share, 0.99), len(values) - 1)]))
    low, high = np.array(ends).T
    return low, high


def _check_size(size: NDArray[np.float64], mesh: Path) -> None:
    span = float(size[:2].max())
    if not _LEAST_SPAN_M <= span <= _MOST_SPAN_M or size[2] > _MOST_HEIGHT_M:
        raise SceneError(
            f"{mesh} measures {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} m, but an indoor scene is "
            f"{_LEAST_SPAN_M:g} to {_MOST_SPAN_M:g} m wide and at most {_MOST_HEIGHT_M:g} m high. {_ADVICE}"
        )


def _check_place(middle: NDArray[np.float64], mesh: Path) -> None:
    if np.abs(middle).max() > _MOST_DISTANCE_M:
        place = ", ".join(f"{along / 1000:,.0f}" for along in middle)
        raise SceneError(
            f"{mesh} lies far from its origin, at ({place}) km, but must lie within {_MOST_DISTANCE_M / 1000:g} km. "
            f"{_ADVICE}"
        )


@dataclass(frozen=True, eq=False)
class StoreyFloor:
    """The floor of one storey."""

    height_m: float
    """Height of the floor in the frame of the mesh."""
    clearance: ClearanceMap
    tall: Mask
    """(rows, columns) of the clearance map's grid: cells with walls and other objects above 1.4 m."""
    area_m2: float
    """Area of the floor indoors in square metres, including furnished parts."""

    @property
    def navigable_m2(self) -> float:
        """Area in square metres where the robot's centre can be; 0 if there is no place to turn."""
        if not (self.clearance.navigable & (self.clearance.grid > _START_CLEARANCE_M)).any():
            return 0.0
        return float(np.count_nonzero(self.clearance.navigable)) * CELL_M**2


def detect_floor(
    triangles: Triangles, mesh: str, height_m: float | None, known: KnownFloor | None = None
) -> StoreyFloor:
    """Return the lowest floor with at least half the navigable area of the largest.

    Args:
        triangles: (F, 3, 3) in metres, z up.
        mesh: Name of the mesh, for messages.
        height_m: Height of the floor, if it is known.
        known: Free floor from a map, which replaces the detection of free cells.

    Raises:
        SceneError: No floor is wide enough for the robot.
    """
    candidates = _level_heights(triangles) if height_m is None else [height_m]
    floors = [_survey(triangles, height, known) for height in candidates]
    most = max((floor.navigable_m2 for floor in floors), default=0.0)
    if most < _LEAST_FLOOR_M2:
        tried = ", ".join(f"{height:.2f} m" for height in candidates) or "none, because no surface is level"
        raise SceneError(
            f"{mesh} has no floor that is wide enough for the robot (heights examined: {tried}; it needs "
            f"{_LEAST_FLOOR_M2:g} m2 indoors). {_ADVICE}"
        )
    return next(floor for floor in floors if floor.navigable_m2 > most / 2)


def _level_heights(triangles: Triangles) -> list[float]:
    """Return the heights in metres with the most level area, from low to high."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.linalg.norm(normal, axis=1)
    level = np.abs(normal[:, 2]) > _LEVEL * doubled
    height = triangles[level][:, :, 2].mean(axis=1)
    area = doubled[level] / 2
    heights: list[float] = []
    while len(heights) < _CANDIDATES and area.sum() > _LEAST_FLOOR_M2:
        slab = np.floor(height / 0.05).astype(np.int64)
        _, number = np.unique(slab, return_inverse=True)
        best = np.average(height[number == np.bincount(number, weights=area).argmax()])
        near = np.abs(height - best) < 0.08
        if area[near].sum() < _LEAST_FLOOR_M2:
            break
        heights.append(_weighted_median(height[near], area[near]))
        height = height[~near]
        area = area[~near]
    return sorted(heights)


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(share, share[-1] / 2)])


def _survey(triangles: Triangles, height_m: float, known: KnownFloor | None) -> StoreyFloor:
    """Return the floor at a height: its level cells, obstacles, walls and ceiling."""
    lifted = triangles - (0, 0, height_m)
    grid = _grid(lifted)
    ground = clip_to_heights(lifted, -_HOLLOW_M, _STEP_M)
    normal = np.cross(ground[:, 1] - ground[:, 0], ground[:, 2] - ground[:, 0])
    level = np.abs(normal[:, 2]) > _LEVEL * np.linalg.norm(normal, axis=1)
    low, tall, above = (
        _coarse(grid.cover(clip_to_heights(lifted, *heights)))
        for heights in ((_STEP_M, OBSTACLE_HEIGHT_M), (1.4, _CEILING_M), (_CEILING_M, np.inf))
    )
    if known is None:
        floor = _closed(_coarse(grid.cover(ground[level])), 0.1)
        floor &= _indoors(floor & ~low, low | tall, above)
    else:
        y, x = (grid.origin[1 - axis] + (np.arange(cells) + 0.5) * CELL_M for axis, cells in enumerate(low.shape))
        floor = known(x, y)
        if np.count_nonzero(floor & _closed(_coarse(grid.cover(ground[level])), 0.3)) < _GROUND_SHARE * floor.sum():
            floor = np.zeros_like(floor)
    return _cropped(height_m, floor, low, _closed(tall, 0.3) & _closed(low, 0.3), grid.origin)


def _grid(lifted: Triangles) -> RasterGrid:
    """Return a grid over all surfaces between the floor and the ceiling, with a margin of four cells."""
    near = clip_to_heights(lifted, -_HOLLOW_M, _CEILING_M)
    corners = near.reshape(-1, 3)[:, :2] if len(near) else np.zeros((1, 2))
    origin = np.floor(corners.min(axis=0) / CELL_M - 4) * CELL_M
    columns, rows = (np.ceil((corners.max(axis=0) - origin) / CELL_M).astype(int) + 4) * _FINE
    return RasterGrid(origin, (int(rows), int(columns)), CELL_M / _FINE)


def _coarse(fine: Mask) -> Mask:
    rows, columns = fine.shape
    return np.asarray(fine.reshape(rows // _FINE, _FINE, columns // _FINE, _FINE).any(axis=(1, 3)))


def _closed(cells: Mask, radius_m: float) -> Mask:
    """Fill gaps up to twice a radius wide (morphological closing)."""
    size = 2 * round(radius_m / CELL_M) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    padded = np.pad(cells.astype(np.uint8), size)  # OpenCV treats cells outside the image as set when it erodes.
    return cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)[size:-size, size:-size].astype(bool)


def _indoors(free: Mask, walls: Mask, above: Mask) -> Mask:
    """Mark the cells under a ceiling; if the mesh has none, those with walls on at least three of four sides."""
    if np.count_nonzero(free & above) >= _ROOFED_SHARE * np.count_nonzero(free):
        return _closed(above, _HOLE_M)
    sides = [np.logical_or.accumulate(walls, axis) for axis in (0, 1)]
    sides += [np.flip(np.logical_or.accumulate(np.flip(walls, axis), axis), axis) for axis in (0, 1)]
    return np.sum(sides, axis=0) >= 3


def _cropped(height_m: float, floor: Mask, low: Mask, tall: Mask, origin: NDArray[np.float64]) -> StoreyFloor:
    """Crop the grids to the free floor and a blocked border."""
    free = floor & ~low
    if not free.any():
        return StoreyFloor(
            height_m=height_m,
            clearance=ClearanceMap(np.ones((3, 3), bool), origin),
            tall=np.zeros((3, 3), bool),
            area_m2=0.0,
        )
    rows = np.flatnonzero(free.any(axis=1))
    columns = np.flatnonzero(free.any(axis=0))
    first = np.maximum([rows[0] - 4, columns[0] - 4], 0)
    part = np.s_[first[0] : rows[-1] + 5, first[1] : columns[-1] + 5]
    blocked = np.pad(~free[part], 1, constant_values=True)
    corner = origin + (first[::-1] - 1) * CELL_M
    area = float(np.count_nonzero(floor)) * CELL_M**2
    return StoreyFloor(
        height_m=height_m, clearance=ClearanceMap(blocked, corner, CELL_M), tall=np.pad(tall[part], 1), area_m2=area
    )
