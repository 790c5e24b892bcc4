"""A scripted mapping drive: the robot visits all rooms of a scene several times and records images.

It stands in for a person who drives the robot with the keyboard. It plans with the clearance map and follows its path
by the exact pose, because a person sees the scene too, but it moves through the same physics, drive lease and odometry
as any driver.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import wrap_angle
from ltvn_core.robots.robot_view import IMAGE_EVERY_M, IMAGE_EVERY_RAD, has_moved
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.types import CONTROL_STEP_S, Observation, Pose, Twist

LED_M_S = 0.45
"""Speed at which a person leads a robot along a path, in metres per second."""


class PathFollower:
    """Follows one path to its end (pure pursuit)."""

    def __init__(
        self,
        path: NDArray[np.float64],
        *,
        speed_m_s: float = 0.4,
        lookahead_m: float = 0.3,
        turn_first_rad: float = 0.5,
        arrived_m: float = 0.15,
    ) -> None:
        """Follow `path`, (M, 2) x and y in metres.

        The robot steers towards the first point that is farther away than `lookahead_m`, turns on the spot above a
        heading error of `turn_first_rad`, and stops within `arrived_m` of the end.
        """
        self.path = path
        self._speed_m_s = speed_m_s
        self._lookahead_m = lookahead_m
        self._turn_first_rad = turn_first_rad
        self._arrived_m = arrived_m
        self._ahead = 0

    def twist(self, pose: Pose) -> Twist | None:
        """Return the velocity to drive with from a pose (3,); None at the end of the path."""
        path = self.path
        if np.hypot(*(path[-1] - pose[:2])) < self._arrived_m:
            return None
        while self._ahead < len(path) - 1 and np.hypot(*(path[self._ahead] - pose[:2])) < self._lookahead_m:
            self._ahead += 1
        return self._towards(pose, path[self._ahead])

    def _towards(self, pose: Pose, point: NDArray[np.float64]) -> Twist:
        offset = point - pose[:2]
        heading_error = float(wrap_angle(np.arctan2(offset[1], offset[0]) - pose[2]))
        if abs(heading_error) > self._turn_first_rad:
            return Twist(0.0, float(np.sign(heading_error)))
        angular_rad_s = float(np.clip(2.5 * heading_error, -1.0, 1.0))
        return Twist(self._speed_m_s * float(np.cos(heading_error)), angular_rad_s)


@dataclass(frozen=True, slots=True)
class TourSettings:
    """Settings of the driving and of the images (all values are ours)."""

    image_every_m: float = IMAGE_EVERY_M
    """Distance after which an image is taken, in metres."""
    image_every_rad: float = IMAGE_EVERY_RAD
    """Change of heading after which an image is taken, in radians."""
    spin_loops: int = 2
    """Number of loops, from the first, with a full turn in each room, for images in all directions."""
    speed_m_s: float = 0.4
    lookahead_m: float = 0.3
    """Distance of the point on the path that the robot steers towards (pure pursuit)."""
    turn_first_rad: float = 0.5
    """Heading error above which the robot turns on the spot."""
    arrived_m: float = 0.15
    """Distance within which a stop counts as reached, in metres."""
    stop_clearance_m: float = 0.34
    """Clearance of the stops, so that the robot can turn freely; less if a room has no such place."""
    large_room_m2: float = 14.0
    """Area above which a room has two stops in each loop, in square metres."""
    back_off_steps: int = 8
    """Number of control steps for which the robot drives back after a collision."""
    timeout_factor: float = 4.0
    """Factor on the time of a path at `speed_m_s` after which the path is given up."""


def drive_tour(
    robot: SimulatedRobot,
    scene: Scene,
    rng: np.random.Generator,
    *,
    loops: int,
    settings: TourSettings | None = None,
) -> Iterator[Observation]:
    """Drive through all rooms `loops` times and yield the observations taken on the way.

    Every second loop goes the other way round, because the map needs both directions of a corridor.
    """
    driver = _Driver(robot, scene.clearance, settings or TourSettings())
    yield from driver.capture()
    for loop in range(loops):
        stops = _round_trip(_stops(scene, rng, driver.settings), robot.exact_pose[:2], rng)
        for stop in stops if loop % 2 == 0 else stops[::-1]:
            yield from driver.drive_to(stop)
            if loop < driver.settings.spin_loops:
                yield from driver.spin(float(rng.choice([-1.0, 1.0])))
    robot.stop()


def drive_along(
    robot: SimulatedRobot, scene: Scene, path: NDArray[np.float64], settings: TourSettings | None = None
) -> Iterator[Observation]:
    """Drive along a path, (M, 2) x and y in metres, and yield the observations taken on the way."""
    driver = _Driver(robot, scene.clearance, settings or TourSettings())
    yield from driver.capture()
    yield from driver.follow(path)
    robot.stop()


class _Driver:
    """Drives to points and takes images on the way."""

    def __init__(self, robot: SimulatedRobot, clearance: ClearanceMap, settings: TourSettings) -> None:
        self.settings = settings
        self._robot = robot
        self._clearance = clearance
        self._last_capture_odometry: Pose | None = None

    def drive_to(self, goal: NDArray[np.float64]) -> Iterator[Observation]:
        """Drive to a point (2,); plan a new path after each collision, at most four times."""
        for _ in range(5):
            path = self._clearance.path(self._robot.exact_pose[:2], goal)
            if path is None:
                return
            collisions_before = self._robot.collisions
            yield from self.follow(path)
            if self._robot.collisions == collisions_before:
                return
            yield from self._hold(Twist(-0.2, 0.0), self.settings.back_off_steps)

    def spin(self, direction: float) -> Iterator[Observation]:
        """Make a full turn on the spot, counter-clockwise for a direction of +1."""
        turned = 0.0
        yaw = self._robot.exact_pose[2]
        while turned < 2 * np.pi:
            yield from self._hold(Twist(0.0, direction), 1)
            turned += abs(float(wrap_angle(self._robot.exact_pose[2] - yaw)))
            yaw = self._robot.exact_pose[2]

    def capture(self) -> Iterator[Observation]:
        """Take an image if the robot has moved enough since the last one."""
        odometry = self._robot.state().odometry
        last = self._last_capture_odometry
        settings = self.settings
        if last is None or has_moved(last, odometry, by_m=settings.image_every_m, by_rad=settings.image_every_rad):
            self._last_capture_odometry = odometry
            yield self._robot.observe()

    def follow(self, path: NDArray[np.float64]) -> Iterator[Observation]:
        """Drive along a path (M, 2), until its end or a collision."""
        settings = self.settings
        collisions_before = self._robot.collisions
        follower = PathFollower(
            path,
            speed_m_s=settings.speed_m_s,
            lookahead_m=settings.lookahead_m,
            turn_first_rad=settings.turn_first_rad,
            arrived_m=settings.arrived_m,
        )
        length = float(np.hypot(*np.diff(path, axis=0).T).sum())
        for _ in range(int(settings.timeout_factor * (length / settings.speed_m_s + 6) / CONTROL_STEP_S)):
            twist = follower.twist(self._robot.exact_pose)
            if twist is None or self._robot.collisions > collisions_before:
                return
            yield from self._hold(twist, 1)

    def _hold(self, twist: Twist, steps: int) -> Iterator[Observation]:
        for _ in range(steps):
            self._robot.drive(twist)
            self._robot.advance(CONTROL_STEP_S)
            yield from self.capture()


def _stops(scene: Scene, rng: np.random.Generator, settings: TourSettings) -> list[NDArray[np.float64]]:
    """Draw the stops (2,) in each room; rooms without navigable floor have none."""
    stops = []
    for room in scene.rooms:
        cells = _clear_points(scene.clearance, (room.x0, room.y0, room.x1, room.y1), settings.stop_clearance_m)
        visits = 2 if room.area_m2 > settings.large_room_m2 else 1
        stops += [cells[rng.integers(len(cells))] for _ in range(visits if len(cells) else 0)]
    return stops


def _clear_points(
    clearance: ClearanceMap, edges: tuple[float, float, float, float], clearance_m: float
) -> NDArray[np.float64]:
    """Return the navigable points (N, 2) in a rectangle that have a clearance; without any, the points with the
    largest."""
    rows_columns = np.argwhere(clearance.navigable)
    points = clearance.origin + (rows_columns[:, ::-1] + 0.5) * clearance.resolution_m
    x0, y0, x1, y1 = edges
    inside = (points[:, 0] > x0) & (points[:, 0] < x1) & (points[:, 1] > y0) & (points[:, 1] < y1)
    points = points[inside]
    available_m = clearance.grid[tuple(rows_columns[inside].T)]
    if len(points) == 0:
        return points
    return points[available_m >= min(clearance_m, available_m.max() - 0.02)]


def _round_trip(
    stops: Sequence[NDArray[np.float64]], start: NDArray[np.float64], rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Order the stops by the nearest neighbour rule, with distances randomized so that loops differ."""
    remaining = list(stops)
    order = []
    here = start
    while remaining:
        distances = [np.hypot(*(stop - here)) * rng.uniform(0.7, 1.5) for stop in remaining]
        here = remaining.pop(int(np.argmin(distances)))
        order.append(here)
    return order
