"""Whether a robot can drive straight to a place whose pose it knows: near enough, ahead, and nothing in between.

Owns the limits that a reachability has besides the certainty of the pose. All of them fall gradually, so that no
threshold of the method meets an edge.
"""

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.geometric_features import ImageFeatures, ImageGrid
from ltvn_core.predictors.geometric_memory import SurePose
from ltvn_core.predictors.geometric_pose import points
from ltvn_core.types import Waypoint

RANGE_M = 1.55
"""At this distance a place is as likely as not to be called reachable: depth gets uncertain, and an edge is short."""
RANGE_WIDTH_M = 0.1
TURN_RAD = float(np.deg2rad(54))
TURN_WIDTH_RAD = float(np.deg2rad(3))
BESIDE_RAD = float(np.deg2rad(105))
"""A place farther aside than this is behind the robot: the way there is that of the other direction, in reverse."""
BESIDE_WIDTH_RAD = float(np.deg2rad(5))
AT_PLACE_M = 0.25
"""A place nearer than this needs no free way: the robot is there."""

_CORRIDOR_M = 0.18
"""Half the width of the straight way that must be free."""
_FLOOR_M = 0.1
"""What is lower above the floor, the robot drives over, or it is the floor, seen not quite exactly."""
_EYE_BAND_M = 0.1
"""Where the floor is unknown only what stands within this of the camera's own height is in the way."""
_MAX_ROBOT_CAMERA_M = 0.9
"""A camera higher than this is carried, not driven; where its robot is wide nobody knows."""
_MANY_POINTS = 12.0
"""So many points of the coarse depth image in the way halve the reachability."""


def drivable_share(source: ImageFeatures, pose: SurePose, camera: CameraModel, grid: ImageGrid) -> float:
    """Return by which factor in [0, 1] the way from the source to a pose makes a place less reachable."""
    waypoint = pose.waypoint
    turned = max(abs(float(waypoint[2])), pose.turned_rad)
    share = _falling(pose.moved_m, RANGE_M, RANGE_WIDTH_M) * _falling(turned, TURN_RAD, TURN_WIDTH_RAD)
    if np.hypot(waypoint[0], waypoint[1]) < AT_PLACE_M:
        return share
    bearing = abs(float(np.arctan2(waypoint[1], waypoint[0])))
    blocked = _points_in_the_way(source, waypoint, camera, grid) / _MANY_POINTS
    return share * _falling(bearing, BESIDE_RAD, BESIDE_WIDTH_RAD) / (1 + blocked**2)


def _points_in_the_way(source: ImageFeatures, waypoint: Waypoint, camera: CameraModel, grid: ImageGrid) -> int:
    """Return how many points of the source's depth image stand within the straight way."""
    seen = np.flatnonzero(source.grid_depth)
    if not len(seen):
        return 0
    places = points(grid.rays[seen], source.grid_depth[seen]) @ source.level.T
    low, high = _obstacle_band(source, camera)
    places = places[(places[:, 2] > low) & (places[:, 2] < high), :2]
    length = float(np.hypot(waypoint[0], waypoint[1]))
    ahead = np.asarray(waypoint[:2], np.float64) / length
    along = places @ ahead
    beside = np.abs(places[:, 0] * ahead[1] - places[:, 1] * ahead[0])
    return int(np.count_nonzero((along > 0.05) & (along < length) & (beside < _CORRIDOR_M)))


def _obstacle_band(source: ImageFeatures, camera: CameraModel) -> tuple[float, float]:
    """Return between which heights, from the camera, a thing is in the way."""
    if 0 < camera.height_m <= _MAX_ROBOT_CAMERA_M and not source.has_own_tilt:
        return _FLOOR_M - camera.height_m, _EYE_BAND_M
    return -_EYE_BAND_M, _EYE_BAND_M


def _falling(value: float, middle: float, width: float) -> float:
    """Return a logistic that is 1 well below the middle and 0 well above."""
    return float(1 / (1 + np.exp(np.clip((value - middle) / width, -50, 50))))
