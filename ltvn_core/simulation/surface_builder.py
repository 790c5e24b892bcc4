"""Builds textured surfaces from boxes and cylinders.

Knows primitive shapes and their texture coordinates, but not what a wall or a sofa is.
"""

from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.types import Rgb

TextureIndex = int
"""Index of a texture that was added to the builder."""

# Per side of a box: axis and sign of the normal, then the axis and sign along which u grows, seen from outside.
_SIDES = ((0, 1, 1, 1), (0, -1, 1, -1), (1, 1, 0, -1), (1, -1, 0, 1), (2, 1, 0, 1), (2, -1, 0, 1))
_QUAD = np.array([[0, 1, 2], [0, 2, 3]])


class SurfaceBuilder:
    """Collects textured primitives. All lengths are metres; z is up."""

    def __init__(self) -> None:
        self._textures: list[Rgb] = []
        self._triangles: list[NDArray[np.float64]] = []
        self._uv: list[NDArray[np.float64]] = []
        self._texture_of: list[NDArray[np.int32]] = []
        self._overhead_of: list[NDArray[np.bool_]] = []
        self.overhead = False
        """Whether what is added now is part of the ceiling or hangs from it."""

    @property
    def face_count(self) -> int:
        """How many triangles were added so far."""
        return sum(len(triangles) for triangles in self._triangles)

    def texture(self, image: Rgb) -> TextureIndex:
        """Add an image (H, W, 3) as a texture and return its index."""
        self._textures.append(image)
        return len(self._textures) - 1

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
            texture: What all sides show.
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
        bottom, top = np.zeros(sides), np.ones(sides)
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
        """Return all that was added.

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
