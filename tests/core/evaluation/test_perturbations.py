"""Perturbations make an image worse in the way that their names say, and leave the rest of it alone."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.perturbations import (
    DROPPED_FRAMES,
    PERTURBATIONS,
    FrameLoss,
    PerturbedRobot,
    chosen_perturbations,
    depth_holes,
    perturb,
)
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation
from tests.core.flat_world import FlatRobot, observation_at, one_room

OF_ONE_IMAGE = tuple(name for name in PERTURBATIONS if name != DROPPED_FRAMES)


@pytest.fixture
def seen() -> Observation:
    rng = np.random.default_rng(0)
    coarse = rng.integers(30, 220, (9, 12, 3), np.uint8)
    return replace(observation_at(np.array([1.0, 1.0, 0.0]), 7), rgb=coarse.repeat(8, axis=0).repeat(8, axis=1))


@pytest.mark.parametrize("name", OF_ONE_IMAGE)
def test_an_image_gets_worse_and_nothing_else_changes(name: str, seen: Observation) -> None:
    before = seen.rgb.copy()
    worse = perturb(name, seen, np.random.default_rng(1), LOCOBOT.camera)
    assert worse.depth is not None
    assert (worse.rgb != seen.rgb).any() or (worse.depth != seen.depth).any()
    assert (worse.rgb.shape, worse.rgb.dtype) == (seen.rgb.shape, np.uint8)
    assert (worse.depth.shape, worse.depth.dtype) == ((72, 96), np.float32)
    assert np.isfinite(worse.depth).all()
    assert (worse.depth >= 0).all()
    assert (worse.step, worse.stamp) == (seen.step, seen.stamp)
    assert worse.exact_pose is seen.exact_pose
    np.testing.assert_array_equal(seen.rgb, before)


@pytest.mark.parametrize("name", OF_ONE_IMAGE)
def test_an_image_without_a_depth_camera_can_be_perturbed(name: str, seen: Observation) -> None:
    worse = perturb(name, replace(seen, depth=None), np.random.default_rng(1), LOCOBOT.camera)
    assert worse.depth is None


def test_holes_take_the_share_of_depth_that_was_asked_for(seen: Observation) -> None:
    worse = depth_holes(seen, np.random.default_rng(0), LOCOBOT.camera, share=0.5)
    assert worse.depth is not None
    assert (worse.depth == 0).mean() == pytest.approx(0.5, abs=0.1)


def test_frames_are_lost_in_bursts_and_in_the_share_that_was_asked_for() -> None:
    rng = np.random.default_rng(0)
    lost = np.zeros(20_000, bool)
    for k in range(1, len(lost)):
        lost[k] = FrameLoss(share=0.4, burst=6).is_lost(rng, was_lost=bool(lost[k - 1]))
    assert lost.mean() == pytest.approx(0.4, abs=0.05)
    bursts = np.count_nonzero(np.diff(lost.astype(int)) == 1)
    assert lost.sum() / bursts == pytest.approx(6, abs=0.6)


def test_a_robot_with_a_bad_camera_drives_as_before_and_shows_each_image_once() -> None:
    robot = FlatRobot(one_room(), [1.0, 1.0, 0.0])
    bad = PerturbedRobot(robot, ("noise",), seed=0)
    assert bad.observe().step == robot.observe().step
    assert (bad.observe().rgb != robot.observe().rgb).any()
    assert bad.spec is robot.spec
    assert bad.state().step == robot.state().step


def test_a_lost_frame_shows_the_last_picture_at_the_place_of_now() -> None:
    robot = FlatRobot(one_room(), [1.0, 1.0, 0.0])
    bad = PerturbedRobot(robot, ("noise", DROPPED_FRAMES), seed=0)
    shown = []
    for _ in range(60):
        shown.append(bad.observe())
        robot.advance()
    same = [np.array_equal(a.rgb, b.rgb) for a, b in pairwise(shown)]
    assert 0.1 < np.mean(same) < 0.8
    assert [seen.step for seen in shown] == list(range(60))


def test_a_perturbation_that_there_is_not_is_refused_with_those_there_are() -> None:
    assert chosen_perturbations(["all"]) == PERTURBATIONS
    assert chosen_perturbations(["blur", "flare", "blur"]) == ("blur", "flare")
    assert chosen_perturbations([]) == ()
    with pytest.raises(OptionError, match=r"no perturbation fog.* blur exposure"):
        chosen_perturbations(["blur", "fog"])
