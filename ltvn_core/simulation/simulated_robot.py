"""The simulated LoCoBot: body, drive lease, odometry and camera behind the `Robot` protocol.

Holds the robot's clock and the count of control steps. Time passes only in `advance`, so the robot cannot move while
its program hangs. `drive` and `stop` may be called from any thread, everything else from one thread. Colours are
rendered lazily, because they take most of the rendering time and most images are used only for their depth.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import SceneError, WorldError
from ltvn_core.navigation.events import WorldChanged
from ltvn_core.robots.drive_lease import LEASE_S, DriveLease
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.body import TICK_S, TICKS_PER_SECOND
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.simulation.body_selection import open_body
from ltvn_core.simulation.changes.world import WorldFollower
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.wheel_odometry import Drivetrain, Odometer, OdometryNoise
from ltvn_core.types import (
    CONTROL_STEP_S,
    Depth,
    FrameId,
    Observation,
    Pose,
    Renderer,
    Rgb,
    RobotState,
    Twist,
)
from ltvn_core.worlds import WorldChange

if TYPE_CHECKING:
    from ltvn_core.simulation.changes.world import World
    from ltvn_core.simulation.scene import Scene

_NO_COLOURS = np.empty((0, 0, 3), np.uint8)
_TICKS_PER_STEP = round(CONTROL_STEP_S * TICKS_PER_SECOND)
_TICKS_BETWEEN_COLLISIONS = round(0.2 * TICKS_PER_SECOND)
_GRID_TOLERANCE_M = 0.05
"""Greatest error of a start's clearance due to the cells of the clearance map, in metres."""


@runtime_checkable
class DepthFirstRenderer(Protocol):
    """A renderer that can render depth first and colours later."""

    def measure(self, pose: Pose, camera: CameraModel) -> tuple[Callable[[], Rgb], Depth]:
        """Return the depth (H, W), and a function that renders the rgb (H, W, 3) of the current scene."""
        ...


class RenderedObservation(Observation):
    """An observation whose `rgb` is rendered at its first use, from the world at the time of the image."""

    __slots__ = ("_render",)
    _render: Callable[[], Rgb] | None

    @classmethod
    def take(
        cls,
        render: Callable[[], Rgb],
        depth: Depth,
        *,
        odometry: Pose,
        stamp: float,
        step: FrameId,
        exact_pose: Pose,
    ) -> Self:
        """Create an observation with the colours that `render` returns."""
        taken = cls(_NO_COLOURS, depth, odometry, stamp, step, exact_pose)
        object.__setattr__(taken, "_render", render)
        object.__delattr__(taken, "rgb")  # So that its first use calls `__getattr__`.
        return taken

    def __getattr__(self, name: str) -> Rgb:
        if name != "rgb":
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        render = self._render
        if render is not None:  # Another thread may have rendered the colours meanwhile.
            object.__setattr__(self, "rgb", render())
            object.__setattr__(self, "_render", None)  # Frees the memory of the ray casts.
        return object.__getattribute__(self, "rgb")


