"""Obstacle points on the floor from a depth image.

Owns the range of heights at which points are obstacles, the sampling of an image, and a cache for images of a map.
Obstacles seen while driving are stored in `navigation.obstacle_memory`.
"""

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import rotation
from ltvn_core.types import Depth, Observation, Pose

RELEVANT_RANGE_M = 1.5
"""Largest distance of obstacles in metres; farther ones cannot matter before the next image."""
_FLOOR_M = 0.04
"""Lowest height of obstacles above the floor, in metres; the robot's height is the highest."""
_EVERY_PIXEL = 2
_READ: WeakKeyDictionary[Observation, dict[tuple[CameraModel, float, float], NDArray[np.float64]]] = WeakKeyDictionary()
"""Cache of the obstacle points of images in memory; an entry is dropped with its image."""


def points_within(depth: Depth, camera: CameraModel, range_m: float, every: int = _EVERY_PIXEL) -> NDArray[np.float64]:
    """Return the points (M, 3) of a depth image within a range, in the robot's frame, from every second pixel, or of
    `every` other number."""
    sparse = depth[::every, ::every]
    rows, columns = np.nonzero((sparse > 0) & (sparse < range_m))
    return camera.unproject(np.stack([columns, rows], axis=-1) * every, sparse[rows, columns])


def are_solid(points: NDArray[np.float64], height_m: float) -> NDArray[np.bool_]:
    """Return which points (M, 3) are at the height of obstacles for a robot of `height_m`."""
    return (points[:, 2] > _FLOOR_M) & (points[:, 2] < height_m)


def obstacle_points(
    depth: Depth | None, camera: CameraModel, range_m: float = RELEVANT_RANGE_M, *, height_m: float
) -> NDArray[np.float64]:
    """Return the obstacle points (M, 2), x forward and y left, for a robot of `height_m`, from every second pixel.

    Without depth there are none; then only the bumper detects obstacles.
    """
    if depth is None:
        return np.empty((0, 2))
    points = points_within(depth, camera, range_m)
    return points[are_solid(points, height_m), :2]


def map_points(image: Observation, camera: CameraModel, range_m: float, *, height_m: float) -> NDArray[np.float64]:
    """Return the `obstacle_points` (M, 2) of an image of a map, with a cache; the array is read-only."""
    read = _READ.setdefault(image, {})
    if (points := read.get((camera, range_m, height_m))) is None:
        points = read[camera, range_m, height_m] = obstacle_points(image.depth, camera, range_m, height_m=height_m)
        points.flags.writeable = False
    return points


_STRIDE = 1 << 32
"""Difference between the keys of two neighbouring rows of cells, larger than any row."""


def cell_keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a number (M,) for each cell (M, 2) of a grid, so that cells can be sorted and compared."""
    return cells[:, 0] * _STRIDE + cells[:, 1]


def transform_points(points: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Transform points (M, 2) from the frame of a pose (3,) to the frame in which the pose is given."""
    return points @ rotation(float(pose[2])).T + pose[:2]
