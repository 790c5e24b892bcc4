"""The part of the floor that a recording takes place on, so that its first view can show all of it."""

import struct
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ltvn_core.structured_text import parse_json

_GLB_MAGIC = b"glTF"
_HEADER_BYTES = 20
"""Header of a binary glTF, with length and kind of its first chunk, which is JSON."""


@dataclass(frozen=True, slots=True)
class FloorExtent:
    """A rectangle on the floor, in metres."""

    low: tuple[float, float]
    """Smallest x and y."""
    high: tuple[float, float]
    """Largest x and y."""
    top_m: float = 0.0
    """Height of the walls around it."""

    @classmethod
    def of_points(cls, points: NDArray[np.floating]) -> Self | None:
        """Return the rectangle around points (N, 3) of x, y and height, or None when there are none."""
        finite = points[np.isfinite(points).all(axis=1)]
        if len(finite) == 0:
            return None
        (left, bottom, _), (right, top, height) = finite.min(axis=0).tolist(), finite.max(axis=0).tolist()
        return cls((left, bottom), (right, top), max(height, 0.0))

    @classmethod
    def of_glb(cls, glb: bytes) -> Self | None:
        """Return the rectangle around all vertices of a binary glTF, z up, or None when it does not say it."""
        if glb[:4] != _GLB_MAGIC or len(glb) < _HEADER_BYTES:
            return None
        (length,) = struct.unpack_from("<I", glb, 12)
        try:
            content = parse_json(glb[_HEADER_BYTES : _HEADER_BYTES + length])
            used = {part["attributes"]["POSITION"] for mesh in content["meshes"] for part in mesh["primitives"]}
            corners = [content["accessors"][k][end] for k in used for end in ("min", "max")]
            return cls.of_points(np.array(corners, float).reshape(-1, 3))
        except (ValueError, KeyError, IndexError, TypeError):
            return None  # A scene that says it in another way is drawn all the same.

    @property
    def centre(self) -> tuple[float, float]:
        """The middle of the rectangle: x and y."""
        return (self.low[0] + self.high[0]) / 2, (self.low[1] + self.high[1]) / 2

    @property
    def width_m(self) -> float:
        """Extent along x."""
        return self.high[0] - self.low[0]

    @property
    def height_m(self) -> float:
        """Extent along y."""
        return self.high[1] - self.low[1]
