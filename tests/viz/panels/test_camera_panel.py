"""The robot's pictures as the page gets them, without a browser."""

import numpy as np
import viser

from ltvn_viz.panels.camera_panel import CameraPanel, colour_beside_depth, depth_colours
from ltvn_viz.session.snapshot import CameraImage, Snapshot
from tests.viz.panels.panel_contents import nothing


def test_camera_and_depth_are_shown_side_by_side_and_crisp() -> None:
    rgb = np.full((72, 96, 3), 200, np.uint8)
    depth = np.full((72, 96), 1.0, np.float32)
    picture = colour_beside_depth(CameraImage(rgb, depth))
    assert picture.shape == (240, 646, 3)
    np.testing.assert_array_equal(picture[120, 160], [200, 200, 200])


def test_near_is_lighter_than_far_and_no_return_is_black() -> None:
    near, far, none = depth_colours(np.array([[0.5, 4.0, 0.0]], np.float32))[0].astype(int)
    assert near.sum() > far.sum() > none.sum() == 0


def test_the_camera_is_sent_at_most_fifteen_times_a_second(server: viser.ViserServer) -> None:
    now = [0.0]
    panel = CameraPanel(server.gui, nothing, clock=lambda: now[0])
    views = [CameraImage(np.full((72, 96, 3), k, np.uint8), np.ones((72, 96), np.float32)) for k in range(30)]
    shown = []
    for view in views:
        now[0] += 1 / 30
        panel.show(Snapshot(camera=view))
        shown.append(panel.shown)
    assert 10 <= len({id(view) for view in shown}) <= 16
