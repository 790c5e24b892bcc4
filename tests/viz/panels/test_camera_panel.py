"""What the robot sees, as the page gets it; without a browser."""

import io

import numpy as np
import pytest
import viser
from PIL import Image

from ltvn_core.types import Rgb
from ltvn_viz.panels.camera_panel import GAP, MOST_COLUMNS, CameraPanel, colour_beside_depth, depth_colours
from ltvn_viz.session.snapshot import CameraImage, Snapshot
from tests.viz.panels.panel_contents import nothing


def noise(rows: int, columns: int) -> Rgb:
    return np.random.default_rng(0).integers(0, 256, (rows, columns, 3), np.uint8)


@pytest.mark.parametrize("size", [(72, 96), (240, 320)])
def test_the_pixels_of_the_method_are_sent_as_they_are_beside_their_depth(size: tuple[int, int]) -> None:
    rgb = noise(*size)
    depth = np.full(size, 1.0, np.float32)
    sent = colour_beside_depth(CameraImage(rgb, depth))
    np.testing.assert_array_equal(sent[:, : size[1]], rgb)
    np.testing.assert_array_equal(sent[:, size[1] + GAP :], depth_colours(depth))


def test_what_travels_is_hardly_less_than_the_pixels(gui: viser.GuiApi) -> None:
    sent: list[bytes] = []
    rgb = noise(72, 96)
    CameraPanel(gui, sent.append, nothing).show(Snapshot(camera=CameraImage(rgb, None)))
    decoded = np.asarray(Image.open(io.BytesIO(sent[0])))[:, :96].astype(int)
    assert np.abs(decoded - rgb).mean() < 4  # Noise is the worst that a JPEG can be given.


def test_a_huge_image_is_made_smaller_in_its_own_shape() -> None:
    rows, columns = colour_beside_depth(CameraImage(noise(800, 1600), None)).shape[:2]
    assert ((columns - GAP) // 2, rows) == (MOST_COLUMNS, 320)


def test_near_is_lighter_than_far_and_no_return_is_black() -> None:
    near, far, none = depth_colours(np.array([[0.5, 4.0, 0.0]], np.float32))[0].astype(int)
    assert near.sum() > far.sum() > none.sum() == 0


def test_the_camera_is_sent_at_most_fifteen_times_a_second(gui: viser.GuiApi) -> None:
    now = [0.0]
    panel = CameraPanel(gui, nothing, nothing, clock=lambda: now[0])
    views = [CameraImage(np.full((72, 96, 3), k, np.uint8), np.ones((72, 96), np.float32)) for k in range(30)]
    shown = []
    for view in views:
        now[0] += 1 / 30
        panel.show(Snapshot(camera=view))
        shown.append(panel.shown)
    assert 10 <= len({id(view) for view in shown}) <= 16


def test_a_robot_that_stands_before_the_same_is_not_sent_again(gui: viser.GuiApi) -> None:
    sent: list[bytes] = []
    now = [0.0]
    panel = CameraPanel(gui, sent.append, nothing, clock=lambda: now[0])
    for seen in (1, 1, 2, 2, 1):
        now[0] += 1.0
        panel.show(Snapshot(camera=CameraImage(np.full((72, 96, 3), seen, np.uint8), None)))
    assert len(sent) == 3


def test_a_larger_picture_is_sent_once_as_it_came_and_its_end_is_told(gui: viser.GuiApi) -> None:
    sent: list[bytes] = []
    panel = CameraPanel(gui, nothing, sent.append)
    for larger in (b"", b"one", b"one", b""):
        panel.show(Snapshot(larger=larger))
    assert sent == [b"\0one", b"\0"]
