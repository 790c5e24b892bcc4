"""The visible surfaces of a scene: textured triangles in flat arrays, for ray casting and display."""

from collections.abc import Sequence
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
    """(F, 3, 2) texture coordinates per corner; (0, 0) is the lower left of the image, and textures repeat."""
    face_texture: NDArray[np.int32]
    """(F,) index into the textures."""
    overhead: NDArray[np.bool_]
    """(F,) true for the ceiling and what hangs from it, which views from above leave out."""
    textures: tuple[Rgb, ...]
    """Images (H, W, 3) whose sides are powers of two. A plain colour is an image of one pixel."""

    def without_overhead(self) -> "Surfaces":
        """Return the surfaces without the ceiling and its lamps."""
        return self.only(~self.overhead)

    def only(self, keep: NDArray[np.bool_]) -> "Surfaces":
        """Return the faces where `keep` (F,) is true; vertices and textures stay, so that indices stay valid."""
        return Surfaces(
            vertices=self.vertices,
            faces=self.faces[keep],
            corner_uv=self.corner_uv[keep],
            face_texture=self.face_texture[keep],
            overhead=self.overhead[keep],
            textures=self.textures,
        )


def joined(parts: Sequence[Surfaces]) -> Surfaces:
    """Return several surfaces as one."""
    vertices = np.cumsum([0, *(len(part.vertices) for part in parts)])
    textures = np.cumsum([0, *(len(part.textures) for part in parts)])
    return Surfaces(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=np.concatenate([part.faces + first for part, first in zip(parts, vertices, strict=False)]).astype(
            np.int32
        ),
        corner_uv=np.concatenate([part.corner_uv for part in parts]),
        face_texture=np.concatenate(
            [part.face_texture + first for part, first in zip(parts, textures, strict=False)]
        ).astype(np.int32),
        overhead=np.concatenate([part.overhead for part in parts]),
        textures=tuple(texture for part in parts for texture in part.textures),
    )
