"""Tiny data for the network's tests."""

from functools import lru_cache

import numpy as np

from ltvn_core.network.architecture import PairArchitecture, StackedArchitecture
from ltvn_core.network.optimization.training_loop import TrainingData
from ltvn_core.network.pair_evaluation import LabelledDrive
from ltvn_core.network.training_data.pose_sampling import ClusterSampling, classify_near_far, sample_drive_poses
from ltvn_core.network.training_data.shards import DatasetRecipe, Shard, render_poses
from ltvn_core.types import Observation
from tests.core.network.training_data.box_world import two_rooms

SMALL = PairArchitecture(stem=8, middle=8, tokens=16, heads=2, descriptor=16, value=8, place=8, hidden=16)
SMALL_STACKED = StackedArchitecture(stem=8, quarter=8, eighth=16, sixteenth=16, last=16, hidden=16)


@lru_cache
def tiny_shard(name: str = "a") -> Shard:
    return DatasetRecipe(clusters=8, sampling=ClusterSampling(size=6)).make(two_rooms(name))


@lru_cache
def tiny_drive() -> LabelledDrive:
    world = two_rooms()
    poses = sample_drive_poses(world.floor, np.random.default_rng(0), 40)
    near, far = classify_near_far(poses, world.floor)
    return LabelledDrive("drive", *render_poses(world.camera, poses), near, far, poses, near)


def tiny_data() -> TrainingData:
    return TrainingData([tiny_shard()], [tiny_shard("b")], [tiny_drive()])


def tiny_observations(count: int) -> list[Observation]:
    shard = tiny_shard()
    return [Observation(shard.rgb[k], shard.depth_mm[k] / np.float32(1000), np.zeros(3), 0.0, k) for k in range(count)]
