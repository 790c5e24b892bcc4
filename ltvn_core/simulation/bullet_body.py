"""A body moved by PyBullet's physics, see `ltvn_core.simulation.body`."""

import math
from collections.abc import Mapping

import numpy as np
import pybullet
from numpy.typing import NDArray

from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.simulation.body import (
    CONTACT_GAP_M,
    PERSON_HEIGHT_M,
    PERSON_RADIUS_M,
    SCENE_OBSTACLES,
    TICK_S,
    WALL_FRICTION,
    triangles_in_reach,
)
from ltvn_core.types import Pose

_FACES_PER_BODY = 40_000
"""Maximum number of faces per body; PyBullet limits the size of one mesh, so a large scene becomes several bodies."""
_SETTLING_TICKS = 8
"""Ticks at rest without contact after which the body stands where it is until something moves; Bullet finds contacts
one tick late."""


class BulletBody:
    """A cylinder among the triangles of a scene, in PyBullet. Implements `ltvn_core.simulation.body.Body`."""

    def __init__(
        self, vertices: NDArray[np.floating], faces: NDArray[np.integer], start: Pose, spec: RobotSpec
    ) -> None:
        """Create the body at `start` (3,) among the triangles of a scene.

        Args:
            vertices: (V, 3) in metres, z up, the floor at z = 0.
            faces: (F, 3) indices of vertices.
            start: (3,) x, y and yaw of the body.
            spec: The size of the body.
        """
        self._spec = spec
        self._middle_m = (spec.height_m + spec.ground_clearance_m) / 2
        self._client = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(TICK_S, physicsClientId=self._client)
        pybullet.setGravity(0, 0, 0, physicsClientId=self._client)
        self._people: dict[str, int] = {}
        self._still_ticks = 0
        self._obstacles: dict[str, list[int]] = {}
        self.set_obstacles(SCENE_OBSTACLES, vertices, faces)
        self._body = self._add_body()
        self.place(start)

    @property
    def pose(self) -> Pose:
        """Pose of the body, (3,) in the world frame."""
        return np.array([self.x_m, self.y_m, math.remainder(self.yaw_rad, 2 * math.pi)])

    @property
    def in_contact(self) -> bool:
        """Whether the body is in contact with an obstacle now."""
        if self._is_settled:
            return False
        # Bullet also lists pairs that are merely close, with a positive distance.
        contacts = pybullet.getContactPoints(bodyA=self._body, physicsClientId=self._client)
        return bool(contacts) and any(contact[8] < CONTACT_GAP_M for contact in contacts)

    @property
    def _is_settled(self) -> bool:
        """Whether the body stands free of everything, so that another tick at rest would change nothing."""
        return self._still_ticks >= _SETTLING_TICKS

    def set_obstacles(self, group: str, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        """Replace the obstacles of a group by triangles with vertices (V, 3) and faces (F, 3); no faces remove them."""
        self._still_ticks = 0
        for body in self._obstacles.pop(group, ()):
            pybullet.removeBody(body, physicsClientId=self._client)
        reached = triangles_in_reach(vertices, faces, self._spec)
        self._obstacles[group] = [self._add_obstacle(vertices, part) for part in _parts(reached)]

    def set_people(self, people: Mapping[str, tuple[float, float]]) -> None:
        """Set the positions of people by name, x and y in metres; each is a post that the robot cannot push."""
        if people or self._people:
            self._still_ticks = 0
        for person in self._people.keys() - people.keys():
            pybullet.removeBody(self._people.pop(person), physicsClientId=self._client)
        for person, (x_m, y_m) in people.items():
            if person not in self._people:
                self._people[person] = self._add_person()
            pybullet.resetBasePositionAndOrientation(
                self._people[person], (x_m, y_m, PERSON_HEIGHT_M / 2), (0, 0, 0, 1), physicsClientId=self._client
            )

    def place(self, pose: Pose) -> None:
        """Set the body to `pose` (3,), at rest."""
        self._still_ticks = 0
        self.x_m, self.y_m, self.yaw_rad = (float(value) for value in pose)
        self._set_position()
        pybullet.resetBaseVelocity(self._body, (0, 0, 0), (0, 0, 0), physicsClientId=self._client)
        pybullet.performCollisionDetection(physicsClientId=self._client)

    def tick(self, linear_m_s: float, angular_rad_s: float) -> None:
        """Move the body with the given speeds for one tick of 1/240 s, as far as obstacles allow."""
        if linear_m_s or angular_rad_s:
            self._still_ticks = 0
        elif self._is_settled:
            return
        else:
            self._still_ticks = 0 if self.in_contact else self._still_ticks + 1
        turn = angular_rad_s * TICK_S
        heading = self.yaw_rad + turn / 2
        velocity = (linear_m_s * math.cos(heading), linear_m_s * math.sin(heading), 0.0)
        # The velocity is set in every tick, because the wheels impose it; contacts then reduce it.
        pybullet.resetBaseVelocity(self._body, velocity, (0, 0, 0), physicsClientId=self._client)
        pybullet.stepSimulation(physicsClientId=self._client)
        (self.x_m, self.y_m, z_m), _ = pybullet.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        self.yaw_rad += turn  # Nothing stops a round body from turning on the spot, so its heading needs no physics.
        if abs(z_m - self._middle_m) > 1e-5:
            self._set_position()

    def close(self) -> None:
        """Free the memory; closing twice is allowed."""
        if self._client >= 0:
            pybullet.disconnect(self._client)
            self._client = -1

    def _set_position(self) -> None:
        pybullet.resetBasePositionAndOrientation(
            self._body, (self.x_m, self.y_m, self._middle_m), (0, 0, 0, 1), physicsClientId=self._client
        )

    def _add_person(self) -> int:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_CYLINDER, radius=PERSON_RADIUS_M, height=PERSON_HEIGHT_M, physicsClientId=self._client
        )
        return pybullet.createMultiBody(0, shape, physicsClientId=self._client)

    def _add_obstacle(self, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> int:
        used, local = np.unique(faces, return_inverse=True)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=vertices[used].tolist(),
            indices=local.ravel().tolist(),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=self._client,
        )
        body = pybullet.createMultiBody(0, shape, physicsClientId=self._client)
        pybullet.changeDynamics(body, -1, lateralFriction=WALL_FRICTION, physicsClientId=self._client)
        return body

    def _add_body(self) -> int:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_CYLINDER,
            radius=self._spec.radius_m,
            height=self._spec.height_m - self._spec.ground_clearance_m,
            physicsClientId=self._client,
        )
        body = pybullet.createMultiBody(1.0, shape, physicsClientId=self._client)
        pybullet.changeDynamics(
            body,
            -1,
            lateralFriction=1.0,
            linearDamping=0,
            angularDamping=0,
            localInertiaDiagonal=(0, 0, 0),  # Bullet reads zero as infinite: no contact makes the body roll or pitch.
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=self._client,
        )
        return body


def _parts(faces: NDArray[np.integer]) -> list[NDArray[np.integer]]:
    return [faces[first : first + _FACES_PER_BODY] for first in range(0, len(faces), _FACES_PER_BODY)]
