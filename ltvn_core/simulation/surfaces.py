"""The visible surfaces of a scene: textured triangles in flat arrays, for ray casting and display.

Owns the sizes that textures may have (sides that are powers of two, and a budget of texels) and the light, as factors
of the colours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Rgb

_RED_OF_LAMPS = 0.12
_BLUE_OF_LAMPS = 0.3
"""At a warmth of 1 red is so much stronger, and blue so much weaker."""
MAX_SIDE = 4096


class Light(NamedTuple):
    """How bright a scene is and in which colour it is lit; factors, 1 is the scene as it was made."""

    red: float = 1.0
    green: float = 1.0
    blue: float = 1.0

    @classmethod
    def of(cls, level: float, warmth: float) -> Self:
        """Return the light of a brightness (1 is plain) and a warmth from -1 (daylight) to 1 (lamps)."""
        return cls(level * (1 + _RED_OF_LAMPS * warmth), level, level * (1 - _BLUE_OF_LAMPS * warmth))


PLAIN_LIGHT = Light()


def resize_to_power_of_two(image: Rgb) -> Rgb:
    """Scale an image (H, W, 3) to the nearest powers of two, at most `MAX_SIDE`."""
    height, width = (min(MAX_SIDE, 1 << max(0, round(float(np.log2(side))))) for side in image.shape[:2])
    return resized(image, width, height)


def shrink_to_budget(images: list[Rgb], most_texels: int) -> list[Rgb]:
    """Halve the largest images until all together have at most `most_texels` texels."""
    images = list(images)
    while sum(image.size // 3 for image in images) > most_texels:
        largest = max(range(len(images)), key=lambda k: images[k].size)
        height, width = images[largest].shape[:2]
        images[largest] = resized(images[largest], max(width // 2, 1), max(height // 2, 1))
    return images


def resized(image: Rgb, width: int, height: int) -> Rgb:
    """Scale an image (H, W, 3); shrinking averages, enlarging interpolates."""
    if image.shape[:2] == (height, width):
        return np.ascontiguousarray(image)
    shrinks = width * height < image.shape[0] * image.shape[1]
    interpolation = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return cv2.resize(image, (width, height), interpolation=interpolation).astype(np.uint8, copy=False)


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
