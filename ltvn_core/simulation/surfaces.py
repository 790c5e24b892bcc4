"""Textured triangles, laid out flat for ray casting and drawing.

Owns the arrays of a scene's visible surfaces and nothing of what they mean. Where the triangles come from (generator
or, later, a scan) is not its business.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Rgb


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Triangles in metres, z up, the floor at zero."""

    vertices: NDArray[np.float32]
    """(V, 3)."""
    faces: NDArray[np.int32]
    """(F, 3) indices into the vertices."""
    corner_uv: NDArray[np.float32]
    """(F, 3, 2) texture coordinates per corner; (0, 0) is a picture's lower left, and pictures repeat."""
    face_texture: NDArray[np.int32]
    """(F,) index into the textures."""
    overhead: NDArray[np.bool_]
    """(F,) true for the ceiling and what hangs from it, which a view from above leaves out."""
    textures: tuple[Rgb, ...]
    """Pictures (H, W, 3); H and W are powers of two. A plain colour is a picture of one pixel."""

    def without_overhead(self) -> "Surfaces":
        """Cut the ceiling and its lamps away."""
        return self.only(~self.overhead)

    def only(self, keep: NDArray[np.bool_]) -> "Surfaces":
        """Keep the faces where `keep` (F,) is true; vertices and textures stay."""
        return Surfaces(
            vertices=self.vertices,
            faces=self.faces[keep],
            corner_uv=self.corner_uv[keep],
            face_texture=self.face_texture[keep],
            overhead=self.overhead[keep],
            textures=self.textures,
        )
