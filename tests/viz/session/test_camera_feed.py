"""Which image of what the robot sees is shown, and what it costs."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.types import Depth, Pose, Rgb, Twist
from ltvn_viz.session.camera_feed import LargerFeed
from ltvn_viz.session.snapshot import ImageSource, Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Action, Ask
from tests.viz.session_harness import SessionHarness

AHEAD = Twist(0.4, 0.4)


class Drawn:
    """A renderer that remembers from where it drew."""

    def __init__(self) -> None:
        self.poses: list[Pose] = []

    def __call__(self, pose: Pose) -> tuple[Rgb, Depth]:
        self.poses.append(pose)
        return np.zeros((240, 320, 3), np.uint8), np.ones((240, 320), np.float32)


@pytest.fixture
def drawn() -> Drawn:
    return Drawn()


@pytest.fixture
def harness(tmp_path: Path, drawn: Drawn) -> Iterator[SessionHarness]:
    harness = SessionHarness(tmp_path)
    feed = LargerFeed(drawn)
    harness.state.larger_feed = feed
    yield harness
    feed.close()


def switch(harness: SessionHarness, is_on: int) -> None:
    harness.do(Ask(Action.LARGER_PICTURE, is_on))


def source(now: Snapshot) -> ImageSource | None:
    return None if now.camera is None else now.camera.source


def test_the_pixels_of_the_method_are_shown_and_nothing_else_is_drawn(harness: SessionHarness, drawn: Drawn) -> None:
    harness.driver.twist = AHEAD
    shown = harness.wait(20)
    seen = harness.state.live.observation
    assert seen is not None
    assert shown.camera is not None
    np.testing.assert_array_equal(shown.camera.rgb, seen.rgb)
    assert shown.shows_larger is False
    assert drawn.poses == []


def test_a_larger_picture_is_drawn_while_it_is_asked_for(harness: SessionHarness, drawn: Drawn) -> None:
    switch(harness, 1)
    harness.until(lambda now: source(now) is ImageSource.RENDERED)
    assert harness.now.shows_larger is True
    switch(harness, 0)
    before = len(drawn.poses)
    harness.driver.twist = AHEAD
    assert source(harness.wait(20)) is ImageSource.OBSERVATION
    assert len(drawn.poses) == before


def test_where_nobody_can_draw_one_the_wish_changes_nothing(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path)
    shown = harness.do(c.Ask(c.Action.LARGER_PICTURE, 1), ticks=5)
    assert shown.shows_larger is None
    assert source(shown) is ImageSource.OBSERVATION


def test_a_standing_robot_sees_what_changes_before_it(harness: SessionHarness) -> None:
    first = harness.wait(5).camera
    frames = harness.now.moment.frames
    later = harness.wait(6)
    assert later.camera is not first
    assert later.moment.frames == frames
