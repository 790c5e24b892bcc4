"""From poses on the floor to what the scene takes: points and quaternions."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def points(xy: ArrayLike, height_m: float) -> NDArray[np.float32]:
    """Return (..., 3) points at a height from floor positions or poses (..., >=2)."""
    xy = np.asarray(xy, np.float32)[..., :2]
    return np.concatenate([xy, np.full((*xy.shape[:-1], 1), height_m, np.float32)], axis=-1)


def wxyz(yaw_rad: ArrayLike) -> NDArray[np.float32]:
    """Return (..., 4) quaternions of turns about the vertical."""
    half = np.asarray(yaw_rad, np.float64) / 2
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1).astype(np.float32)


def marker_mesh(length_m: float, thickness_m: float) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return vertices (V, 3) and faces (F, 3) of a flat drop that points along x, so that a place shows its view."""
    angles = np.linspace(np.pi / 3, 2 * np.pi - np.pi / 3, 11)
    radius = length_m * 0.45
    rim = np.concatenate([radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), [[length_m, 0.0]]])
    n = len(rim)
    top = np.concatenate([rim, np.full((n, 1), thickness_m)], axis=1)
    bottom = np.concatenate([rim, np.zeros((n, 1))], axis=1)
    vertices = np.concatenate([top, bottom, [[0, 0, thickness_m], [0, 0, 0]]]).astype(np.float32)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    roof = np.stack([i, j, np.full(n, 2 * n)], axis=1)
    floor = np.stack([j + n, i + n, np.full(n, 2 * n + 1)], axis=1)
    sides = np.concatenate([np.stack([i, i + n, j], axis=1), np.stack([j, i + n, j + n], axis=1)])
    return vertices, np.concatenate([roof, floor, sides]).astype(np.uint32)
