"""What a robot sees that a random policy drives: the data of systems that learn from time alone (SPTM, ViNG).

Owns the walk and the images of it. Which pairs of them are close in time, and what is made of that, is
`ltvn_core.training_data.temporal_pairs`.
"""

import json
import zlib
from dataclasses import asdict, dataclass, field
from math import radians

import numpy as np

from ltvn_core.geometry import compose
from ltvn_core.training_data.camera_variation import CameraVariation
from ltvn_core.training_data.scene_protocols import DatasetScene, FreeSpace
from ltvn_core.training_data.shard_generation import render_poses
from ltvn_core.training_data.shards import Shard
from ltvn_core.types import Pose


@dataclass(frozen=True, slots=True)
class RandomPolicy:
    """How the robot drives (the repeated actions are SPTM's; the values are ours)."""

    step_m: float = 0.12
    """Metres between images while it drives, as on a mapping tour, so that a step means the same there,"""
    turn_rad: float = radians(10)
    """and turn between images on the spot."""
    repeat: int = 4
    """Each action is held for so many steps."""
    forward: float = 0.75
    """Share of actions that drive ahead; the others turn left or right."""
    jitter: float = 0.15
    """Steps vary by up to this share, as a real robot's do,"""
    wobble_rad: float = radians(1.5)
    """and a step ahead turns by up to this."""
    clearance_m: float = 0.22
    """Nearer than this to an obstacle it bounces: it turns until the way ahead is free."""


@dataclass(frozen=True, slots=True)
class WalkRecipe:
    """Everything that decides the bytes of the walks, beside the scenes."""

    seed: int = 0
    """Seed of the policy; each scene draws from its own stream."""
    walks: int = 6
    """Walks in each scene, from places of their own,"""
    images: int = 96
    """and images of each."""
    policy: RandomPolicy = field(default_factory=RandomPolicy)
    """How the robot drives."""
    cameras: CameraVariation = field(default_factory=CameraVariation)
    """How the camera's mounting varies between walks."""

    def text(self) -> str:
        """Return the recipe as text, equal for equal recipes."""
        return json.dumps({"policy": "random", **asdict(self)}, sort_keys=True)

    def make(self, world: DatasetScene) -> Shard:
        """Walk through one scene; the shard's groups are the walks, in time, and no pair is labelled yet."""
        rng = np.random.default_rng([self.seed, zlib.crc32(world.name.encode())])
        walks = [random_walk(world.floor, rng, self.images, self.policy) for _ in range(self.walks)]
        cameras = self.cameras.draw(rng, self.walks)
        seen = [render_poses(world.camera, poses, intrinsics) for poses, intrinsics in zip(walks, cameras, strict=True)]
        return Shard(
            name=world.name,
            recipe=self.text(),
            rgb=np.concatenate([rgb for rgb, _ in seen]),
            depth_mm=np.concatenate([depth for _, depth in seen]),
            poses=np.concatenate(walks),
            group=np.repeat(np.arange(self.walks, dtype=np.int32), self.images),
            sources=np.empty(0, np.int32),
            targets=np.empty(0, np.int32),
            reachable=np.empty(0, bool),
            failed=np.empty(0, np.uint8),
            overlap=np.empty(0, np.float32),
            path_ratio=np.empty(0, np.float32),
        )


def random_walk(floor: FreeSpace, rng: np.random.Generator, count: int, policy: RandomPolicy) -> Pose:
    """Return poses (count, 3), a step apart, of a robot that drives at random and bounces off obstacles."""
    poses = [floor.sample_poses(rng, 1, min_clearance_m=max(policy.clearance_m, 0.3))[0]]
    while len(poses) < count:
        action = _draw_action(rng, policy)
        for _ in range(policy.repeat):
            pose = compose(poses[-1], _step(rng, action, policy))
            if floor.at(pose[:2]) < policy.clearance_m:
                poses += _bounce(floor, rng, poses[-1], policy)
                break
            poses.append(pose)
    return np.array(poses[:count])


def _bounce(floor: FreeSpace, rng: np.random.Generator, pose: Pose, policy: RandomPolicy) -> list[Pose]:
    """Turn to one side until the way ahead is free, at most right round."""
    side = int(rng.choice([-1, 1]))
    poses = [pose]
    while len(poses) * policy.turn_rad < 2 * np.pi:
        poses.append(compose(poses[-1], _step(rng, side, policy)))
        if _is_free_ahead(floor, poses[-1], policy):
            break
    return poses[1:]


def _draw_action(rng: np.random.Generator, policy: RandomPolicy) -> int:
    """Return 0 to drive ahead, 1 to turn left, -1 to turn right."""
    return 0 if rng.random() < policy.forward else int(rng.choice([-1, 1]))


def _step(rng: np.random.Generator, action: int, policy: RandomPolicy) -> Pose:
    share = 1 + policy.jitter * rng.uniform(-1, 1)
    if action:
        return np.array([0.0, 0.0, action * policy.turn_rad * share])
    return np.array([policy.step_m * share, 0.0, policy.wobble_rad * rng.uniform(-1, 1)])


def _is_free_ahead(floor: FreeSpace, pose: Pose, policy: RandomPolicy) -> bool:
    """Tell whether the robot could drive on for one action."""
    reach = policy.repeat * policy.step_m
    points = compose(pose, np.array([[share * reach, 0.0, 0.0] for share in (0.25, 0.5, 0.75, 1.0)]))
    return bool((floor.at(points[:, :2]) >= policy.clearance_m).all())
