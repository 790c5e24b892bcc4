"""Obstacle memory: obstacles near the robot, from recent depth images and collisions, and the distances to them.

Owns the points, which of them count as noise, and how long each is remembered: a door frame leaves the image before the
robot has passed it. Of low obstacles close to the robot, it has only those seen before. Decides nothing:
`navigation.steering` does.
"""

import itertools
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.depth_points import RELEVANT_RANGE_M, are_solid, points_within, transform_points
from ltvn_core.cameras.depth_scan import FREE_BEYOND_M, RANGE_M, DepthScan
from ltvn_core.geometry import relative, rotation
from ltvn_core.navigation.bystanders import BODY_M, MOVING_POINTS, Bystanders, MovingObstacles
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import FrameId, Observation, Pose

MAX_NOISE_POINTS = 2
"""Number of stray points that are ignored as noise."""
_TOLERANCE_M = 0.005
NARROW_MARGIN_M = 0.02
"""Clearance kept beside the robot in narrow places, for errors of depth, in metres."""
_FAR_M = 0.5
"""Distance from a place beyond which obstacles are ignored, in metres."""
_SAMPLES = 24


class Clearances:
    """Distances to obstacles, in the robot's frame."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        """Index obstacle points (M, 2)."""
        self._tree = KDTree(points) if len(points) > MAX_NOISE_POINTS else None

    def at(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (...) distances in metres from places (..., 2) to the nearest obstacle; inf if it is far."""
        if self._tree is None:
            return np.full(places.shape[:-1], np.inf)
        gaps, _ = self._tree.query(places, k=MAX_NOISE_POINTS + 1, distance_upper_bound=_FAR_M)
        return np.asarray(gaps)[..., -1]

    def of_lines(self, starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (C,) clearances in metres of straight lines from (C, 2) to (C, 2), without their start points."""
        share = np.linspace(0, 1, _SAMPLES + 1)[1:, None, None]
        return self.at(starts + share * (ends - starts)).min(axis=0)

    def least_m(self, wanted_m: float) -> float:
        """Return the distance in metres to keep from obstacles: the wanted one, or a little less than the present one.

        A robot that is already too close to an obstacle may move away from it, but not closer.
        """
        return min(wanted_m, float(self.at(np.zeros(2))) - _TOLERANCE_M)


_REMEMBERED_IMAGES = 40
"""Number of images that are remembered; together they cover the last metres and a full turn."""
_SURFACE_M = 0.05
"""Depth of a surface in metres: points at one bearing within it are averaged."""
_NEARER_M = 0.015
"""Distance in metres by which an earlier point may be nearer than such a surface and still belong to it. Errors of
odometry move a wall by this much; a thing that sticks out farther stays in memory, because the camera may not show it
any more."""
_UPDATE_AFTER_M = 0.07
_UPDATE_AFTER_RAD = 0.08
"""Turn after which the memory is updated, in radians. An image stays valid for longer than a control step, and an
update costs as much as the rest of the step."""
_COLLISION_MEMORY_STEPS = 100
"""Control steps after which a collision is forgotten, because its assumed place may block a door."""
_BUMPER_MARGIN_M = 0.02
"""Distance outside the robot at which a collision is assumed, in metres."""
_AHEAD_M, _ASIDE_M = 1.1, 0.5
"""Length and half width of the area in front of the robot in which moving things count as close ahead, in metres."""
_ATTENTIVE_S = 0.08
"""Age at which an image is replaced if people are near, in seconds, even if the robot has not moved."""
_KEEP_M = 0.12
"""Extra distance that the robot keeps from people, in metres."""
_NEXT_TO_M = 0.1
"""Distance from a person's body within which points count as part of the person, in metres."""
_AROUND = np.linspace(-np.pi, np.pi, 40, endpoint=False).repeat(3)
_RING = (BODY_M + _KEEP_M) * np.stack([np.cos(_AROUND), np.sin(_AROUND)], axis=-1)
"""Points (N, 2) around a person, wider than the person by `_KEEP_M`. Each counts three times, so that none is filtered
as noise."""
_SIDES_M = 0.15 * np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
"""Extra distance that the robot keeps from moving things, in metres."""
_HIT_WIDTH_M, _HIT_POINTS = 0.5, 11
"""Assumed width of an obstacle that was hit, in metres, and the number of points that represent it."""
_COLLISION_BEARINGS_RAD = np.deg2rad(np.repeat([-12.0, 0.0, 12.0], 3))
"""Bearings of the points of a collision; each point counts three times, so that it is not filtered as noise."""


def _surfaces(scan: DepthScan, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest surface at each bearing, (K, 3) averages of solid points (M, 3) and their greatest heights.

    The nearest of thousands of noisy points lies centimetres before its wall, and a narrow way would look closed.
    """
    if not len(points):
        return points
    away_m, bearing = scan.polar(points)
    bins, bin_of, count = np.unique(scan.bins(bearing), return_inverse=True, return_counts=True)
    order = np.lexsort((away_m, bin_of))
    third = np.cumsum(count) - count + np.minimum(count - 1, MAX_NOISE_POINTS)
    surface_m = away_m[order][third]
    near = np.abs(away_m - surface_m[bin_of]) < _SURFACE_M
    sums = [np.bincount(bin_of[near], weights=points[near, axis], minlength=len(bins)) for axis in (0, 1)]
    top_m = np.zeros(len(bins))
    np.maximum.at(top_m, bin_of[near], points[near, 2])
    return np.stack([*(sums / np.bincount(bin_of[near], minlength=len(bins))), top_m], axis=-1)


def _replaced(scan: DepthScan, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which earlier points (M, 3) an image replaces: it shows a surface behind them, or their own surface again.

    In the first case the obstacle is gone, or was never there, unless the image sees over it.
    """
    away_m, bearing = scan.polar(points)
    beside_m = scan.beside(bearing)
    beyond_m = away_m - beside_m
    is_again = ((beyond_m > -_NEARER_M) & (beyond_m < _SURFACE_M)).any(axis=0)
    is_visible = points[:, 2] > scan.seen_above(bearing, away_m)
    return scan.inside(bearing) & (is_again | (is_visible & scan.shows_past(bearing, away_m + FREE_BEYOND_M)))


class _Collision(NamedTuple):
    step: FrameId
    rim: NDArray[np.float64]
    """(M, 2) points of the bumper at the collision, in the odometry frame."""
    backwards: bool


class ObstacleMemory:
    """Solid points of the last images, kept where odometry puts them."""

    def __init__(self, spec: RobotSpec, *, bystanders: Bystanders | None = None) -> None:
        """Start with an empty memory; with `bystanders`, moving points are kept apart and reported to them."""
        self._camera = spec.camera
        self._height_m = spec.clear_height_m
        self._bumper_m = round(spec.clear_radius_m + _BUMPER_MARGIN_M, 3)
        self._seen: deque[NDArray[np.float64]] = deque(maxlen=_REMEMBERED_IMAGES)
        self._collisions: deque[_Collision] = deque()
        self.bystanders = bystanders or Bystanders()
        """People whom the robot met; nobody where moving things are not watched."""
        self._movement = None if bystanders is None else MovingObstacles(bystanders)
        self._moving = np.empty((0, 2))
        """(M, 2) moving points in the newest image, in the odometry frame."""
        self._last_step = -1
        self._last_stamp = -np.inf
        self._last_pose: Pose | None = None

    def is_outdated(self, odometry: Pose, stamp: float) -> bool:
        """Tell whether a robot at `odometry` (3,) at `stamp` seconds needs a new image.

        A new image is needed after each motion, and at short intervals while people are near.
        """
        if self._last_pose is None:
            return True
        gap = relative(self._last_pose, odometry)
        if np.hypot(gap[0], gap[1]) > _UPDATE_AFTER_M or abs(gap[2]) > _UPDATE_AFTER_RAD:
            return True
        return stamp - self._last_stamp > _ATTENTIVE_S and len(self.bystanders.near(stamp)) > 0

    def add(self, observation: Observation) -> None:
        """Remember the obstacles in an image; an image that repeats the last one, or has no depth, adds none."""
        if observation.step == self._last_step:
            return
        while self._collisions and observation.step - self._collisions[0].step > _COLLISION_MEMORY_STEPS:
            self._collisions.popleft()
        self._last_step = observation.step
        self._last_stamp = observation.stamp
        self._last_pose = observation.odometry
        if not observation.has_depth:
            return
        scan, things, nearby = self._read(observation)
        self._forget_replaced(scan)
        moves = np.zeros(len(things), bool) if self._movement is None else self._movement.moving(scan, things, nearby)
        points = things[nearby & ~moves]
        self._moving = things[nearby & moves, :2]
        # People are remembered separately, because their points would stay after they have left.
        for place in self.bystanders.near(observation.stamp):
            points = points[np.hypot(*(points[:, :2] - place).T) > BODY_M + _NEXT_TO_M]
        self._seen.append(_surfaces(scan, points))

    def _forget_replaced(self, scan: DepthScan) -> None:
        """Forget the points of earlier images that an image replaces."""
        if not self._seen:
            return
        ends = np.cumsum([len(points) for points in self._seen])
        points = np.concatenate(self._seen)
        kept = ~_replaced(scan, points)
        for k, (start, end) in enumerate(itertools.pairwise([0, *ends.tolist()])):
            self._seen[k] = points[start:end][kept[start:end]]

    def _read(self, observation: Observation) -> tuple[DepthScan, NDArray[np.float64], NDArray[np.bool_]]:
        """Return the scan of an image, its solid points (M, 3), and which are nearby (M,).

        A point is its position in the odometry frame and its height.
        """
        depth = observation.require_depth("obstacle avoidance")
        seen = points_within(depth, self._camera, RANGE_M)
        solid = are_solid(seen, self._height_m)
        scan = DepthScan.of(self._camera, observation.stamp, observation.odometry, seen, self._height_m)
        places = transform_points(seen[solid, :2], observation.odometry)
        return scan, np.column_stack([places, seen[solid, 2]]), seen[solid, 0] < RELEVANT_RANGE_M

    def moves_ahead(self, odometry: Pose) -> bool:
        """Tell whether something moves close ahead of a robot at `odometry` (3,)."""
        ahead, left = ((self._moving - odometry[:2]) @ rotation(float(odometry[2]))).T
        close = (ahead > 0) & (ahead < _AHEAD_M) & (np.abs(left) < _ASIDE_M)
        return bool(np.count_nonzero(close) >= MOVING_POINTS)

    def bump(self, odometry: Pose, *, backwards: bool) -> None:
        """Remember a collision in front of, or behind, a robot at `odometry` (3,).

        The obstacle may be in no image. The point of contact on the bumper is unknown, so a narrow obstacle in the
        middle is assumed; a wider obstacle causes further collisions.
        """
        yaw = float(odometry[2]) + (np.pi if backwards else 0.0)
        directions = yaw + _COLLISION_BEARINGS_RAD
        rim = self._bumper_m * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        self._collisions.append(_Collision(self._last_step, odometry[:2] + rim, backwards))

    def hit_points(self, odometry: Pose) -> NDArray[np.float64]:
        """Return (M, 2) points of a recent collision, in the frame of a robot at `odometry` (3,).

        The obstacle is assumed to lie straight across the robot's path, about as wide as the robot.
        """
        if not self._collisions:
            return np.empty((0, 2))
        rim = self._collisions[-1].rim
        across = (rim[-1] - rim[0]) / np.linalg.norm(rim[-1] - rim[0])
        line = rim.mean(axis=0) + _HIT_WIDTH_M * np.linspace(-0.5, 0.5, _HIT_POINTS)[:, None] * across
        return (line - odometry[:2]) @ rotation(float(odometry[2]))

    def nearby_points(
        self, odometry: Pose, *, backwards: bool = False, keeping_from_people: bool = True
    ) -> NDArray[np.float64]:
        """Return all remembered points (M, 2) near a robot at `odometry` (3,), in its frame.

        Collisions during backing up count only for backing up, because ahead the camera shows obstacles better. With
        `keeping_from_people`, points are added around each person, at the distance to keep.
        """
        collision_points = [bump.rim for bump in self._collisions if backwards or not bump.backwards]
        people = [place + _RING for place in self.bystanders.near(self._last_stamp)] if keeping_from_people else []
        moving = [self._moving, *(self._moving + side for side in _SIDES_M)]  # They may be beside their places next.
        known = [*(points[:, :2] for points in self._seen), *collision_points, *moving, *people]
        points = (np.concatenate(known) - odometry[:2]) @ rotation(float(odometry[2]))
        ahead, left = np.abs(points).T
        return points[(ahead < RELEVANT_RANGE_M) & (left < RELEVANT_RANGE_M)]
