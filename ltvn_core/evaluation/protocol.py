"""The evaluation protocol of the paper (section V): a mapping drive, ten goal images, and random episodes.

All methods get the same drive, goals and episodes, under the usual conditions or under harder ones, whose names are in
`condition_names`. Drives no robot.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.condition_names import CONDITION_NAMES
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.graph.operators import pose_row
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light
from ltvn_core.simulation.wheel_odometry import OdometryNoise
from ltvn_core.types import FrameId, Pose

if TYPE_CHECKING:
    from ltvn_core.simulation.scene import Scene

USUAL_LOOPS = 3
_SMALL_M2, _STEPS_M2 = 100.0, 4.0
"""Area of a home that counts as small, and the control steps for each square metre of a very large building."""
_MIN_EPISODE_M = 1.0
"""Least straight distance between start and goal, in metres."""
_MIN_GOAL_GAP_M = 1.5
"""Least distance between two goals if the scene is large enough, in metres."""


@dataclass(frozen=True, slots=True)
class EvaluationProtocol:
    """Parameters of the evaluation."""

    loops: int = USUAL_LOOPS
    """Number of loops of the mapping drive (paper: 3 to 4)."""
    goals: int = 10
    """Number of goal images (paper)."""
    episodes: int = 500
    """Number of random episodes (paper)."""
    distance_noise: float = 0.02
    """Standard deviation of odometry's error in distance, as a share of the distance (ours)."""
    angle_noise: float = 0.01
    """Standard deviation of odometry's error in angle, as a share of the angle (ours)."""
    step_limit: int | None = None
    """K: maximum number of control steps of 0.1 s in an episode. None means the paper's values: 1,000 below 100 m2 of
    floor, and 2,000 above."""
    collision_limit: int = 20
    """Number of collisions above which an episode fails (paper)."""
    slips_per_m: float = 0.0
    """Number of wheel slips per metre driven or radian turned."""
    body: BodyName = "auto"
    """Body of the simulated robot, see `ltvn_core.simulation.body_selection`."""

    def __post_init__(self) -> None:
        if self.loops < 1 or self.goals < 2 or self.episodes < 1 or self.collision_limit < 0:
            raise OptionError(
                "An evaluation needs a loop, two goals and an episode at least, and no negative limit, got "
                f"{self.loops} loops, {self.goals} goals, {self.episodes} episodes, {self.collision_limit} collisions."
            )
        if not all(0 <= share < 1 for share in (self.distance_noise, self.angle_noise, self.slips_per_m)):
            raise OptionError("Odometry noise and slips are shares from 0 to below 1; 0.05 is a bad odometer.")
        if self.step_limit is not None and self.step_limit < 1:
            raise OptionError(f"The step limit must be 1 or more, got {self.step_limit}.")

    @property
    def odometry_noise(self) -> OdometryNoise:
        """Errors of the robot's odometry, in the mapping drive and in the episodes."""
        return OdometryNoise(self.distance_noise, self.angle_noise, slips=self.slips_per_m)

    def steps_in(self, scene: "Scene") -> int:
        """Return K for a scene: the paper's in homes, and longer in buildings that are larger than any of these."""
        return self.step_limit or (1000 if scene.area_m2 < _SMALL_M2 else max(2000, round(_STEPS_M2 * scene.area_m2)))


@dataclass(frozen=True, slots=True)
class EpisodePlan:
    """Start and goal of an episode."""

    start: FrameId
    goal: FrameId
    start_pose: PoseRow
    """Exact pose of the start image, where the robot starts."""
    goal_pose: PoseRow
    """Exact pose of the goal image, for judging arrival."""


def choose_goals(
    scene: "Scene", frames: Sequence[FrameId], poses: Pose, count: int, rng: np.random.Generator
) -> tuple[FrameId, ...]:
    """Choose goal images that cover the scene: room by room, the largest first, apart from each other.

    `poses` (N, 3) are the exact poses of the N frames. Raises OptionError if there are fewer images than goals.
    """
    if len(frames) < count:
        raise OptionError(f"{count} goals need as many images, but the drive has {len(frames)}; drive more loops.")
    chosen = list[int]()
    pools = [pool for pool in _images_by_room(scene, poses) if len(pool)]
    while len(chosen) < count:
        for pool in pools[: count - len(chosen)]:
            chosen.append(_apart(np.setdiff1d(pool, chosen), poses, chosen, rng))
        # If the rooms have too few images, goals may lie between rooms.
        pools = [pool for pool in pools if len(np.setdiff1d(pool, chosen))] or [np.arange(len(frames))]
    return tuple(frames[k] for k in chosen)


