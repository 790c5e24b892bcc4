"""The camera's mounting on the robot and its motion, from the transform tree.

Owns the guesses for incomplete bags: the frames of robot and ground, and whether the frame of the images is an optical
frame.
"""

import re
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.data.importing.rosbag.transform_tree import TransformTree
from ltvn_core.data.importing.spatial_pose import (
    BODY_FROM_OPTICAL,
    LOWEST_M,
    CameraMounting,
    SpatialPose,
    Transform,
    spatial_pose,
)

_ODOMETRY_FRAMES = ("odom", "odometry", "odom_combined")
_GROUND_FRAMES = ("base_footprint", "base_link_footprint", "footprint")
_ROBOT_FRAMES = ("base_link", "base_footprint", "base")
_DOWNWARD = re.compile(r"(^|[/_])(ned|frd)$", re.IGNORECASE)
"""Names that REP-103 and REP-105 give to frames whose z points down and whose y points to the right."""
_TURNED_OVER = np.diag([1.0, -1.0, -1.0, 1.0])
"""Rotation (4, 4) by 180 degrees around x, from such a frame to one with z up and y to the left, and back."""
_STEEP_RAD = np.radians(60.0)
"""Pitch in radians above which the image frame is probably a body frame, not an optical frame."""


class FrameEdge(NamedTuple):
    """Parent and child frame of the odometry."""

    parent: str
    child: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraRig:
    """Mounting and motion of the camera."""

    world: str
    """The frame of the odometry; "" if there is none."""
    carrier: str
    """Frame whose motion is used: that of the camera, or that of the robot if the camera's mounting is unknown."""
    turn: NDArray[np.float64]
    """Rotation (3, 3) from the optical frame to the carrier."""
    image_turn: NDArray[np.float64]
    """Rotation (3, 3) from the optical frame to the frame that the images name."""
    mounting: CameraMounting
    """Mounting of the camera on the robot; without a tilt if it is unknown."""

    def pose(self, tree: TransformTree, stamp: float) -> SpatialPose | None:
        """Return the camera's pose at a time; None if the tree does not contain it."""
        found = tree.lookup(self.world, self.carrier, stamp) if self.world else None
        if found is None:
            return None
        found = upright(self.world) @ found
        return spatial_pose(found[:3, 3], found[:3, :3] @ self.turn)


def find_rig(tree: TransformTree, camera_frame: str, odometry: FrameEdge | None, stamp: float) -> CameraRig:
    """Return how the camera sits on the robot.

    Args:
        tree: Frames as `/tf` and `/tf_static` have them.
        camera_frame: The frame that the images name.
        odometry: The frames that an odometry topic names; None if the tree has to say it.
        stamp: A moment for which the tree is known, for a camera on a moving head.
    """
    world, robot = odometry or _motion(tree, list(tree.ancestors(camera_frame)))
    robot = robot or robot_frame(tree)
    on_robot = tree.lookup(robot, camera_frame, stamp)
    if on_robot is None:
        return CameraRig(
            world=world,
            carrier=robot,
            turn=upright(robot)[:3, :3] @ BODY_FROM_OPTICAL,
            image_turn=np.eye(3),
            mounting=CameraMounting.unknown(),
        )
    on_robot = upright(robot) @ on_robot
    turn = _optical(camera_frame, on_robot)
    camera_on_robot = on_robot.copy()
    camera_on_robot[:3, :3] = on_robot[:3, :3] @ turn
    mounting = CameraMounting.of(camera_on_robot)
    if robot == camera_frame or "optical" in robot:
        mounting = CameraMounting(camera_on_robot=camera_on_robot)
    else:
        ground = next((frame for frame in sorted(tree.frames) if _last(frame) in _GROUND_FRAMES), None)
        over_ground = None if ground is None else tree.lookup(ground, camera_frame, stamp)
        height_m = mounting.height_m if over_ground is None else float(over_ground[2, 3])
        mounting = replace(mounting, height_m=height_m if height_m > LOWEST_M else 0.0)
    return CameraRig(world=world, carrier=camera_frame, turn=turn, image_turn=turn, mounting=mounting)


def upright_name(frame: str) -> str:
    """Return the name of a frame without the ending that says that its z points down."""
    return _DOWNWARD.sub("", frame)


def upright(frame: str) -> Transform:
    """Return the rotation (4, 4) that turns a frame over if its name says that its z points down."""
    return _TURNED_OVER if _DOWNWARD.search(frame) else np.eye(4)


def robot_frame(tree: TransformTree) -> str:
    """Return the frame with the usual name of a robot's frame; "base_link" if there is none."""
    frames = sorted(tree.frames)
    return next((frame for name in _ROBOT_FRAMES for frame in frames if _last(frame) == name), _ROBOT_FRAMES[0])


def _motion(tree: TransformTree, way: list[str]) -> FrameEdge:
    """Return the parent and child frame of the robot's motion: those of odometry, or else the topmost moving ones."""
    moving = [FrameEdge(parent, child) for parent, child in tree.motions]
    carrying = [edge for edge in moving if edge.child in way]
    robots = carrying or [edge for edge in moving if _last(edge.child) in _ROBOT_FRAMES]
    driven = [edge for edge in robots if _last(edge.parent) in _ODOMETRY_FRAMES]
    if driven or not carrying:
        return (driven or robots or [FrameEdge("", "")])[0]
    # The motion of a head on the robot is below the robot's own motion in the tree.
    return max(carrying, key=lambda edge: way.index(edge.child))


def _optical(frame: str, on_robot: Transform) -> NDArray[np.float64]:
    """Return the rotation (3, 3) from the optical frame to the image frame, which simulators often set to the camera's
    body."""
    if "optical" in frame:
        return np.eye(3)
    as_optical = spatial_pose(on_robot[:3, 3], on_robot[:3, :3]).tilt
    as_body = spatial_pose(on_robot[:3, 3], on_robot[:3, :3] @ BODY_FROM_OPTICAL).tilt
    is_body = abs(as_optical.pitch_rad) > _STEEP_RAD > abs(as_body.pitch_rad)
    return BODY_FROM_OPTICAL if is_body else np.eye(3)


def _last(frame: str) -> str:
    return frame.rpartition("/")[2]
