"""What a depth image shows of the things that stop a robot, as points on the floor.

Owns which heights are solid and how densely an image is read, and reads an image of a map once. What the robot saw on
its way is remembered elsewhere (`navigation.obstacle_memory`).
"""

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import rotation
from ltvn_core.types import Depth, Observation, Pose

RELEVANT_RANGE_M = 1.5
"""Things farther away cannot matter before the next image."""
_FLOOR_M, TABLE_M = 0.04, 0.65
"""Between these heights above the floor things stop a robot, as far as its own height is unknown."""
_EVERY_PIXEL = 2
_READ: WeakKeyDictionary[Observation, dict[tuple[CameraModel, float, float], NDArray[np.float64]]] = WeakKeyDictionary()
"""What images that are at hand show; forgotten with the image."""


def points_within(depth: Depth, camera: CameraModel, range_m: float) -> NDArray[np.float64]:
    """Return the points (M, 3) in the robot's frame that an image shows within a range, from every second pixel."""
    sparse = depth[::_EVERY_PIXEL, ::_EVERY_PIXEL]
    rows, columns = np.nonzero((sparse > 0) & (sparse < range_m))
    return camera.unproject(np.stack([columns, rows], axis=-1) * _EVERY_PIXEL, sparse[rows, columns])


def depths_within(depth: Depth, range_m: float) -> Depth:
    """Return the depths (M,) of the same points, in the same order."""
    sparse = depth[::_EVERY_PIXEL, ::_EVERY_PIXEL]
    return sparse[(sparse > 0) & (sparse < range_m)]


def are_solid(points: NDArray[np.float64], height_m: float = TABLE_M) -> NDArray[np.bool_]:
    """Tell which points (M, 3) are at a height at which they stop a robot of `height_m`."""
    return (points[:, 2] > _FLOOR_M) & (points[:, 2] < height_m)


def obstacle_points(
    depth: Depth | None, camera: CameraModel, range_m: float = RELEVANT_RANGE_M, height_m: float = TABLE_M
) -> NDArray[np.float64]:
    """Return (M, 2) x forward, y left of what a robot of `height_m` could hit within a range, from every second pixel.

    Without depth that is nothing: only the bumper then knows of obstacles.
    """
    if depth is None:
        return np.empty((0, 2))
    points = points_within(depth, camera, range_m)
    return points[are_solid(points, height_m), :2]


def map_points(
    image: Observation, camera: CameraModel, range_m: float, height_m: float = TABLE_M
) -> NDArray[np.float64]:
    """Return the `obstacle_points` (M, 2) of an image of a map, which is asked about again and again; read only."""
    read = _READ.setdefault(image, {})
    if (points := read.get((camera, range_m, height_m))) is None:
        points = read[camera, range_m, height_m] = obstacle_points(image.depth, camera, range_m, height_m)
        points.flags.writeable = False
    return points


def transform_points(points: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Return (M, 2) points seen from a pose (3,), in the frame that the pose is given in."""
    return points @ rotation(float(pose[2])).T + pose[:2]
