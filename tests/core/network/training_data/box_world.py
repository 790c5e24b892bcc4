"""A fake world for tests: upright walls on a flat floor, cast ray by ray in numpy. Exact, tiny, no simulator."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.network.training_data.pose_sampling import DatasetScene
from ltvn_core.types import Depth, Pose, Rgb

Walls = NDArray[np.float64]
"""(S, 4): x0, y0, x1, y1 of each wall, 2.4 m high."""

CEILING_M = 2.4
TWO_ROOMS: Walls = np.array([[0, 0, 8, 0], [8, 0, 8, 4], [8, 4, 0, 4], [0, 4, 0, 0], [4, 0, 4, 2.7]], np.float64)
"""8 x 4 m; a wall at x = 4 leaves a gap from y = 2.7 to 4."""


class WallFloor:
    """Distances to walls; ways are straight lines or one corner around the dividing wall's end."""

    def __init__(self, walls: Walls) -> None:
        self.walls = walls
        self.low, self.high = walls.reshape(-1, 2).min(0), walls.reshape(-1, 2).max(0)

    def at(self, xy: ArrayLike) -> NDArray[np.float64]:
        points = np.asarray(xy, np.float64)[..., None, :2]
        start, way = self.walls[:, :2], self.walls[:, 2:] - self.walls[:, :2]
        along = np.clip(((points - start) * way).sum(-1) / (way**2).sum(-1), 0, 1)
        distance = np.linalg.norm(points - start - along[..., None] * way, axis=-1).min(-1)
        inside = np.all((points[..., 0, :] > self.low) & (points[..., 0, :] < self.high), axis=-1)
        return np.where(inside, distance, 0.0)

    def along(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.float64]:
        starts, ends = np.asarray(starts, np.float64), np.asarray(ends, np.float64)
        parts = np.linspace(0, 1, 60)[:, None, None]
        least = self.at(starts * (1 - parts) + ends * parts).min(0)
        return np.where(least < 0.05, 0.0, least)

    def sample_poses(self, rng: np.random.Generator, count: int, *, min_clearance_m: float = 0.22) -> Pose:
        xy = rng.uniform(self.low, self.high, (count * 20, 2))
        xy = xy[self.at(xy) > min_clearance_m][:count]
        return np.column_stack([xy, rng.uniform(-np.pi, np.pi, len(xy))])

    def path(self, start: ArrayLike, goal: ArrayLike) -> NDArray[np.float64] | None:
        start, goal = np.asarray(start, np.float64)[:2], np.asarray(goal, np.float64)[:2]
        gap = np.array([4.0, 3.35])
        return np.array([start, goal]) if self.along(start[None], goal[None])[0] > 0.1 else np.array([start, gap, goal])

    def path_lengths(self, start: ArrayLike, goals: ArrayLike, *, limit_m: float = np.inf) -> NDArray[np.float64]:
        paths = [self.path(start, goal) for goal in np.asarray(goals)]
        lengths = np.array([np.hypot(*np.diff(path, axis=0).T).sum() for path in paths if path is not None])
        return np.where(lengths <= limit_m, lengths, np.inf)


class WallCamera:
    """Casts one ray per pixel; walls carry stripes and colours of their own."""

    def __init__(self, walls: Walls) -> None:
        self.walls = walls

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        width, height, focal = camera.width, camera.height, camera.fx
        left = (width / 2 - np.arange(width) - 0.5) / focal
        up = (height / 2 - np.arange(height) - 0.5) / focal
        wall, metres, place = self._columns(pose, left)
        vertical = np.where(up > 0, (CEILING_M - 0.6) / np.maximum(up, 1e-6), 0.6 / np.maximum(-up, 1e-6))
        depth = np.minimum(metres[None], vertical[:, None])
        stripes = np.floor(place * 4).astype(int)
        colours = np.random.default_rng(0).integers(40, 255, (997, 3))
        colour_image = colours[(wall * 131 + stripes * 17)[None].repeat(height, 0) % 997]
        colour_image = np.where((depth < metres[None])[..., None], np.array([90, 80, 70]), colour_image)
        return colour_image.astype(np.uint8), depth.astype(np.float32)

    def _columns(self, pose: Pose, left: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return the wall that each column hits, the depth at which it does, and where along the wall."""
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        rays = np.stack([cos - sin * left, sin + cos * left], -1)[:, None]
        start, way = self.walls[:, :2] - pose[:2], self.walls[:, 2:] - self.walls[:, :2]
        cross = rays[..., 0] * way[:, 1] - rays[..., 1] * way[:, 0]
        cross = np.where(np.abs(cross) < 1e-9, 1e-9, cross)
        metres = (start[:, 0] * way[:, 1] - start[:, 1] * way[:, 0]) / cross
        share = (start[:, 0] * rays[..., 1] - start[:, 1] * rays[..., 0]) / cross
        metres = np.where((metres > 0.01) & (share >= 0) & (share <= 1), metres, np.inf)
        wall = metres.argmin(1)
        rows = np.arange(len(left))
        return wall, np.minimum(metres[rows, wall], 10), share[rows, wall] * np.hypot(*way[wall].T)


def two_rooms(name: str = "two-rooms") -> DatasetScene:
    """Return a world of two rooms joined by a gap."""
    return DatasetScene(name, WallFloor(TWO_ROOMS), WallCamera(TWO_ROOMS))
