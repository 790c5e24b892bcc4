"""The drawing of the robot has the robot's size and stands where the robot stands."""

import io

import numpy as np
import pytest
import trimesh

from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.locobot_model import locobot_glb


@pytest.fixture(scope="module")
def drawing() -> trimesh.Scene:
    return trimesh.load_scene(io.BytesIO(locobot_glb()), file_type="glb")


def test_the_drawing_has_the_size_of_the_robot_and_stands_on_the_floor_around_its_origin(
    drawing: trimesh.Scene,
) -> None:
    low, high = np.asarray(drawing.bounds)
    assert (high - low)[:2] == pytest.approx([0.36, 0.36], abs=0.01)
    assert high[2] == pytest.approx(LOCOBOT.camera.height_m, abs=0.03)
    assert low[2] == pytest.approx(0.0, abs=1e-3)
    assert (low + high)[:2] / 2 == pytest.approx([0.0, 0.0], abs=0.005)
    assert len(locobot_glb()) < 1_000_000, "light enough for a page"


def test_nothing_reaches_beyond_the_body_that_physics_knows(drawing: trimesh.Scene) -> None:
    vertices = np.concatenate(
        [part.vertices for part in drawing.geometry.values() if isinstance(part, trimesh.Trimesh)]
    )
    assert np.hypot(vertices[:, 0], vertices[:, 1]).max() <= LOCOBOT.radius_m + 0.005


def test_the_camera_looks_forward(drawing: trimesh.Scene) -> None:
    lens = drawing.geometry["lens"]
    assert isinstance(lens, trimesh.Trimesh)
    assert lens.bounds[0][0] > 0
    assert lens.centroid[2] == pytest.approx(LOCOBOT.camera.height_m, abs=0.01)
