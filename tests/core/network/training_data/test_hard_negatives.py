"""Pairs across clusters are hard on purpose."""

import numpy as np

from ltvn_core.geometry import wrap_angle
from ltvn_core.network.training_data.pose_sampling import CameraVariation, ClusterSampling
from ltvn_core.network.training_data.shards import DatasetRecipe, Shard, make_shard
from ltvn_core.robots.robot_spec import LOCOBOT
from tests.core.network.training_data.box_world import two_rooms

RECIPE = DatasetRecipe(clusters=40, sampling=ClusterSampling(size=4), strangers=40)


def strangers(shard: Shard) -> np.ndarray:
    across = shard.group[shard.sources] != shard.group[shard.targets]
    return np.column_stack([shard.sources, shard.targets])[across]


def test_pairs_across_clusters_hold_neighbours_views_from_behind_and_far_ones() -> None:
    shard = make_shard(two_rooms("a"), RECIPE)
    pairs = strangers(shard)
    apart = np.linalg.norm(shard.poses[pairs[:, 0], :2] - shard.poses[pairs[:, 1], :2], axis=1)
    turn = np.abs(wrap_angle(shard.poses[pairs[:, 0], 2] - shard.poses[pairs[:, 1], 2]))
    assert len(np.unique(pairs, axis=0)) == len(pairs) > 1000
    assert ((apart < 1) & (turn > 2)).sum() > 100
    assert (apart > 3).sum() > 300
    assert (apart < 3).sum() > 300


def test_no_hard_negatives_are_drawn_where_none_are_asked_for() -> None:
    shard = make_shard(two_rooms("a"), DatasetRecipe(clusters=4, sampling=ClusterSampling(size=4), strangers=0))
    assert len(strangers(shard)) == 0


def test_a_share_of_the_clusters_is_seen_by_another_camera_and_labelled_by_the_nominal_one() -> None:
    level = make_shard(two_rooms("a"), DatasetRecipe(clusters=40, cameras=CameraVariation(share=0.0)))
    varied = make_shard(two_rooms("a"), DatasetRecipe(clusters=40, cameras=CameraVariation(share=0.5)))
    changed = (level.depth_mm != varied.depth_mm).any((1, 2))
    by_cluster = changed.reshape(40, -1)
    assert np.array_equal(by_cluster.all(1), by_cluster.any(1))
    assert 0.2 < by_cluster.all(1).mean() < 0.8
    assert np.array_equal(level.reachable, varied.reachable)


def test_cameras_stay_near_the_nominal_one() -> None:
    variation, nominal = CameraVariation(share=1.0), LOCOBOT.camera
    drawn = variation.draw(np.random.default_rng(0), 200)
    heights = np.array([camera.height_m for camera in drawn]) - nominal.height_m
    assert 0.5 * variation.height_m < np.abs(heights).max() <= variation.height_m
    assert max(abs(camera.pitch_rad) for camera in drawn) <= variation.pitch_rad
    assert {camera.width for camera in drawn} == {nominal.width}
