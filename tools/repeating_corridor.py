"""A corridor in which almost everything repeats, to teach the geometric predictor what does not tell places apart.

Tiles, panels and doors come again and again; here and there hangs or lies something that stands there alone. One ray is
cast per pixel. Owns the corridor and its image; `tools/fit_geometric.py` takes pairs from it.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Depth, Pose, Rgb

LENGTH_M = 30.0
HEIGHT_M = 2.6
_PIXELS_PER_M = 80
_SIDES = 4
"""Right wall, left wall, floor, ceiling."""


@dataclass(frozen=True)
class RepeatingCorridor:
    """The corridor runs along x, from (0, 0) to (30, `width_m`)."""

    width_m: float
    faces: tuple[NDArray[np.uint8], ...]
    """Pictures (H, W, 3) of the four long sides, a column per 1/80 m of x."""

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Return what a camera on a robot at `pose` (3,) sees, and the depth in metres along its axis."""
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        right_down = camera.pixels_to_rays(np.stack([columns, rows], axis=-1).astype(np.float64))
        rays = np.concatenate([np.ones((*right_down.shape[:2], 1)), -right_down], axis=-1) @ camera.rotation.T
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        rays = rays @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        eye = np.array([pose[0], pose[1], camera.height_m])
        far = np.where(rays > 0, np.array([LENGTH_M, self.width_m, HEIGHT_M]), 0.0)
        with np.errstate(divide="ignore"):
            reach = (far - eye) / np.where(rays == 0, 1e-9, rays)
        axis, depth = reach.argmin(-1), reach.min(-1)
        places = (eye + rays * depth[..., None]) * _PIXELS_PER_M
        image = np.full((*axis.shape, 3), 120, np.uint8)  # The ends are plain.
        for side in range(_SIDES):
            on_it = (axis == 1 + side // 2) & ((rays[..., 1 + side // 2] > 0) == bool(side % 2))
            across = places[..., 2 - side // 2]
            seen = cv2.remap(
                self.faces[side], places[..., 0].astype(np.float32), across.astype(np.float32), cv2.INTER_LINEAR
            )
            image[on_it] = seen[on_it]
        return image, depth.astype(np.float32)


def repeating_corridor(rng: np.random.Generator) -> RepeatingCorridor:
    """Draw a corridor."""
    width_m = float(rng.uniform(1.8, 3.0))
    heights = (HEIGHT_M, HEIGHT_M, width_m, width_m)
    faces = [_covered(rng, height) for height in heights]
    for wall in (0, 1):
        _add_doors(faces[wall], rng)
    for face in faces[:3]:
        _add_single_things(face, rng)
    return RepeatingCorridor(width_m, tuple(faces))


def corridor_poses(corridor: RepeatingCorridor, rng: np.random.Generator, clusters: int, size: int) -> Pose:
    """Draw poses (clusters * size, 3): neighbours within a metre, a quarter of them facing a wall."""
    centres = np.column_stack(
        [
            rng.uniform(2, LENGTH_M - 2, clusters),
            np.full(clusters, corridor.width_m / 2),
            rng.choice([0, 0, 0, np.pi / 2], clusters) + rng.normal(0, 0.2, clusters),
        ]
    )
    spread = np.stack([rng.uniform(-1, 1, (clusters, size)), rng.uniform(-0.4, 0.4, (clusters, size))], axis=-1)
    turns = rng.normal(0, 0.2, (clusters, size, 1))
    poses = centres[:, None] + np.concatenate([spread, turns], axis=-1)
    return poses.reshape(-1, 3)


def _covered(rng: np.random.Generator, height_m: float) -> NDArray[np.uint8]:
    """Return one side covered with equal tiles or panels."""
    across, down = (int(_PIXELS_PER_M * rng.uniform(low, high)) for low, high in ((0.3, 1.6), (0.3, 1.3)))
    tile = np.full((down, across, 3), rng.uniform(90, 230) + rng.normal(0, 15, 3), np.float32)
    grain = cv2.resize(rng.normal(0, 1, (down // 6 + 1, across // 6 + 1)).astype(np.float32), (across, down))
    tile += rng.choice([0, 3, 12]) * grain[..., None]
    line = rng.uniform(-90, 30)
    tile[:2] += line
    tile[:, :2] += line
    rows, columns = int(height_m * _PIXELS_PER_M) + 2, int(LENGTH_M * _PIXELS_PER_M) + 2
    whole = np.tile(tile, (rows // down + 1, columns // across + 1, 1))[:rows, :columns]
    # Lamps light some parts more than others.
    lamps = cv2.resize(rng.normal(0, 1, (1, 16)).astype(np.float32), (columns, rows), interpolation=cv2.INTER_CUBIC)
    return np.clip(whole + rng.choice([0, 8]) * lamps[..., None], 0, 255).astype(np.uint8)


def _add_doors(wall: NDArray[np.uint8], rng: np.random.Generator) -> None:
    """Draw equal doors at equal distances, with a frame and a handle."""
    every, width = int(_PIXELS_PER_M * rng.uniform(2.0, 4.5)), int(_PIXELS_PER_M * 0.9)
    colour, frame = rng.integers(40, 220, 3), rng.integers(20, 160, 3)
    for left in range(int(rng.integers(every)), wall.shape[1] - width, every):
        wall[: 2 * _PIXELS_PER_M, left : left + width] = frame
        wall[: 2 * _PIXELS_PER_M - 5, left + 5 : left + width - 5] = colour
        wall[76:84, left + width - 20 : left + width - 9] = frame


def _add_single_things(face: NDArray[np.uint8], rng: np.random.Generator) -> None:
    """Put up pictures, signs and bags, each another one, one in three metres or fewer."""
    for _ in range(int(LENGTH_M * rng.choice([0.05, 0.15, 0.35]))):
        height, width = (int(_PIXELS_PER_M * rng.uniform(0.15, 0.7)) for _ in range(2))
        top, left = int(rng.integers(face.shape[0] - height)), int(rng.integers(face.shape[1] - width))
        picture = cv2.resize(rng.uniform(0, 255, (rng.integers(2, 9), rng.integers(2, 9), 3)), (width, height))
        face[top : top + height, left : left + width] = np.clip(picture, 0, 255)
