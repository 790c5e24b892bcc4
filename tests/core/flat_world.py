"""A small flat world for tests: rooms made of line segments, a robot that obeys at once, and a predictor that knows.

Owns no assertion. Images are blank; what the predictor compares are exact poses, which it reads as an oracle would.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import compose, relative, wrap_angle
from ltvn_core.network.training_data.temporal_rules import TAU_STEPS
from ltvn_core.robots.robot import Clock
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import (
    CONTROL_STEP_S,
    ZERO_TWIST,
    Features,
    FrameId,
    Observation,
    Pose,
    Prediction,
    RobotState,
    Twist,
    Waypoint,
)

RADIUS_M = LOCOBOT.clear_radius_m


@dataclass(frozen=True)
class FlatWorld:
    """Walls as segments (W, 2, 2)."""

    walls: np.ndarray

    def clearance(self, xy: np.ndarray) -> np.ndarray:
        """Return metres (...) from points (..., 2) to the nearest wall."""
        start, along = self.walls[:, 0], self.walls[:, 1] - self.walls[:, 0]
        offset = xy[..., None, :] - start
        t = np.clip((offset * along).sum(-1) / (along**2).sum(-1), 0, 1)
        return np.linalg.norm(offset - t[..., None] * along, axis=-1).min(-1)

    def line_free(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Tell (N,) whether the robot fits along straight lines from (N, 2) to (N, 2)."""
        share = np.linspace(0, 1, 20)[:, None, None]
        return np.all(self.clearance(starts + share * (ends - starts)) > RADIUS_M - 0.01, axis=0)  # type: ignore[return-value]


def box(width: float, height: float) -> list[list[list[float]]]:
    """Return the four walls of a room with one corner at the origin."""
    corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]
    return [[corners[k], corners[(k + 1) % 4]] for k in range(4)]


def one_room() -> FlatWorld:
    """Return an empty room of 5 m x 4 m."""
    return FlatWorld(np.array(box(5.0, 4.0)))


def two_rooms() -> FlatWorld:
    """Return two rooms of 3 m x 4 m with a door of 1 m between them."""
    wall = [[[3.0, 0.0], [3.0, 1.5]], [[3.0, 2.5], [3.0, 4.0]]]
    return FlatWorld(np.array([*box(6.0, 4.0), *wall]))


class FlatClock:
    """The clock of a `FlatRobot`: whole control steps."""

    is_simulated = True

    def __init__(self, robot: "FlatRobot") -> None:
        self._robot = robot

    def now(self) -> float:
        return self._robot.state().stamp

    def advance(self, duration_s: float) -> None:
        for _ in range(round(duration_s / CONTROL_STEP_S)):
            self._robot.advance()


class FlatRobot:
    """Obeys at once, slides nowhere, and drifts if told to."""

    spec = LOCOBOT

    def __init__(self, world: FlatWorld, pose: Sequence[float], *, first_step: int = 0, drift: float = 0.0) -> None:
        self.world = world
        self.pose = np.array(pose, np.float64)
        self.step = first_step
        self.collisions = 0
        self.stops = 0
        self.twist = ZERO_TWIST
        self._bumped = False
        self._odometry = np.zeros(3)
        self._drift = drift
        self.clock: Clock = FlatClock(self)

    def observe(self) -> Observation:
        """Take a blank picture that carries the exact pose."""
        return observation_at(self.pose, self.step, self._odometry)

    def state(self) -> RobotState:
        return RobotState(self._odometry.copy(), self.step * CONTROL_STEP_S, self.step, self._bumped)

    def drive(self, twist: Twist) -> None:
        self.twist = twist

    def stop(self) -> None:
        self.stops += 1
        self.twist = ZERO_TWIST

    def put_down(self, pose: Sequence[float], odometry: Sequence[float]) -> None:
        """Stand elsewhere from now on, with odometry that began anew."""
        self.pose, self._odometry = np.array(pose, np.float64), np.array(odometry, np.float64)

    def advance(self) -> None:
        """Let one control step pass."""
        self.step += 1
        move = np.array([self.twist.linear_m_s * CONTROL_STEP_S, 0.0, self.twist.angular_rad_s * CONTROL_STEP_S])
        after = compose(self.pose, move)
        free = float(self.world.clearance(after[:2]))
        bumps = bool(move[0]) and free < RADIUS_M and free < float(self.world.clearance(self.pose[:2]))
        if bumps:
            after[:2] = self.pose[:2]
            move[0] = 0.0
            self.collisions += not self._bumped
        self._bumped = bumps
        self.pose = after
        self._odometry = compose(self._odometry, move * np.array([1 + self._drift, 1.0, 1.0]))


