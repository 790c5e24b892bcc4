"""The visible surfaces of a scene: textured triangles in flat arrays, and their building from boxes and cylinders.

Owns the sizes that textures may have (sides that are powers of two, and a budget of texels) and the light, as factors
of the colours. Knows primitive shapes and their texture coordinates, but not what a wall or a sofa is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Rgb

_RED_OF_LAMPS = 0.12
_BLUE_OF_LAMPS = 0.3
"""Shares by which red is stronger and blue weaker at a warmth of 1."""
MAX_SIDE = 4096


class Light(NamedTuple):
    """Brightness and colour of the light in a scene, as factors; 1 is the original light."""

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
    """(F,) whether a face belongs to the ceiling or its lamps, which views from above omit."""
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


TextureIndex = int
"""Index of a texture that was added to the builder."""

# Per side of a box: axis and sign of the normal, then the axis and sign along which u grows, seen from outside.
_SIDES = ((0, 1, 1, 1), (0, -1, 1, -1), (1, 1, 0, -1), (1, -1, 0, 1), (2, 1, 0, 1), (2, -1, 0, 1))
_QUAD = np.array([[0, 1, 2], [0, 2, 3]])


class SurfaceBuilder:
    """Collects textured primitives. All lengths are metres; z is up."""

    def __init__(self, *, share_textures: bool = False) -> None:
        """Start empty; with `share_textures`, an image that was added before is not stored twice."""
        self._textures: list[Rgb] = []
        self._number_of: dict[bytes, TextureIndex] | None = {} if share_textures else None
        self._triangles: list[NDArray[np.float64]] = []
        self._uv: list[NDArray[np.float64]] = []
        self._texture_of: list[NDArray[np.int32]] = []
        self._overhead_of: list[NDArray[np.bool_]] = []
        self.overhead = False
        """Whether primitives that are added now belong to the ceiling or its lamps."""

    @property
    def face_count(self) -> int:
        """Number of triangles added so far."""
        return sum(len(triangles) for triangles in self._triangles)

    def texture(self, image: Rgb) -> TextureIndex:
        """Add an image (H, W, 3) as a texture and return its index."""
        number = len(self._textures)
        if self._number_of is not None:
            number = self._number_of.setdefault(bytes(str(image.shape), "ascii") + image.tobytes(), number)
        if number == len(self._textures):
            self._textures.append(image)
        return number

    def box(
        self,
        texture: TextureIndex,
        centre: tuple[float, float, float],
        size: tuple[float, float, float],
        *,
        turn: tuple[float, float] = (1.0, 0.0),
        tile_m: float | None = 1.0,
    ) -> None:
        """Add a box.

        Args:
            texture: Texture of all sides.
            centre: x, y, z of its centre.
            size: Its extents along x, y, z before the turn.
            turn: (cos, sin) of its rotation about the vertical axis.
            tile_m: Metres per repeat of the texture; None fits the texture onto each side once.

        A box that stands on the floor gets no bottom side, because it can never be seen.
        """
        half = np.asarray(size, np.float64) / 2
        for axis, sign, u_axis, u_sign in _SIDES:
            if axis == 2 and sign < 0 and centre[2] - half[2] < 0.02:
                continue
            v_axis = 3 - axis - u_axis
            corners = np.empty((4, 3))
            corners[:, axis] = sign * half[axis]
            corners[:, u_axis] = np.array([-1, 1, 1, -1]) * u_sign * half[u_axis]
            corners[:, v_axis] = np.array([-1, -1, 1, 1]) * half[v_axis]
            if tile_m is None:
                uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
            else:
                shift = np.asarray(centre) if turn == (1.0, 0.0) else np.zeros(3)
                at = corners + shift
                uv = np.stack([at[:, u_axis] * u_sign, at[:, v_axis]], -1) / tile_m
            self._add(texture, _turned(corners, turn)[_QUAD] + np.asarray(centre), uv[_QUAD])

    def cylinder(
        self,
        texture: TextureIndex,
        base: tuple[float, float, float],
        radius: float,
        height: float,
        *,
        top_radius: float | None = None,
        sides: int = 12,
    ) -> None:
        """Add an upright cylinder, or a cone if `top_radius` differs, on the centre of its base.

        The texture wraps around it once.
        """
        top_radius = radius if top_radius is None else top_radius
        ring = _ring(sides)
        low = np.column_stack([ring * radius, np.zeros(sides + 1)]) + base
        high = np.column_stack([ring * top_radius, np.full(sides + 1, height)]) + base
        around = np.arange(sides + 1) / sides
        quads = np.stack([low[:-1], low[1:], high[1:], high[:-1]], 1)[:, _QUAD].reshape(-1, 3, 3)
        bottom = np.zeros(sides)
        top = np.ones(sides)
        quad_uv = np.stack(
            [
                np.stack([around[:-1], bottom], -1),
                np.stack([around[1:], bottom], -1),
                np.stack([around[1:], top], -1),
                np.stack([around[:-1], top], -1),
            ],
            1,
        )[:, _QUAD].reshape(-1, 3, 2)
        lid = np.stack([high[:-1], high[1:], np.broadcast_to(high[:-1].mean(0), (sides, 3))], 1)
        lid_uv = (lid[..., :2] - np.asarray(base)[:2]) / (2 * max(top_radius, 1e-3)) + 0.5
        self._add(texture, quads, quad_uv)
        self._add(texture, lid, lid_uv)

    def build(self) -> Surfaces:
        """Return all surfaces that were added.

        Lengths are rounded to 10 micrometres, so that scenes are bit-identical on every machine.
        """
        triangles = np.concatenate(self._triangles)
        return Surfaces(
            vertices=np.round(triangles.reshape(-1, 3), 5).astype(np.float32),
            faces=np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3),
            corner_uv=np.round(np.concatenate(self._uv), 5).astype(np.float32),
            face_texture=np.concatenate(self._texture_of),
            overhead=np.concatenate(self._overhead_of),
            textures=tuple(self._textures),
        )

    def _add(self, texture: TextureIndex, triangles: NDArray[np.float64], uv: NDArray[np.float64]) -> None:
        self._triangles.append(triangles)
        self._uv.append(uv)
        self._texture_of.append(np.full(len(triangles), texture, np.int32))
        self._overhead_of.append(np.full(len(triangles), self.overhead))


def rounded_cos_sin(angle_rad: float) -> tuple[float, float]:
    """Return (cos, sin), rounded because the last bit differs between mathematics libraries."""
    return round(cos(angle_rad), 9), round(sin(angle_rad), 9)


def _turned(points: NDArray[np.float64], turn: tuple[float, float]) -> NDArray[np.float64]:
    c, s = turn
    return np.stack([c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1], points[:, 2]], -1)


def _ring(sides: int) -> NDArray[np.float64]:
    return np.array([rounded_cos_sin(2 * pi * i / sides) for i in range(sides + 1)])
