"""The interface of a body, which moves a simulated robot through a scene and detects its contacts.

Motion is planar: a body cannot rise, roll or pitch. It is a cylinder with the footprint of the base. It begins just
above the floor, so that it passes over rugs and thresholds, and ends above the height of a table, so that it collides
with everything that the camera could not pass under. Motors, drive lease and time are elsewhere.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Pose

TICKS_PER_SECOND = 240
TICK_S = 1 / TICKS_PER_SECOND

SCENE_OBSTACLES = "scene"
"""Name of the group of obstacles that a body has at first."""
PERSON_RADIUS_M = 0.25
PERSON_HEIGHT_M = 1.7

WALL_FRICTION = 0.3
"""Coefficient of friction between body and walls. The robot slides along a wall that it meets at a small angle, and
stops at a wall that it meets head on."""
CONTACT_GAP_M = 0.002
"""Distance below which the bumper is pressed, in metres."""


class Body(Protocol):
    """The robot's body in a scene: holds its true pose, moves it as far as obstacles allow, and detects contacts."""

    x_m: float
    y_m: float
    yaw_rad: float

    @property
    def pose(self) -> Pose:
        """Pose of the body, (3,) in the world frame, its yaw from -pi to pi."""
        ...

    @property
    def in_contact(self) -> bool:
        """Whether the body is in contact with an obstacle now."""
        ...

    def set_obstacles(self, group: str, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        """Replace the obstacles of a group by triangles with vertices (V, 3) and faces (F, 3); no faces remove them."""
        ...

    def set_people(self, people: Mapping[str, tuple[float, float]]) -> None:
        """Set the positions of people by name, x and y in metres; each is a post that the robot cannot push."""
        ...

    def place(self, pose: Pose) -> None:
        """Set the body to `pose` (3,), at rest."""
        ...

    def tick(self, linear_m_s: float, angular_rad_s: float) -> None:
        """Move the body with the given speeds for one tick of 1/240 s, as far as obstacles allow."""
        ...

    def close(self) -> None:
        """Free the memory; closing twice is allowed."""
        ...


def triangles_in_reach(
    vertices: NDArray[np.floating], faces: NDArray[np.integer], spec: RobotSpec
) -> NDArray[np.integer]:
    """Return the faces that overlap the body in height, because floors and ceilings would only cost time."""
    if not len(faces):
        return faces
    heights = vertices[faces, 2]
    return faces[(heights.max(axis=1) > spec.ground_clearance_m) & (heights.min(axis=1) < spec.height_m)]
