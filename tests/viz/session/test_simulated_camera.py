"""The camera of the app's simulated robot suits what compares its images, and what it cannot show is said."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from ltvn_core.navigation.events import Severity
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.goals import ThumbnailStore
from ltvn_viz.session.options import AppOptions
from tests.core.simulation.two_room_mesh import box_house, save

pytest.importorskip("embreex")


def test_the_robot_sees_as_many_pixels_as_key_points_need(tmp_path: Path) -> None:
    house = save(box_house(), tmp_path / "house.glb")
    options = AppOptions(scene=str(house), recordings=tmp_path, predictor="geometric")
    with ExitStack() as stack:
        state = open_app_state(options, stack, ThumbnailStore())
        assert state.live.robot.spec.camera.width == 320
        assert state.live_map.predictor.camera == state.live.robot.spec.camera
        assert state.live.robot.observe().rgb.shape == (240, 320, 3)


def test_textures_that_a_scene_lacks_are_said_in_the_page(tmp_path: Path) -> None:
    house = save(box_house("texture"), tmp_path / "house.obj")
    for picture in tmp_path.glob("*.png"):
        picture.unlink()
    with ExitStack() as stack:
        options = AppOptions(scene=str(house), recordings=tmp_path, predictor="geometric")
        state = open_app_state(options, stack, ThumbnailStore())
        assert state.message is not None
        assert state.message.severity is Severity.WARN
        assert ".png" in state.message.text
