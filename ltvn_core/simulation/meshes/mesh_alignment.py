"""Aligns a mesh: z up and lengths in metres.

Reads the settings that a user may write beside a mesh (`house.json` for `house.glb`), and estimates the upward axis
without them. GLB files of Habitat and Gibson have z up although the standard says y, so the estimate uses the geometry
in every format.
"""

import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.surfaces import Surfaces

log = logging.getLogger(__name__)

_SURE = 1.3
"""The axis of the format's standard is used unless the other axis has a level slab this many times as large."""
_SLAB_M = 0.1
"""Thickness of a slab."""
_LEAST_SPAN_M = 1.0
_MOST_SPAN_M = 150.0
_MOST_HEIGHT_M = 40.0


@dataclass(frozen=True, slots=True)
class MeshSettings:
    """What the JSON file beside a mesh sets; the names are keys of that file."""

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
        content: Any = json.loads(path.read_text())
        floor = content.get("floor_height")
        settings = MeshSettings(
            up=content.get("up"),
            scale=float(content.get("scale", 1.0)),
            floor_height=None if floor is None else float(floor),
        )
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise SceneError(
            f'{path} is not understood ({error}). Write for instance {{"up": "z", "scale": 1.0}}.'
        ) from error
    if settings.up not in (None, "y", "z") or not 0 < settings.scale < np.inf:
        raise SceneError(
            f'{path}: "up" is "y" or "z" and "scale" a positive number, got {settings.up!r}, {settings.scale}.'
        )
    return settings


def align_z_up(surfaces: Surfaces, mesh: Path, settings: MeshSettings) -> Surfaces:
    """Return the surfaces with z up and in metres, without stray triangles far outside.

    Raises:
        SceneError: The size is impossible for an indoor scene.
    """
    up = settings.up or ("z" if mesh.stem.startswith("mesh_z_up") else _guess_up(surfaces, mesh, settings.scale))
    vertices = (surfaces.vertices * settings.scale).astype(np.float32)
    if up == "y":
        # A quarter turn about x and not only an exchange of axes, which would mirror the scene.
        vertices = vertices[:, [0, 2, 1]] * np.array([1, -1, 1], np.float32)
    turned = replace(surfaces, vertices=vertices)
    low, high = _extent(turned)
    _check_size(high - low, mesh)
    corners = vertices[surfaces.faces]
    margin = 0.5 * (high - low).max() + 1
    return turned.only(((corners > low - margin) & (corners < high + margin)).all(axis=(1, 2)))


def _guess_up(surfaces: Surfaces, mesh: Path, scale: float) -> str:
    """Return `y` or `z`: the axis along which the largest slab is level, because that is a floor, ceiling or roof."""
    slab: dict[str, float] = {axis: _largest_slab(surfaces, column, scale) for axis, column in (("y", 1), ("z", 2))}
    standard, other = ("z", "y") if mesh.suffix.lower() == ".ply" else ("y", "z")
    up = other if slab[other] > _SURE * slab[standard] else standard
    log.info('%s: taken as %s-up; if that is wrong, write {"up": "%s"} into %s.', mesh.name, up, "yz".replace(up, ""),
             mesh.with_suffix(".json").name)  # fmt: skip
    return up


def _largest_slab(surfaces: Surfaces, axis: int, scale: float) -> float:
    """Return the largest area in square metres of faces perpendicular to an axis within two neighbouring slabs."""
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
    height = float(size[2])
    if _LEAST_SPAN_M <= span <= _MOST_SPAN_M and height <= _MOST_HEIGHT_M:
        return
    factor = next((f for f in (1.0, 0.01, 0.001, 1000.0) if 3 <= span * f <= 60 and height * f <= 15), 0.001)
    raise SceneError(
        f"{mesh} measures {size[0]:.4g} x {size[1]:.4g} x {height:.4g}, which is no indoor scene in metres (a floor is "
        f"{_LEAST_SPAN_M:g} to {_MOST_SPAN_M:g} m wide). If it has another unit, write the metres per unit into "
        f'{mesh.with_suffix(".json")}, for instance {{"scale": {factor:g}}}.'
    )
