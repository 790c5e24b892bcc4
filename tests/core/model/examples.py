"""Tiny data for the network's tests."""

from functools import lru_cache

import numpy as np

from ltvn_core.data.drives import classify_pairs, drive_poses
from ltvn_core.data.generate import DatasetRecipe, make_shard, render_all
from ltvn_core.data.sampling import ClusterSampling
from ltvn_core.data.shards import Shard
from ltvn_core.model.architecture import Architecture
from ltvn_core.model.assessment import Drive
from ltvn_core.model.training import TrainingData
from ltvn_core.types import Observation
from tests.core.data.box_world import two_rooms

SMALL = Architecture(stem=8, middle=8, tokens=16, heads=2, descriptor=16, value=8, place=8, hidden=16)


@lru_cache
def tiny_shard(name: str = "a") -> Shard:
    return make_shard(two_rooms(name), DatasetRecipe(clusters=8, sampling=ClusterSampling(size=6)))


@lru_cache
def tiny_drive() -> Drive:
    world = two_rooms()
    poses = drive_poses(world.floor, np.random.default_rng(0), 40)
    near, far = classify_pairs(poses, world.floor)
    return Drive("drive", *render_all(world.camera, poses), near, far, poses, near)


def tiny_data() -> TrainingData:
    return TrainingData([tiny_shard()], [tiny_shard("b")], [tiny_drive()])


def tiny_observations(count: int) -> list[Observation]:
    shard = tiny_shard()
    return [Observation(shard.rgb[k], shard.depth_mm[k] / np.float32(1000), np.zeros(3), 0.0, k) for k in range(count)]
