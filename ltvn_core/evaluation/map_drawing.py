"""The drawing of a map over the floor plan of its scene, and its file.

Nodes and edges are sorted and stored as differences, because those compress well.
"""

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.errors import OptionError


@dataclass(frozen=True, slots=True)
class MapDrawing:
    """A map over the floor plan of its scene, for drawing."""

    origin: tuple[float, float]
    """x and y of the lower corner of the first cell, in metres."""
    resolution_m: float
    free: tuple[str, ...]
    """Rows from low y to high y, one character per cell: "." is navigable, "#" is not."""
    nodes: tuple[tuple[int, float, float, float], ...]
    """Number of each node, with its exact x and y in metres and yaw in radians."""
    edges: tuple[tuple[int, int, float, bool], ...]
    """Source, target, p, and whether it is spurious."""


_PER_METRE = 1000
"""Number of steps per metre, per radian and per unit of p in stored drawings; finer than any figure shows."""


def save_drawing(path: Path, drawing: MapDrawing) -> None:
    """Write a drawing to a file, atomically. Raises OSError."""
    nodes = sorted(drawing.nodes)
    rows = {node: row for row, (node, *_) in enumerate(nodes)}
    edges = sorted((rows[source], rows[target], p, spurious) for source, target, p, spurious in drawing.edges)
    free = np.array([[cell == "." for cell in row] for row in drawing.free], bool)
    with atomic_replacement(path) as part, part.open("wb") as file:
        np.savez_compressed(
            file,
            origin=np.array(drawing.origin, np.float64),
            resolution_m=np.float64(drawing.resolution_m),
            shape=np.array(free.shape if free.size else (0, 0), np.int32),
            free=np.packbits(free),
            nodes=_differences([node for node, *_ in nodes]),
            poses=np.diff(_thousandths([pose for _, *pose in nodes]).reshape(-1, 3), axis=0, prepend=0),
            sources=_differences([source for source, *_ in edges]),
            targets=_differences([target for _, target, *_ in edges]),
            p=_thousandths([p for _, _, p, _ in edges]).astype(np.uint16),
            spurious=np.packbits(np.array([spurious for *_, spurious in edges], bool)),
        )


def load_drawing(path: Path) -> MapDrawing:
    """Read a drawing from `save_drawing`. Raises OptionError for any other file."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return _drawing({name: arrays[name] for name in arrays.files})
    except (OSError, ValueError, KeyError, IndexError, EOFError, BadZipFile) as error:
        raise OptionError(f"{path} is not a drawing of a map ({error}); remove it and evaluate again.") from error


def _drawing(arrays: dict[str, np.ndarray]) -> MapDrawing:
    height, width = arrays["shape"].tolist()
    free = np.unpackbits(arrays["free"], count=height * width).reshape(height, width)
    names = np.cumsum(arrays["nodes"])
    poses = np.cumsum(arrays["poses"], axis=0) / _PER_METRE
    sources = names[np.cumsum(arrays["sources"])]
    targets = names[np.cumsum(arrays["targets"])]
    spurious = np.unpackbits(arrays["spurious"], count=len(sources)).astype(bool)
    p = arrays["p"] / _PER_METRE
    x_m, y_m = arrays["origin"].tolist()
    return MapDrawing(
        origin=(x_m, y_m),
        resolution_m=float(arrays["resolution_m"]),
        free=tuple("".join(row) for row in np.where(free, ".", "#")),
        nodes=tuple((node, *pose) for node, pose in zip(names.tolist(), poses.tolist(), strict=True)),
        edges=tuple(zip(sources.tolist(), targets.tolist(), p.tolist(), spurious.tolist(), strict=True)),
    )


def _thousandths(values: list) -> np.ndarray:
    return np.rint(np.array(values, np.float64) * _PER_METRE).astype(np.int32)


def _differences(values: list[int]) -> np.ndarray:
    return np.diff(np.array(values, np.int32), prepend=0)
