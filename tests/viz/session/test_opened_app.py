"""The app opens with the system that the command line names, and with a camera that suits what compares its images."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from ltvn_core.errors import OptionError
from ltvn_core.navigation.events import Severity
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.options import AppOptions
from tests.core.simulation.two_room_mesh import box_house, save
from tests.repository import DEMO_MAP

pytest.importorskip("embreex")


@pytest.mark.parametrize("system", ["sorb", "meng"])  # Of which one has weights of its own.
def test_a_rival_begins_with_an_empty_map_since_the_ready_made_one_is_not_its_own(system: str, tmp_path: Path) -> None:
    steps: list[str] = []
    with ExitStack() as stack:
        state = open_app_state(AppOptions(recordings=tmp_path, system=system), stack, steps.append)
        assert any("simulator" in step for step in steps)
        assert state.live_map.system.name == system
        assert not state.live_map.graph.nodes


def test_a_map_of_another_system_is_refused(tmp_path: Path) -> None:
    options = AppOptions(recordings=tmp_path, system="sorb", map=DEMO_MAP)
    with ExitStack() as stack, pytest.raises(OptionError, match=r"--system sorb contradicts --map, which ltvn built"):
        open_app_state(options, stack)


def test_the_robot_sees_as_many_pixels_as_key_points_need(tmp_path: Path) -> None:
    house = save(box_house(), tmp_path / "house.glb")
    options = AppOptions(scene=str(house), recordings=tmp_path, predictor="geometric")
    with ExitStack() as stack:
        state = open_app_state(options, stack)
        assert state.live.robot.spec.camera.width == 320
        assert state.live_map.predictor.camera == state.live.robot.spec.camera
        assert state.live.robot.observe().rgb.shape == (240, 320, 3)


def test_textures_that_a_scene_lacks_are_said_in_the_page(tmp_path: Path) -> None:
    house = save(box_house("texture"), tmp_path / "house.obj")
    for picture in tmp_path.glob("*.png"):
        picture.unlink()
    with ExitStack() as stack:
        options = AppOptions(scene=str(house), recordings=tmp_path, predictor="geometric")
        state = open_app_state(options, stack)
        assert state.message is not None
        assert state.message.severity is Severity.WARN
        assert ".png" in state.message.text