def draw_episodes(
    frames: Sequence[FrameId], poses: Pose, goals: Sequence[FrameId], count: int, rng: np.random.Generator
) -> tuple[EpisodePlan, ...]:
    """Draw episodes from a random image to a random goal at another place.

    `poses` (N, 3) are the exact poses of the N frames. Raises OptionError if none is far enough from any goal.
    """
    row = {frame: k for k, frame in enumerate(frames)}
    from_goals = poses[None, :, :2] - poses[[row[goal] for goal in goals], None, :2]
    if not (np.linalg.norm(from_goals, axis=-1) > _MIN_EPISODE_M).any():
        raise OptionError(f"The drive is too short: no image is farther than {_MIN_EPISODE_M:g} m from any goal.")
    episodes = list[EpisodePlan]()
    while len(episodes) < count:
        start = int(rng.integers(len(frames)))
        goal = goals[int(rng.integers(len(goals)))]
        ends = poses[start], poses[row[goal]]
        if np.hypot(*(ends[1] - ends[0])[:2]) > _MIN_EPISODE_M:
            episodes.append(
                EpisodePlan(start=frames[start], goal=goal, start_pose=pose_row(ends[0]), goal_pose=pose_row(ends[1]))
            )
    return tuple(episodes)


def _images_by_room(scene: "Scene", poses: Pose) -> list[np.ndarray]:
    """Return the images taken in each room, the largest room first; all images if no room has any."""
    x = poses[:, 0]
    y = poses[:, 1]
    rooms = sorted(scene.rooms, key=lambda room: -room.area_m2)
    inside = [np.flatnonzero((x > r.x0) & (x < r.x1) & (y > r.y0) & (y < r.y1)) for r in rooms]
    return inside if any(map(len, inside)) else [np.arange(len(poses))]


def _apart(pool: np.ndarray, poses: Pose, chosen: Sequence[int], rng: np.random.Generator) -> int:
    """Draw an image from a pool, if possible far from those already chosen."""
    if chosen:
        gaps = np.linalg.norm(poses[pool, None, :2] - poses[None, list(chosen), :2], axis=-1).min(1)
        pool = pool[gaps >= min(_MIN_GOAL_GAP_M, gaps.max())]
    return int(rng.choice(pool))


_OF_THE_DRIVE = ("slip", "one-loop")
_SLIPPING = {"distance_noise": 0.05, "angle_noise": 0.03, "slips_per_m": 0.2}
"""Values for `slip`: 2.5 and 3 times the usual noise, and a slip every five metres or radians (ours)."""
_HALF_LIGHT = Light.of(0.5, 0.0)


def protocol_under(protocol: EvaluationProtocol, conditions: Collection[str]) -> EvaluationProtocol:
    """Return the protocol under some conditions."""
    if "slip" in conditions:
        protocol = replace(protocol, **_SLIPPING)
    return replace(protocol, loops=1) if "one-loop" in conditions else protocol


def light_under(conditions: Collection[str]) -> Light:
    """Return the light of the episodes under some conditions."""
    return _HALF_LIGHT if "half-light" in conditions else PLAIN_LIGHT


def drive_conditions(conditions: Collection[str]) -> tuple[str, ...]:
    """Return the conditions that change the mapping drive, in order."""
    return tuple(name for name in _OF_THE_DRIVE if name in conditions)


def episode_conditions(conditions: Collection[str]) -> tuple[str, ...]:
    """Return the conditions that change only the episodes, in order."""
    return tuple(name for name in CONDITION_NAMES if name in conditions and name not in _OF_THE_DRIVE)


def told_conditions(protocol: EvaluationProtocol, conditions: Collection[str]) -> tuple[str, ...]:
    """Return the conditions for tables, in order, and the number of mapping loops if it is not the usual one."""
    named = tuple(name for name in CONDITION_NAMES if name in conditions)
    usual = protocol.loops == USUAL_LOOPS or "one-loop" in named
    return named if usual else (*named, f"{protocol.loops} mapping loop{'s' if protocol.loops > 1 else ''}")
