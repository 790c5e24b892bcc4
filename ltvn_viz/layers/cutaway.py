"""A scene as a doll's house: cut off at a height, so that one sees into the rooms from above.

Owns the cut. Whatever is solid gets its own top back as a lid, let down to the cut.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.surfaces import Surfaces

CUT_HEIGHT_M = 1.35
"""Above tables, window sills and the robot; low enough to look over."""
MIN_LID_NORMAL_Z = 0.95
"""Upward part of the normal of what counts as a lid."""
LID_SQUEEZE = 0.01
"""Lids keep a little of their distance to each other, so that they do not flicker."""

Corners = NDArray[np.float32]
"""(F, 3, 5): position and texture coordinates of each corner."""


def cut_away(surfaces: Surfaces, height_m: float = CUT_HEIGHT_M) -> Surfaces:
    """Return surfaces without all that is higher than `height_m`, closed by lids."""
    shown = surfaces.without_overhead()
    corners = np.concatenate([shown.vertices[shown.faces], shown.corner_uv], axis=2)
    above = (corners[:, :, 2] > height_m).sum(axis=1)
    lids = _lids(corners, above == 3, height_m)
    one, two = above == 1, above == 2
    one_high = _turned(corners[one], corners[one][:, :, 2] > height_m)
    one_low = _turned(corners[two], corners[two][:, :, 2] <= height_m)
    parts = [
        (corners[above == 0], shown.face_texture[above == 0]),
        (_below_one_high(one_high, height_m), np.tile(shown.face_texture[one], 2)),
        (_below_two_high(one_low, height_m), shown.face_texture[two]),
        (lids[0], shown.face_texture[lids[1]]),
    ]
    kept, textures = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Surfaces(
        vertices=kept[:, :, :3].reshape(-1, 3).astype(np.float32),
        faces=np.arange(3 * len(kept), dtype=np.int32).reshape(-1, 3),
        corner_uv=kept[:, :, 3:].astype(np.float32),
        face_texture=textures.astype(np.int32),
        overhead=np.zeros(len(kept), bool),
        textures=surfaces.textures,
    )


def _lids(corners: Corners, high: NDArray[np.bool_], height_m: float) -> tuple[Corners, NDArray[np.int64]]:
    """Return the tops among the high faces, let down, and which faces they were."""
    edges = corners[:, 1:, :3] - corners[:, :1, :3]
    normal = np.cross(edges[:, 0], edges[:, 1])
    upward = np.abs(normal[:, 2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    rows = np.flatnonzero(high & (upward > MIN_LID_NORMAL_Z))
    lids = corners[rows].copy()
    lids[:, :, 2] = height_m + LID_SQUEEZE * (lids[:, :, 2] - height_m)
    return lids, rows


def _turned(corners: Corners, is_odd: NDArray[np.bool_]) -> Corners:
    """Turn each triangle until its odd corner comes first, keeping its sense."""
    order = (np.argmax(is_odd, axis=1)[:, None] + np.arange(3)) % 3
    return np.take_along_axis(corners, order[:, :, None], axis=1)


def _between(low: NDArray[np.float32], high: NDArray[np.float32], height_m: float) -> NDArray[np.float32]:
    """Return where the edges (F, 5) from `low` to `high` pass the height."""
    share = (height_m - low[:, 2]) / (high[:, 2] - low[:, 2])
    return (low + share[:, None] * (high - low)).astype(np.float32)


def _below_one_high(corners: Corners, height_m: float) -> Corners:
    """Cut the first corner off: two triangles each."""
    top, left, right = corners[:, 0], corners[:, 1], corners[:, 2]
    on_left, on_right = _between(left, top, height_m), _between(right, top, height_m)
    return np.concatenate([np.stack([on_left, left, right], axis=1), np.stack([on_left, right, on_right], axis=1)])


def _below_two_high(corners: Corners, height_m: float) -> Corners:
    """Keep the first corner alone."""
    bottom, left, right = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.stack([bottom, _between(bottom, left, height_m), _between(bottom, right, height_m)], axis=1)
