"""Closures between places that look alike are found out by the map that they make."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ltvn_core.geometry import compose, relative
from ltvn_core.graph.closure_judgement import ClosureJudgement, JudgedCourse, PassOverlay
from ltvn_core.graph.pose_graph import RelativePoses, optimise
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Pose
from tests.core.flat_world import box, observation_at
from tests.core.navigation.people_about import depth_of

LONG_M, BROAD_M = 16.0, 2.0
SLOT_M = 3.0
"""Distance between two doors of the corridor that look alike."""
NOBODY = np.array([-50.0, -50.0])
HERE, BACK = np.arange(0, 40), np.arange(79, 39, -1)
"""Rows of images at the same places, on the way there and on the way back."""


@cache
def poses() -> Pose:
    """Return a drive along the corridor and back, each image facing ahead."""
    x = np.linspace(1.0, LONG_M - 1, 40)
    there = np.column_stack([x, np.full(40, 1.0), np.zeros(40)])
    return np.concatenate([there, compose(there[::-1], np.array([0.0, 0.0, np.pi]))])


@cache
def overlay(*, blind: bool = False) -> PassOverlay:
    walls = np.array(box(LONG_M, BROAD_M))
    depths = [None if blind else depth_of(walls, NOBODY, pose) for pose in poses()]
    images = [replace(observation_at(pose, 0), depth=depth) for pose, depth in zip(poses(), depths, strict=True)]
    return PassOverlay(images, driven_m(), LOCOBOT.camera, LOCOBOT.needed_space.height_m)


def driven_m() -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses()[:, :2], axis=0).T))])


def shifted(back_m: float) -> Pose:
    """Return the poses with the way back somewhere else along the corridor."""
    moved = poses().copy()
    moved[40:, 0] += back_m
    return moved


def odometry() -> RelativePoses:
    rows = np.arange(len(poses()) - 1)
    return RelativePoses(rows, rows + 1, relative(poses()[:-1], poses()[1:]), np.full((len(rows), 3), 0.1))


def closures(true: int, false: int) -> RelativePoses:
    """Return closures between the two ways, the last ones to the door behind the right one."""
    rows = np.r_[np.linspace(5, 35, true).astype(int), np.linspace(10, 36, false).astype(int)]
    seen = relative(poses()[HERE[rows]], poses()[BACK[rows]])
    seen[true:] = compose(np.array([SLOT_M, 0.0, 0.0]), seen[true:])
    return RelativePoses(HERE[rows], BACK[rows], seen, np.full((len(rows), 3), 0.1))


def test_obstacles_where_another_pass_saw_free_floor_contradict_a_course() -> None:
    assert overlay().contradicted(poses()) == 0.0
    assert overlay().contradicted(shifted(SLOT_M)) > 0.02
    assert overlay().contradicted(shifted(0.2)) == 0.0


def test_without_depth_nothing_is_contradicted() -> None:
    assert overlay(blind=True).contradicted(shifted(SLOT_M)) == 0.0


@pytest.mark.parametrize("true", [4, 20])
def test_many_false_closures_that_agree_are_outweighed_by_what_the_depth_images_show(true: int) -> None:
    found = closures(true, false=16)
    most = optimise(poses(), odometry(), found)
    surest = ClosureJudgement(poses(), odometry(), found, driven_m(), overlay()).surest(most).course
    assert surest.kept[:true].all()
    assert not surest.kept[true:].any()
    assert np.abs(surest.poses - poses())[:, :2].max() < 0.1
    assert (surest is most) == (true == 20)


def test_a_course_that_takes_a_room_for_the_next_one_is_bent_in_one_place() -> None:
    found = closures(true=0, false=16)
    judgement = ClosureJudgement(poses(), odometry(), found, driven_m(), overlay())
    straight = judgement.straightened(JudgedCourse(optimise(poses(), odometry(), found), 0.02))
    assert straight is not None
    assert not straight.kept.any()
    assert np.abs(straight.poses - poses())[:, :2].max() < 0.1
    assert judgement.straightened(JudgedCourse(straight, 0.02)) is None
