"""What stands in the robot's way, as far as its depth images showed it in the last moments.

Owns the points and for how long they are remembered: a door frame leaves the image before the robot has passed it.
Sees nothing that no image showed, and nothing low close by. Decides nothing: `navigation.obstacle_avoidance` does.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative, rotation
from ltvn_core.navigation.depth_points import RELEVANT_RANGE_M, obstacle_points, transform_points
from ltvn_core.navigation.moving_obstacles import MovingObstacles
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import FrameId, Observation, Pose

_REMEMBERED_IMAGES = 12
_UPDATE_AFTER_M = 0.07
_UPDATE_AFTER_RAD = 0.08
"""An image shows what is ahead for longer than a control step; each costs as much as the rest of the step."""
_COLLISION_MEMORY_STEPS = 100
"""A collision is forgotten after so many control steps, because its place is a guess that may close a door."""
_BUMPER_MARGIN_M = 0.02
"""What was hit is assumed this far outside the robot."""
_AHEAD_M, _ASIDE_M = 1.1, 0.5
"""What moves within this rectangle before the robot is close ahead,"""
_ABOUT_S = 30.0
"""Who was seen moving is about for so long."""
_MOVING_POINTS = 8
"""if so many points of it do."""
_SIDES_M = 0.15 * np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
"""From what moves the robot keeps so much more distance."""
_COLLISION_BEARINGS_RAD = np.deg2rad(np.repeat([-12.0, 0.0, 12.0], 3))
"""Each point counts three times, so that it is not taken for noise."""


def _widened(moving: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return points (M, 2) that move as they may be in the next moment: here, or a little to any side."""
    return [moving, *(moving + side for side in _SIDES_M)] if len(moving) else []


class _Collision(NamedTuple):
    step: FrameId
    rim: NDArray[np.float64]
    """(M, 2) where the bumper was, in the odometry frame."""
    backwards: bool


class ObstacleMemory:
    """Solid points of the last images, kept where odometry puts them."""

    def __init__(self, spec: RobotSpec, *, watches_movement: bool = False) -> None:
        """Know nothing yet; one that `watches_movement` keeps apart what moves."""
        self._camera = spec.camera
        self._bumper_m = round(spec.clear_radius_m + _BUMPER_MARGIN_M, 3)
        self._seen: deque[NDArray[np.float64]] = deque(maxlen=_REMEMBERED_IMAGES)
        self._collisions: deque[_Collision] = deque()
        self._movement = MovingObstacles(spec.camera) if watches_movement else None
        self._moving = np.empty((0, 2))
        """(M, 2) what moves, where the newest image saw it, in the odometry frame."""
        self._moved_at = -np.inf
        self._last_step = -1
        self._last_pose: Pose | None = None

    def is_outdated(self, odometry: Pose) -> bool:
        """Tell whether a robot at `odometry` (3,) has moved so far since the last image that a new image is needed."""
        if self._last_pose is None:
            return True
        gap = relative(self._last_pose, odometry)
        return bool(np.hypot(gap[0], gap[1]) > _UPDATE_AFTER_M or abs(gap[2]) > _UPDATE_AFTER_RAD)

    def add(self, observation: Observation) -> None:
        """Remember what an image shows; the same image again changes nothing, and one without depth hides nothing."""
        if observation.step == self._last_step:
            return
        while self._collisions and observation.step - self._collisions[0].step > _COLLISION_MEMORY_STEPS:
            self._collisions.popleft()
        self._last_step, self._last_pose = observation.step, observation.odometry
        if not observation.has_depth:
            return
        here = obstacle_points(observation.depth, self._camera)
        points = transform_points(here, observation.odometry)
        if self._movement is not None:
            moving = self._movement.moving(observation, points)
            points, self._moving = points[~moving], points[moving]
            if len(self._moving) >= _MOVING_POINTS or self._movement.sees_somebody:
                self._moved_at = observation.stamp
        self._seen.append(points)

    def saw_movement(self, stamp: float) -> bool:
        """Tell whether anything moved in sight not long before `stamp` seconds, so that it may be anywhere now."""
        return stamp - self._moved_at < _ABOUT_S

    def moves_ahead(self, odometry: Pose) -> bool:
        """Tell whether something moves close ahead of a robot at `odometry` (3,)."""
        ahead, left = ((self._moving - odometry[:2]) @ rotation(float(odometry[2]))).T
        close = (ahead > 0) & (ahead < _AHEAD_M) & (np.abs(left) < _ASIDE_M)
        return bool(np.count_nonzero(close) >= _MOVING_POINTS)

    def bump(self, odometry: Pose, *, backwards: bool) -> None:
        """Remember a collision before, or behind, a robot at `odometry` (3,).

        No image need have shown it. Where on the bumper it was is unknown, so a narrow piece in the middle is believed;
        what is wider is found collision by collision.
        """
        yaw = float(odometry[2]) + (np.pi if backwards else 0.0)
        directions = yaw + _COLLISION_BEARINGS_RAD
        rim = self._bumper_m * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        self._collisions.append(_Collision(self._last_step, odometry[:2] + rim, backwards))

    def nearby_points(self, odometry: Pose, *, backwards: bool = False) -> NDArray[np.float64]:
        """Return (M, 2) all remembered points in the frame of a robot at `odometry` (3,), those nearby.

        What was hit while backing up counts only for backing up; for the way ahead the camera knows better.
        """
        collision_points = [bump.rim for bump in self._collisions if backwards or not bump.backwards]
        if not self._seen and not collision_points:
            return np.empty((0, 2))
        points = (np.concatenate([*self._seen, *collision_points, *_widened(self._moving)]) - odometry[:2]) @ rotation(
            float(odometry[2])
        )
        return points[np.abs(points).max(axis=1) < RELEVANT_RANGE_M]
