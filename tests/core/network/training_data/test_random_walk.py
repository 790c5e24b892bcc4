"""A random walk stays on free floor, its images are a step apart, and equal seeds give equal walks."""

import numpy as np

from ltvn_core.geometry import wrap_angle
from ltvn_core.network.training_data.random_walk import RandomPolicy, WalkRecipe, random_walk
from tests.core.network.training_data.box_world import two_rooms

POLICY = RandomPolicy()


def walk(seed: int = 0, count: int = 400) -> np.ndarray:
    return random_walk(two_rooms().floor, np.random.default_rng(seed), count, POLICY)


def test_a_random_walk_never_hits_a_wall() -> None:
    poses = walk()
    assert poses.shape == (400, 3)
    assert two_rooms().floor.at(poses[:, :2]).min() >= POLICY.clearance_m


def test_images_are_a_step_apart_either_driven_or_turned() -> None:
    moved = np.diff(walk(), axis=0)
    metres, turned = np.hypot(moved[:, 0], moved[:, 1]), np.abs(wrap_angle(moved[:, 2]))
    driven = metres > 0
    assert metres[driven].min() > 0.8 * POLICY.step_m
    assert metres.max() < 1.2 * POLICY.step_m
    assert turned[~driven].min() > 0.8 * POLICY.turn_rad
    assert turned.max() < 1.2 * POLICY.turn_rad
    assert 0.2 < driven.mean() < 0.9


def test_actions_are_held_and_the_walk_gets_somewhere() -> None:
    poses = walk()
    assert np.ptp(poses[:, :2], axis=0).max() > 2.0


def test_the_same_seed_walks_the_same_way_and_each_walk_is_a_group() -> None:
    recipe = WalkRecipe(walks=2, images=30)
    first, again = (recipe.make(two_rooms()) for _ in range(2))
    assert np.array_equal(first.poses, again.poses)
    assert np.array_equal(first.rgb, again.rgb)
    assert np.bincount(first.group).tolist() == [30, 30]
    assert len(first.sources) == 0
