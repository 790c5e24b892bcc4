"""Which image of what the robot sees is shown, and what it costs."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.cameras.original_images import OriginalSize, compress_original
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation, Pose, Twist
from ltvn_viz.session.camera_feed import IMAGES_PER_S, STILL_S, LargerFeed, image_of
from tests.viz.session_harness import SessionHarness
from tests.waiting import until

AHEAD = Twist(0.4, 0.4)
FINE, COARSE = b"fine", b"coarse"


class Drawn:
    """A renderer that remembers from where it drew."""

    def __init__(self) -> None:
        self.poses: list[Pose] = []

    def __call__(self, pose: Pose, is_fine: bool) -> bytes:
        self.poses.append(pose)
        return FINE if is_fine else COARSE


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


def test_the_pixels_of_the_method_are_shown_and_nothing_else_is_drawn_while_no_page_shows_the_camera(
    harness: SessionHarness, drawn: Drawn
) -> None:
    harness.state.shows_camera = lambda: False
    harness.driver.twist = AHEAD
    shown = harness.wait(20)
    seen = harness.state.live.observation
    assert seen is not None
    assert shown.camera is not None
    np.testing.assert_array_equal(shown.camera.rgb, seen.rgb)
    assert shown.larger == b""
    assert drawn.poses == []


def test_a_larger_picture_is_drawn_beside_the_method_s_while_a_page_shows_the_camera(harness: SessionHarness) -> None:
    harness.driver.twist = AHEAD
    shown = harness.until(lambda now: now.larger == COARSE)
    assert shown.camera is not None


def test_where_nobody_can_draw_a_larger_one_the_method_s_image_is_the_only_one(tmp_path: Path) -> None:
    shown = SessionHarness(tmp_path).wait(5)
    assert shown.camera is not None
    assert shown.larger == b""


def test_a_robot_that_stands_is_drawn_once_more_finely_and_then_no_more(drawn: Drawn) -> None:
    now = [0.0]
    feed = LargerFeed(drawn, clock=lambda: now[0])
    pose = np.zeros(3)

    def shows(jpeg: bytes) -> bool:
        now[0] += 1 / IMAGES_PER_S
        return feed.latest_image(pose, is_shown=True).jpeg == jpeg

    until(lambda: feed.latest_image(pose, is_shown=True).jpeg == COARSE)
    now[0] += STILL_S
    until(lambda: shows(FINE))
    for _ in range(20):
        shows(FINE)
    feed.close()
    assert len(drawn.poses) == 2


def test_a_picture_that_cannot_be_drawn_leaves_the_place_to_the_method_s() -> None:
    def render(pose: Pose, is_fine: bool) -> bytes:
        if is_fine:
            raise RuntimeError("no renderer any more")
        return COARSE

    feed = LargerFeed(render)
    until(lambda: feed.latest_image(np.zeros(3), is_shown=True).jpeg == COARSE)
    until(lambda: feed.latest_image(np.zeros(3), is_shown=True).jpeg == b"")
    feed.close()


@pytest.mark.parametrize("columns", [48, 96, 320])
def test_a_robot_s_own_image_is_shown_where_it_is_larger_than_the_method_s(columns: int) -> None:
    rgb = np.zeros((72, 96, 3), np.uint8)
    camera = LOCOBOT.camera.scaled(columns, columns * 3 // 4)
    own = compress_original(np.zeros((camera.height, camera.width, 3), np.uint8), camera, OriginalSize())
    seen = Observation(rgb=rgb, depth=None, odometry=np.zeros(3), stamp=0.0, step=0, original=own)
    assert image_of(seen).original == (own.jpeg if columns > 96 else b"")


def test_a_standing_robot_sees_what_changes_before_it(harness: SessionHarness) -> None:
    first = harness.wait(5).camera
    frames = harness.now.moment.frames
    later = harness.wait(6)
    assert later.camera is not first
    assert later.moment.frames == frames
