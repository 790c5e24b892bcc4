"""Odometry that jumps is put right by the depth images around the jump, and left alone where nothing slipped."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.wheel_slips import SlipTracker, without_slips
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation, Pose
from tests.repository import RECORDINGS

CAMERA = LOCOBOT.camera


@pytest.fixture(scope="module")
def drive() -> list[Observation]:
    """The first images of the demo drive, whose wheels do not slip."""
    recording = Recording.open(RECORDINGS / "demo-drive.rrd")
    return [recording.observation(frame) for frame in recording.frames[:320]]


def slipped(drive: Sequence[Observation], at: int, slip: Pose) -> list[Observation]:
    """Return the images as they come where odometry jumps by (3,), in the robot's frame, before one of them."""
    before = drive[at - 1].odometry
    jumped = [
        replace(seen, odometry=compose(compose(before, slip), relative(before, seen.odometry))) for seen in drive[at:]
    ]
    return [*drive[:at], *jumped]


def course(drive: Sequence[Observation]) -> Pose:
    """Return the odometry (N, 3) of some images, seen from the first."""
    odometry = np.array([seen.odometry for seen in drive])
    return relative(odometry[0], odometry)


def test_a_drive_that_does_not_slip_stays_as_it_is(drive: list[Observation]) -> None:
    mended = list(without_slips(drive, CAMERA))
    assert all(after is before for before, after in zip(drive, mended, strict=True))


@pytest.mark.parametrize("at", [75, 140, 265])
@pytest.mark.parametrize("slip", [(0.2, 0.0, 0.15), (-0.15, 0.0, -0.2), (0.0, 0.0, 0.3)])
def test_after_a_slip_the_course_is_what_it_would_have_been(
    drive: list[Observation], at: int, slip: tuple[float, float, float]
) -> None:
    wrong = slipped(drive, at, np.array(slip))
    gap = np.abs(relative(course(drive), course(list(without_slips(wrong, CAMERA)))))
    # An error in the heading grows with the way, so it is the heading that tells.
    assert gap[:, 2].max() < 0.08
    near = slice(at, at + 5)
    assert np.hypot(gap[near, 0], gap[near, 1]).max() < 0.12


def test_without_depth_nothing_is_mended(drive: list[Observation]) -> None:
    blind = [replace(seen, depth=None) for seen in slipped(drive, 75, np.array([0.2, 0.0, 0.2]))]
    assert np.array_equal(course(list(without_slips(blind, CAMERA))), course(blind))


def test_another_drive_begins_with_its_own_odometry(drive: list[Observation]) -> None:
    second = drive[80:120]
    starts = [second[0].step]
    wrong = slipped(drive[:80], 40, np.array([0.2, 0.0, 0.2]))
    mended = list(without_slips([*wrong, *second], CAMERA, starts))
    assert all(after is before for before, after in zip(second, mended[80:], strict=True))


def test_a_robot_that_turned_far_since_its_last_image_should_look_again(drive: list[Observation]) -> None:
    tracker = SlipTracker(CAMERA)
    here = drive[0].odometry
    assert not tracker.needs_image(here)
    tracker.see(drive[0])
    assert not tracker.needs_image(here)
    assert tracker.needs_image(compose(here, np.array([0.0, 0.0, 0.5])))
    assert tracker.needs_image(compose(here, np.array([0.4, 0.0, 0.0])))
