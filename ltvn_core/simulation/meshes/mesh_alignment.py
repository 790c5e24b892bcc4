"""Aligns a mesh: z up and lengths in metres.

Reads the settings that a user may write beside a mesh (`house.json` for `house.glb`), and estimates the upward axis
without them. GLB files of Habitat and Gibson have z up although the standard says y, so the estimate uses the geometry
in every format.
"""

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.structured_text import parse_json

log = logging.getLogger(__name__)

_SURE = 1.3
"""The axis of the format's standard is used unless the other axis has a level slab this many times as large."""
_SLAB_M = 0.1
"""Thickness of a slab."""
_LEAST_SPAN_M = 1.0
_MOST_SPAN_M = 150.0
_MOST_HEIGHT_M = 40.0

_UNITS = (0.001, 0.01, 0.0254, 0.3048, 10.0, 100.0, 1000.0)
"""Metres per unit that are tried for a hint: millimetres, centimetres, inches, feet, and models of buildings."""
_MISSPELT = 0.65
"""Least similarity of an unknown key with a known one that makes it a misspelling. Keys that a person adds for others,
such as `name`, `bounds` or `licence`, are below 0.5."""
_OTHER_WORDS = {"units": "scale", "unit": "scale", "up_axis": "up", "axis": "up", "floor": "floor_height"}
"""What people call a setting who did not read what it is called here."""
_METRES = ("m", "metre", "metres", "meter", "meters")


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
        content: Any = parse_json(path.read_text(encoding="utf-8"))
        floor = content.get("floor_height")
        settings = MeshSettings(
            up=content.get("up"),
            scale=_number(content.get("scale", 1.0)),
            floor_height=None if floor is None else _number(floor),
        )
    except (OSError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise SceneError(
            f'{path} is not understood ({error}). Write for instance {{"up": "z", "scale": 1.0}}.'
        ) from error
    _check_keys(content, path)
    if settings.up not in (None, "y", "z") or settings.scale <= 0:
        raise SceneError(
            f'{path}: "up" is "y" or "z" and "scale" a positive number, got {settings.up!r}, {settings.scale}.'
        )
    return settings


def _number(value: object) -> float:
    """Return a finite number. Raises ValueError for anything else, such as NaN, which JSON should not hold."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no finite number")
    return float(value)


def _check_keys(content: Mapping[str, object], path: Path) -> None:
    """Raise SceneError for a key that is meant to be a setting and is none; other keys are a person's own notes."""
    known = [field.name for field in fields(MeshSettings)]
    for key, value in content.items():
        close = get_close_matches(key.lower(), known, n=1, cutoff=_MISSPELT)
        meant = _OTHER_WORDS.get(key.lower()) or (close[0] if close else None)
        if key in known or meant is None or (meant == "scale" and value in _METRES):
            continue
        raise SceneError(
            f'{path}: "{key}" is not a setting; "{meant}" is meant, as it seems. The settings are "up" ("y" or "z"), '
            '"scale" (metres per unit, 0.001 for millimetres) and "floor_height" (metres).'
        )


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
    factor = _likely_unit(span, height)
    raise SceneError(
        f"{mesh} measures {size[0]:.4g} x {size[1]:.4g} x {height:.4g}, which is no indoor scene in metres (a floor is "
        f"{_LEAST_SPAN_M:g} to {_MOST_SPAN_M:g} m wide). If it has another unit, write the metres per unit into "
        f'{mesh.with_suffix(".json")}, for instance {{"scale": {factor:g}}}.'
    )


def _likely_unit(span: float, height: float) -> float:
    """Return metres per unit with which something so wide and high would be a building."""
    for unit in _UNITS:
        if 3 <= span * unit <= 60 and height * unit <= 15:
            return unit
    return 10.0 ** round(math.log10(10.0 / max(span, height, 1e-9)))