def observation_at(pose: Pose, step: FrameId, odometry: Pose | None = None) -> Observation:
    """Return a blank picture taken at a pose."""
    pose = np.array(pose, np.float64)
    depth = np.full((72, 96), 5.0, np.float32)
    return Observation(
        np.zeros((72, 96, 3), np.uint8),
        depth,
        pose if odometry is None else odometry.copy(),
        step * CONTROL_STEP_S,
        step,
        pose,
    )


@dataclass
class FlatPredictor:
    """Knows the world; can be told lies. Features are exact poses and the frame number, (N, 4)."""

    world: FlatWorld
    sight_m: float = 2.0
    lies: dict[tuple[FrameId, FrameId], Waypoint] = field(default_factory=dict)
    """Pairs of frames it calls reachable, with the waypoint it claims."""
    fingerprint: str = "flat"
    camera: CameraModel = LOCOBOT.camera
    encoded: int = 0
    compared: int = 0

    def encode(self, observations: Sequence[Observation]) -> Features:
        self.encoded += len(observations)
        return np.array([[*seen.exact_pose, seen.step] for seen in observations if seen.exact_pose is not None])

    def predict(self, sources: Features, targets: Features) -> Prediction:
        sources, targets = (np.asarray(each, np.float64) for each in np.broadcast_arrays(sources, targets))
        self.compared += len(targets)
        waypoints = relative(sources[:, :3], targets[:, :3])
        away, bearing = np.hypot(waypoints[:, 0], waypoints[:, 1]), np.arctan2(waypoints[:, 1], waypoints[:, 0])
        ahead = (away < 0.25) | (np.abs(bearing) < 0.6)
        seen = ahead & (away < self.sight_m) & (np.abs(waypoints[:, 2]) < 1.05)
        seen[seen] = self.world.line_free(sources[seen, :2], targets[seen, :2])
        reachability = np.where(seen, 0.95, 0.05)
        for k, (source, target) in enumerate(zip(sources[:, 3], targets[:, 3], strict=True)):
            if self.lies and (lie := self.lies.get((int(source), int(target)))) is not None:
                reachability[k], waypoints[k] = 0.95, lie
        return Prediction(reachability, waypoints)


def tour(points: Sequence[Sequence[float]], *, first_step: int = 0, spins: bool = True) -> Iterator[Observation]:
    """Yield pictures every 0.12 m or 10 degrees along straight lines, with a full turn at every point."""
    pose, step = np.array([*points[0], 0.0]), first_step

    def turned(angle: float) -> Iterator[Observation]:
        nonlocal step
        count = int(np.ceil(abs(angle) / np.deg2rad(10)))
        for _ in range(count):
            pose[2] = float(wrap_angle(pose[2] + angle / count))
            yield observation_at(pose, step)
            step += 3

    yield observation_at(pose, step)
    step += 3
    for point in points[1:]:
        segment = np.array(point) - pose[:2]
        yield from turned(float(wrap_angle(np.arctan2(segment[1], segment[0]) - pose[2])))
        count = int(np.ceil(np.hypot(*segment) / 0.12))
        for _ in range(count):
            pose[:2] += segment / count
            yield observation_at(pose, step)
            step += 3
        if spins:
            yield from turned(2 * np.pi)


class TemporalPredictor(FlatPredictor):
    """Calls two poses so many steps apart as they are tenths of a metre, and knows no walls."""

    def predict(self, sources: Features, targets: Features) -> Prediction:
        _, waypoints = super().predict(sources, targets)
        return Prediction(np.exp(-np.hypot(*waypoints[:, :2].T) / 0.1 / TAU_STEPS), waypoints)
