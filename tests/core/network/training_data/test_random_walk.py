"""A random walk stays on free floor, its images are a step apart, and equal seeds give equal walks."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.geometry import wrap_angle
from ltvn_core.network.training_data.random_walk import RandomPolicy, WalkRecipe, label_walks, random_walk
from ltvn_core.network.training_data.temporal_rules import TemporalClosenessRule, TemporalDistanceRule
from ltvn_core.network.training_data.trajectory import REACHABLE, UNKNOWN, UNREACHABLE, Trajectory, select_keyframes
from ltvn_core.network.training_data.trajectory_pairs import label_trajectory
from ltvn_core.systems.registry import system_entry
from tests.core.network.training_data.box_world import two_rooms
from tests.core.network.training_data.example_drive import observations_at, poses_turning

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


RNG = np.random.default_rng(0)


def drive(count: int = 70) -> Trajectory:
    return select_keyframes(observations_at(poses_turning(1.5, 1.5, turns=2.0)[:count]), "drive")


def test_close_in_time_is_reachable_forwards_far_is_not_and_the_rest_is_left_out() -> None:
    steps = np.array([1, 5, 6, 24, 25, 300, 0, -1, -5, -24, -25])
    kinds = [REACHABLE] * 2 + [UNKNOWN] * 2 + [UNREACHABLE] * 2 + [UNKNOWN] * 4 + [UNREACHABLE]
    assert TemporalClosenessRule().labels_by_steps(steps, RNG).tolist() == kinds


@pytest.mark.parametrize("steps", [1, 4, 8, 16, 40])
def test_labels_of_distance_are_drawn_so_that_r_tells_the_steps(steps: int) -> None:
    rule = TemporalDistanceRule()
    drawn = rule.labels_by_steps(np.full(20_000, steps), RNG)
    assert (drawn == REACHABLE).mean() == pytest.approx(np.exp(-steps / rule.tau), abs=0.015)


def test_labels_of_distance_leave_the_way_back_out_and_end_at_the_greatest() -> None:
    assert TemporalDistanceRule().labels_by_steps(np.array([0, -1, -39, -40]), RNG).tolist() == [UNKNOWN] * 3 + [
        UNREACHABLE
    ]


def test_a_drive_is_labelled_by_its_order_and_a_second_look_counts_as_far() -> None:
    pairs = label_trajectory(drive(), TemporalClosenessRule(), RNG)
    steps = pairs.targets - pairs.sources
    assert set(steps[pairs.reachable].tolist()) == {1, 2, 3, 4, 5}
    assert np.abs(steps[~pairs.reachable]).min() == 25
    # After a full turn of 37 images the robot sees the same again, and time alone cannot know.
    assert pairs.far(np.array([0]), np.array([24, 25, 37])).tolist() == [[False, True, True]]


def test_a_pair_across_a_jump_of_odometry_lacks_a_pose_and_is_left_out() -> None:
    seen = drive()
    broken = replace(seen, piece=(np.arange(len(seen.poses)) >= 30).astype(np.int32))
    pairs = label_trajectory(broken, TemporalDistanceRule(), RNG)
    assert (broken.piece[pairs.sources] == broken.piece[pairs.targets]).all()


@pytest.mark.parametrize("rival", ["sptm", "ving"])
def test_walks_become_a_shard_whose_pairs_obey_the_rule(rival: str) -> None:
    walks = WalkRecipe(walks=2, images=96).make(two_rooms())
    learning = system_entry(rival).learning
    assert learning is not None
    labelled = label_walks(walks, learning.rule, np.random.default_rng(1))
    same = walks.group[labelled.sources] == walks.group[labelled.targets]
    steps = labelled.targets - labelled.sources
    assert not labelled.reachable[~same].any()
    assert (~same).sum() > 30
    assert (steps[labelled.reachable] > 0).all()
    assert 0.1 < labelled.reachable.mean() < 0.4
    assert np.bincount(labelled.group).tolist() == [12] * 16
