"""The simulated LoCoBot: physics, drive lease, odometry and camera behind the `Robot` protocol.

Owns the robot's clock and the count of control steps. Time moves only in `advance`; so the robot stands whenever its
simulation hangs. `drive` and `stop` may come from any thread, everything else belongs to one.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from ltvn_core.errors import SceneError
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.drive_lease import LEASE_S, DriveLease
from ltvn_core.simulation.drivetrain import Drivetrain
from ltvn_core.simulation.physics import BODY_RADIUS_M, TICK_S, TICKS_PER_SECOND, PhysicsWorld
from ltvn_core.simulation.wheel_odometry import Odometer, OdometryNoise
from ltvn_core.types import (
    CONTROL_STEP_S,
    Depth,
    FrameId,
    Intrinsics,
    Observation,
    Pose,
    Renderer,
    Rgb,
    RobotState,
    Twist,
)

if TYPE_CHECKING:
    from ltvn_core.simulation.scene import Scene

_TICKS_PER_STEP = round(CONTROL_STEP_S * TICKS_PER_SECOND)
_TICKS_BETWEEN_COLLISIONS = round(0.2 * TICKS_PER_SECOND)
_GRID_TOLERANCE_M = 0.05
"""The clearance map is a grid, and the body may stand where it says so by a cell."""


class SimulatedRobot:
    """A LoCoBot in a scene. Implements `ltvn_core.types.Robot`."""

    def __init__(
        self,
        scene: "Scene",
        camera: Renderer,
        *,
        start: Pose,
        rng: np.random.Generator,
        odometry_noise: OdometryNoise | None = None,
        first_step: FrameId = 0,
        lease_s: float = LEASE_S,
    ) -> None:
        """Put a robot at `start` (3,), where odometry is still exact; `first_step` continues another run's count.

        Raises SceneError when `start` lies inside an obstacle.
        """
        self._clearance = scene.clearance
        self._camera = camera
        self._world = PhysicsWorld(*scene.collision_triangles(), _checked_free_pose(start, self._clearance))
        self._odometer = Odometer(start, odometry_noise or OdometryNoise(), rng)
        self._drivetrain = Drivetrain()
        self._lease = DriveLease(lambda: self.stamp, valid_s=lease_s)
        self._collision_counter = _CollisionCounter()
        self._ticks = first_step * _TICKS_PER_STEP
        self._owed_ticks = 0.0
        self._step = first_step
        self._ticks_in_step = 0
        self._observation: Observation | None = None

    @property
    def step(self) -> FrameId:
        """Count of control steps; goes up every 0.1 s of robot time and when the robot is put somewhere else."""
        return self._step

    @property
    def stamp(self) -> float:
        """Seconds on the robot's clock."""
        return self._ticks * TICK_S

    @property
    def exact_pose(self) -> Pose:
        """The truth, (3,) in the world frame; only oracle, evaluation, recording and drawing may read it."""
        return self._world.pose

    @property
    def speeds(self) -> Twist:
        """How fast the wheels drive and turn the robot now."""
        return self._drivetrain.speeds

    @property
    def collisions(self) -> int:
        """How often the body came to touch something; a touch ends after 0.2 s without contact."""
        return self._collision_counter.count

    @property
    def lease_expiries(self) -> int:
        """How often a drive command ran out and the robot stopped by itself."""
        return self._lease.expiries

    def drive(self, twist: Twist) -> None:
        """Command a velocity for the length of a lease; may come from any thread.

        Raises ValueError, and stops, when a speed is NaN or infinite; too high a speed is slowed down along its arc.
        """
        self._lease.grant(twist)

    def stop(self) -> None:
        """Brake now and stand until the next `drive`; may come from any thread."""
        self._lease.cancel()

    def state(self) -> RobotState:
        """Feel the body without looking."""
        return RobotState(
            odometry=self._odometer.pose, stamp=self.stamp, step=self._step, bumper_pressed=self._collision_counter.now
        )

    def observe(self) -> Observation:
        """Take a picture, or return the one already taken in this control step."""
        if self._observation is None or self._observation.step != self._step:
            rgb, depth = self.render(Intrinsics())
            self._observation = Observation(
                rgb=rgb,
                depth=depth,
                odometry=self._odometer.pose,
                stamp=self.stamp,
                step=self._step,
                exact_pose=self.exact_pose,
            )
        return self._observation

    def render(self, intrinsics: Intrinsics) -> tuple[Rgb, Depth]:
        """Look through another lens from the same place, for a person; not recorded and not the method's."""
        return self._camera.render(self.exact_pose, intrinsics)

    def advance(self, duration_s: float) -> None:
        """Let robot time pass, in ticks of 1/240 s; what is left of a tick is carried over."""
        if not (math.isfinite(duration_s) and duration_s >= 0):
            raise ValueError(f"Time only moves forward: expected seconds >= 0, got {duration_s}.")
        self._owed_ticks += duration_s * TICKS_PER_SECOND
        whole = int(self._owed_ticks + 1e-6)
        self._owed_ticks -= whole
        for _ in range(whole):
            self._tick()

    def teleport(self, pose: Pose) -> None:
        """Lift the robot to `pose` (3,); it stands, odometry restarts there, and a new control step begins.

        Raises SceneError when `pose` lies inside an obstacle.
        """
        pose = _checked_free_pose(pose, self._clearance)
        self._lease.cancel()
        self._drivetrain.halt()
        self._world.place(pose)
        self._odometer.restart(pose)
        self._collision_counter.reset()
        self._step += 1
        self._ticks_in_step = 0

    def close(self) -> None:
        """Free the physics engine; closing twice is fine."""
        self._world.close()

    def _tick(self) -> None:
        world = self._world
        x_m, y_m, yaw_rad = world.x_m, world.y_m, world.yaw_rad
        world.tick(*self._drivetrain.follow(self._lease.command(), TICK_S))
        dx, dy = world.x_m - x_m, world.y_m - y_m
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        self._odometer.move(cos * dx + sin * dy, cos * dy - sin * dx, world.yaw_rad - yaw_rad)
        self._collision_counter.update(world.in_contact)
        self._count_tick()

    def _count_tick(self) -> None:
        self._ticks += 1
        self._ticks_in_step += 1
        if self._ticks_in_step == _TICKS_PER_STEP:
            self._step += 1
            self._ticks_in_step = 0