class SimulatedRobot:
    """A LoCoBot in a scene. Implements `ltvn_core.robots.robot.Robot`."""

    def __init__(
        self,
        scene: "Scene",
        renderer: Renderer,
        *,
        start: Pose,
        rng: np.random.Generator,
        odometry_noise: OdometryNoise | None = None,
        first_step: FrameId = 0,
        lease_s: float = LEASE_S,
        spec: RobotSpec = LOCOBOT,
        world: "World | None" = None,
        body: BodyName = "auto",
    ) -> None:
        """Create a robot at `start` (3,), where its odometry is exact.

        Args:
            scene: The scene of the robot.
            renderer: Renders its images.
            start: Pose (3,) in the world frame.
            rng: Draws the errors of the odometry.
            odometry_noise: Standard deviations of these errors.
            first_step: Number of the first control step, to continue the count of another run.
            lease_s: Seconds for which a drive command is valid.
            spec: The size, speeds and camera of the robot.
            world: The changing world of the scene; the robot, its camera and its bumper follow it.
            body: Name of the body, see `ltvn_core.simulation.body_selection`.

        Raises:
            SceneError: `start` lies inside an obstacle, or the body needs PyBullet, which is missing.
        """
        self.world = world
        """The changing world; None if nothing ever changes."""
        scene = scene if world is None else world.scene
        self._clearance = scene.clearance
        self._renderer = renderer
        self._spec = spec
        self._clock = SimulatorClock(self)
        start = _checked_free_pose(start, self._clearance, spec.radius_m)
        self._body = open_body(body, *scene.collision_triangles(), start, spec)
        self._odometer = Odometer(start, odometry_noise or OdometryNoise(), rng)
        self._drivetrain = Drivetrain(spec.accelerations, spec.speeds)
        self._lease = DriveLease(lambda: self.stamp, valid_s=lease_s, limits=spec.speeds)
        self._collision_counter = _CollisionCounter()
        self._ticks = first_step * _TICKS_PER_STEP
        self._owed_ticks = 0.0
        self._step = first_step
        self._ticks_in_step = 0
        self._observation: Observation | None = None
        self._measured: tuple[object, tuple[Callable[[], Rgb], Depth]] | None = None
        """What the camera last saw, and from where in which world."""
        self._follower = None if world is None else WorldFollower(world, self._body, renderer)
        if world is not None:
            world.enter(self, spec.radius_m)
            world.follow(self._follow)

    @property
    def spec(self) -> RobotSpec:
        """Properties of the simulated robot."""
        return self._spec

    @property
    def clock(self) -> "SimulatorClock":
        """The simulator's clock, which advances only when a caller advances it."""
        return self._clock

    @property
    def step(self) -> FrameId:
        """Number of the control step; it increases every 0.1 s of robot time and at each `teleport`."""
        return self._step

    @property
    def stamp(self) -> float:
        """Seconds on the robot's clock."""
        return self._ticks * TICK_S

    @property
    def exact_pose(self) -> Pose:
        """The true pose (3,) in the world frame; only oracle, evaluation, recording and display may read it."""
        return self._body.pose

    @property
    def speeds(self) -> Twist:
        """The speeds at which the wheels drive and turn the robot now."""
        return self._drivetrain.speeds

    @property
    def collisions(self) -> int:
        """Number of collisions so far; one collision ends after 0.2 s without contact."""
        return self._collision_counter.count

    def drive(self, twist: Twist) -> None:
        """Command a velocity for the duration of a lease; may be called from any thread.

        A velocity beyond the limits is scaled down along its arc.

        Raises:
            ValueError: A speed is NaN or infinite; the robot stops.
        """
        self._lease.grant(twist)

    def stop(self) -> None:
        """Brake now and stand still until the next `drive`; may be called from any thread."""
        self._lease.cancel()

    def state(self) -> RobotState:
        """Return odometry, time and bumper without taking an image."""
        return RobotState(
            odometry=self._odometer.pose, stamp=self.stamp, step=self._step, bumper_pressed=self._collision_counter.now
        )

    def observe(self) -> Observation:
        """Take an observation, or return the one already taken in this control step."""
        if self._observation is None or self._observation.step != self._step:
            rgb, depth = self._measure()
            self._observation = RenderedObservation.take(
                rgb,
                depth,
                odometry=self._odometer.pose,
                stamp=self.stamp,
                step=self._step,
                exact_pose=self.exact_pose,
            )
        return self._observation

    def render(self, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Render another camera at the robot's pose, for display; neither recorded nor used by the method."""
        self._show_world()
        return self._renderer.render(self.exact_pose, camera)

    def advance(self, duration_s: float) -> None:
        """Let `duration_s` seconds of robot time pass, in ticks of 1/240 s; the remainder is carried over.

        Raises:
            ValueError: The duration is negative, NaN or infinite.
        """
        if not (math.isfinite(duration_s) and duration_s >= 0):
            raise ValueError(f"Time only moves forward: expected seconds >= 0, got {duration_s}.")
        self._owed_ticks += duration_s * TICKS_PER_SECOND
        # Sums of 0.1 s are not exact; without the tolerance, a step would sometimes lack its last tick.
        whole = int(self._owed_ticks + 1e-6)
        self._owed_ticks -= whole
        for _ in range(whole):
            self._tick()

    def apply(self, change: WorldChange) -> None:
        """Change the world by hand, see `World.apply`.

        Raises:
            WorldError: The change is impossible, or the robot has no world.
        """
        if self.world is None:
            raise WorldError("This robot's scene does not change. Give the robot a world when you create it.")
        self.world.apply(change)

    def teleport(self, pose: Pose) -> None:
        """Put the robot at `pose` (3,), at rest; odometry restarts there, and a new control step begins.

        Raises:
            SceneError: `pose` lies inside an obstacle.
        """
        pose = _checked_free_pose(pose, self._clearance, self._spec.radius_m)
        if self.world is not None and self._follower is not None:
            self.world.make_room(pose)
            self._follower.follow_people()
        self._lease.cancel()
        self._drivetrain.halt()
        self._body.place(pose)
        self._odometer.restart(pose)
        self._collision_counter.reset()
        self._step += 1
        self._ticks_in_step = 0

    def close(self) -> None:
        """Leave the world and free the body's memory; closing twice is allowed."""
        if self.world is not None:
            self.world.unfollow(self._follow)
            self.world.leave(self)
        self._body.close()

    def _follow(self, events: Sequence[WorldChanged]) -> None:
        """Update body and camera to the current world.

        Begins a new step if this step already has an image, because that image shows the old world.
        """
        assert self._follower is not None
        self._clearance = self._follower.follow()
        if self._observation is not None and self._observation.step == self._step:
            self._step += 1
            self._ticks_in_step = 0

    def _measure(self) -> tuple[Callable[[], Rgb], Depth]:
        """Return the depth of the robot's own camera, and a function that renders the colours.

        A robot that stands in a world that does not change sees what it saw before.
        """
        self._show_world()
        seen_from = self.exact_pose.tolist(), None if self.world is None else self.world.state
        if self._measured is None or self._measured[0] != seen_from:
            if isinstance(self._renderer, DepthFirstRenderer):
                draw, depth = self._renderer.measure(self.exact_pose, self._spec.camera)
                self._measured = seen_from, (cache(draw), depth)
            else:
                rgb, depth = self._renderer.render(self.exact_pose, self._spec.camera)
                self._measured = seen_from, (lambda: rgb, depth)
        return self._measured[1]

    def _show_world(self) -> None:
        """Update the renderer to the current world."""
        if self._follower is not None:
            self._follower.show()

    def _tick(self) -> None:
        body = self._body
        x_m = body.x_m
        y_m = body.y_m
        yaw_rad = body.yaw_rad
        body.tick(*self._drivetrain.follow(self._lease.command(), TICK_S))
        dx = body.x_m - x_m
        dy = body.y_m - y_m
        cos = math.cos(yaw_rad)
        sin = math.sin(yaw_rad)
        self._odometer.move(cos * dx + sin * dy, cos * dy - sin * dx, body.yaw_rad - yaw_rad)
        self._collision_counter.update(body.in_contact)
        self._count_tick()

    def _count_tick(self) -> None:
        self._ticks += 1
        self._ticks_in_step += 1
        if self._ticks_in_step == _TICKS_PER_STEP:
            self._step += 1
            self._ticks_in_step = 0
            if self.world is not None and self._follower is not None:
                self.world.advance_to(self.stamp)
                self._follower.follow_people()


class SimulatorClock:
    """A simulated robot's time. Implements `ltvn_core.robots.robot.Clock`."""

    is_simulated = True

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot

    def now(self) -> float:
        """Return the seconds on the robot's clock."""
        return self._robot.stamp

    def advance(self, duration_s: float) -> None:
        """Let robot time pass, see `SimulatedRobot.advance`."""
        self._robot.advance(duration_s)


class _CollisionCounter:
    """Counts collisions; intermittent contact, as in sliding along a wall, counts once."""

    def __init__(self) -> None:
        self.count = 0
        self.reset()

    def reset(self) -> None:
        """Start without contact; the count is kept."""
        self.now = False
        self._free_ticks = _TICKS_BETWEEN_COLLISIONS

    def update(self, in_contact: bool) -> None:
        """Add the state of the bumper in one tick."""
        self.now = in_contact
        if not in_contact:
            self._free_ticks += 1
            return
        if self._free_ticks >= _TICKS_BETWEEN_COLLISIONS:
            self.count += 1
        self._free_ticks = 0


def _checked_free_pose(pose: Pose, clearance: ClearanceMap, radius_m: float) -> Pose:
    pose = np.asarray(pose, np.float64)
    if pose.shape != (3,) or not np.all(np.isfinite(pose)):
        raise ValueError(f"A pose is three finite numbers (x, y in metres, yaw in radians), got {pose}.")
    clearance_m = float(clearance.at(pose[:2]))
    if clearance_m < radius_m - _GRID_TOLERANCE_M:
        raise SceneError(
            f"The robot cannot stand at x {pose[0]:.2f} m, y {pose[1]:.2f} m: the nearest obstacle is "
            f"{clearance_m:.2f} m away and its radius is {radius_m} m. Choose a free place, for instance from "
            "clearance.sample_poses."
        )
    return pose
