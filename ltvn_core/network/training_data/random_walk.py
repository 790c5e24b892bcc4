"""Random walks in simulated scenes: training data for the baselines that learn from time alone (SPTM, ViNG).

`ltvn_core.network.training_data.temporal_rules` labels the pairs.
"""

import json
import zlib
from dataclasses import asdict, dataclass, field, replace
from math import radians

import numpy as np

from ltvn_core.geometry import compose
from ltvn_core.network.training_data.pose_sampling import CameraVariation, DatasetScene, cluster_pairs
from ltvn_core.network.training_data.reachability_labels import FreeSpace
from ltvn_core.network.training_data.shards import Shard, render_poses
from ltvn_core.network.training_data.temporal_rules import TemporalLabelRule
from ltvn_core.network.training_data.trajectory import UNKNOWN, UNREACHABLE
from ltvn_core.types import Pose


@dataclass(frozen=True, slots=True)
class RandomPolicy:
    """The random policy (repeated actions are SPTM's idea; the values are ours)."""

    step_m: float = 0.12
    """Distance between images while driving, the same as on a mapping tour, in metres."""
    turn_rad: float = radians(10)
    """Rotation between images while turning on the spot, in radians."""
    repeat: int = 4
    """Steps for which each action is repeated."""
    forward: float = 0.75
    """Share of actions that drive ahead; the others turn left or right."""
    jitter: float = 0.15
    """Largest random change of the length of a step, as a share."""
    wobble_rad: float = radians(1.5)
    """Largest random change of heading in a step ahead, in radians."""
    clearance_m: float = 0.22
    """Distance to an obstacle, in metres, below which the robot turns until the path ahead is free."""


@dataclass(frozen=True, slots=True)
class WalkRecipe:
    """Everything except the scenes that determines the walks; its JSON text identifies a dataset."""

    seed: int = 0
    """Seed of the policy; each scene has its own generator."""
    walks: int = 6
    """Number of walks in each scene, each from a random start."""
    images: int = 96
    """Number of images in each walk."""
    policy: RandomPolicy = field(default_factory=RandomPolicy)
    """The random policy."""
    cameras: CameraVariation = field(default_factory=CameraVariation)
    """How the camera's mounting varies between walks."""

    def text(self) -> str:
        """Return the recipe as JSON, equal for equal recipes."""
        return json.dumps({"policy": "random", **asdict(self)}, sort_keys=True)

    def make(self, world: DatasetScene) -> Shard:
        """Return a shard with the images of the walks in one scene.

        Its groups are the walks, in order of time; it has no pairs yet.
        """
        # The generator is seeded by the scene's name, not its position, so that adding a scene changes no other.
        rng = np.random.default_rng([self.seed, zlib.crc32(world.name.encode())])
        walks = [random_walk(world.floor, rng, self.images, self.policy) for _ in range(self.walks)]
        cameras = self.cameras.draw(rng, self.walks)
        images = [render_poses(world.camera, poses, camera) for poses, camera in zip(walks, cameras, strict=True)]
        return Shard(
            name=world.name,
            recipe=self.text(),
            rgb=np.concatenate([rgb for rgb, _ in images]),
            depth_mm=np.concatenate([depth for _, depth in images]),
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
    """Return the poses (count, 3), a step apart, of a robot that drives at random and turns away from obstacles."""
    poses = [floor.sample_poses(rng, 1, min_clearance_m=max(policy.clearance_m, 0.3))[0]]
    while len(poses) < count:
        # 0 drives ahead, 1 turns left, -1 turns right.
        action = 0 if rng.random() < policy.forward else int(rng.choice([-1, 1]))
        for _ in range(policy.repeat):
            pose = compose(poses[-1], _step(rng, action, policy))
            if floor.at(pose[:2]) < policy.clearance_m:
                poses += _turn_away(floor, rng, poses[-1], policy)
                break
            poses.append(pose)
    return np.array(poses[:count])


def _turn_away(floor: FreeSpace, rng: np.random.Generator, pose: Pose, policy: RandomPolicy) -> list[Pose]:
    """Return the poses of a turn to one side until the path ahead is free, at most a full turn."""
    side = int(rng.choice([-1, 1]))
    ahead = np.array([[share * policy.repeat * policy.step_m, 0.0, 0.0] for share in (0.25, 0.5, 0.75, 1.0)])
    poses = [pose]
    while len(poses) * policy.turn_rad < 2 * np.pi:
        poses.append(compose(poses[-1], _step(rng, side, policy)))
        if (floor.at(compose(poses[-1], ahead)[:, :2]) >= policy.clearance_m).all():
            break
    return poses[1:]


def _step(rng: np.random.Generator, action: int, policy: RandomPolicy) -> Pose:
    share = 1 + policy.jitter * rng.uniform(-1, 1)
    if action:
        return np.array([0.0, 0.0, action * policy.turn_rad * share])
    return np.array([policy.step_m * share, 0.0, policy.wobble_rad * rng.uniform(-1, 1)])


_BLOCK = 48
"""Number of consecutive images from which groups are drawn, a little more than the largest labelled distance."""
_GROUP = 12
"""Number of images of a group; each is encoded once and used in many pairs."""
_CROSS_PAIRS = 16
"""Number of pairs per group whose two images are in different groups."""


def label_walks(shard: Shard, rule: TemporalLabelRule, rng: np.random.Generator) -> Shard:
    """Return a shard of walks with labelled pairs: all within each group, and some to others.

    Images of different walks are labelled not reachable, because no robot drove from one to the other.
    """
    walk = shard.group
    time = np.arange(len(walk)) - np.searchsorted(walk, walk)
    order = np.lexsort((rng.random(len(walk)), time // _BLOCK, walk))
    group = np.empty(len(walk), np.int32)
    group[order] = np.arange(len(walk)) // _GROUP
    within = [order[ends] for ends in cluster_pairs(len(order) // _GROUP, _GROUP)]
    across = rng.integers(len(order), size=(_CROSS_PAIRS * (len(order) // _GROUP), 2))
    across = across[group[across[:, 0]] != group[across[:, 1]]]
    sources, targets = (np.concatenate(ends) for ends in zip(within, across.T, strict=True))
    labels = rule.labels_by_steps(time[targets] - time[sources], rng)
    labels = np.where(walk[sources] == walk[targets], labels, UNREACHABLE)
    known = labels != UNKNOWN
    count = int(known.sum())
    return replace(
        shard,
        group=group,
        sources=sources[known].astype(np.int32),
        targets=targets[known].astype(np.int32),
        reachable=labels[known] > UNREACHABLE,
        failed=np.zeros(count, np.uint8),
        overlap=np.full(count, np.nan, np.float32),
        path_ratio=np.full(count, np.nan, np.float32),
    )