class _CollisionCounter:
    """Counts touches: one that flickers, as when sliding along a wall, counts once."""

    def __init__(self) -> None:
        self.count = 0
        self.reset()

    def reset(self) -> None:
        """Touch nothing."""
        self.now = False
        self._free_ticks = _TICKS_BETWEEN_COLLISIONS

    def update(self, in_contact: bool) -> None:
        """Take in what the bumper says in this tick."""
        self.now = in_contact
        if not in_contact:
            self._free_ticks += 1
            return
        if self._free_ticks >= _TICKS_BETWEEN_COLLISIONS:
            self.count += 1
        self._free_ticks = 0


def _checked_free_pose(pose: Pose, clearance: ClearanceMap) -> Pose:
    pose = np.asarray(pose, np.float64)
    if pose.shape != (3,) or not np.all(np.isfinite(pose)):
        raise ValueError(f"A pose is three finite numbers (x, y in metres, yaw in radians), got {pose}.")
    clearance_m = float(clearance.at(pose[:2]))
    if clearance_m < BODY_RADIUS_M - _GRID_TOLERANCE_M:
        raise SceneError(
            f"The robot cannot stand at x {pose[0]:.2f} m, y {pose[1]:.2f} m: the nearest obstacle is "
            f"{clearance_m:.2f} m "
            f"away and its radius is {BODY_RADIUS_M} m. Choose a free place, for instance from clearance.sample_poses."
        )
    return pose
