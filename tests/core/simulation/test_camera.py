"""The camera measures true depths, sees left on the left, and says when it sees nothing."""

import logging
import platform
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import SceneError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.rendering.renderer_opening import open_renderer
from ltvn_core.simulation.scene_registry import Scene, load_scene
from ltvn_core.simulation.surfaces import SurfaceBuilder, Surfaces
from ltvn_core.types import Depth, Pose

RED, GREEN, GREY = (220, 30, 30), (30, 200, 30), (128, 128, 128)
LENS = LOCOBOT.camera


@dataclass(frozen=True)
class Seen:
    """All that `open_renderer` asks of a scene."""

    surfaces: Surfaces
    clearance: ClearanceMap
    name: str = "test room"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("train-00")


def test_depth_is_that_of_a_box_room() -> None:
    camera = EmbreeRenderer(_box_room(6.0, 4.0, 2.5))
    for pose in ((3.0, 2.0, 0.0), (1.0, 1.0, 0.7), (5.0, 3.0, -2.5), (3.0, 2.0, np.pi / 2)):
        _, depth = camera.render(np.array(pose), LENS)
        assert depth.shape == (72, 96)
        assert depth.dtype == np.float32
        assert depth == pytest.approx(_depth_in_box(np.array(pose), 6.0, 4.0, 2.5), abs=2e-3)


def test_depth_ends_at_ten_metres() -> None:
    camera = EmbreeRenderer(_box_room(24.0, 4.0, 2.5))
    _, near = camera.render(np.array([14.1, 2.0, 0.0]), LENS)
    _, far = camera.render(np.array([13.9, 2.0, 0.0]), LENS)
    assert near[36, 48] == pytest.approx(9.9, abs=1e-3)
    assert far[36, 48] == 0
    assert far.max() <= 10


def test_where_there_is_nothing_depth_is_zero() -> None:
    builder = SurfaceBuilder()
    builder.box(builder.texture(_plain(GREY)), (3.0, 0.0, 0.3), (0.2, 0.2, 0.4))
    rgb, depth = EmbreeRenderer(builder.build()).render(np.array([0.0, 0.0, np.pi]), LENS)
    assert not depth.any()
    assert rgb.shape == (72, 96, 3)


def test_what_stands_on_the_left_is_seen_on_the_left() -> None:
    builder = SurfaceBuilder()
    builder.box(builder.texture(_plain(RED)), (2.0, 0.8, 0.5), (0.3, 0.6, 1.0))
    builder.box(builder.texture(_plain(GREEN)), (2.0, -0.8, 0.5), (0.3, 0.6, 1.0))
    rgb, depth = EmbreeRenderer(builder.build()).render(np.zeros(3), LENS)
    assert _columns_of(rgb, RED).max() < 48 <= _columns_of(rgb, GREEN).min()
    assert depth[36, _columns_of(rgb, RED)].max() > 0


def test_what_stands_on_the_floor_is_seen_below() -> None:
    builder = SurfaceBuilder()
    builder.box(builder.texture(_plain(RED)), (2.0, 0.0, 0.2), (0.3, 0.3, 0.4))
    _, depth = EmbreeRenderer(builder.build()).render(np.zeros(3), LENS)
    assert depth[:36].max() == 0
    assert depth[36:].max() > 1.8


@pytest.mark.parametrize(
    "lens",
    [CameraModel.from_fov(320, 180, np.deg2rad(69.4), height_m=0.6), CameraModel.from_fov(17, 31, 1.0, height_m=1.2)],
)
def test_another_lens_shows_the_same_world(lens: CameraModel) -> None:
    pose = np.array([1.5, 2.5, 0.4])
    rgb, depth = EmbreeRenderer(_box_room(6.0, 4.0, 2.5)).render(pose, lens)
    assert rgb.shape == (lens.height, lens.width, 3)
    assert depth == pytest.approx(_depth_in_box(pose, 6.0, 4.0, 2.5, lens), abs=2e-3)


def test_a_camera_tilted_down_sees_the_floor_where_it_points() -> None:
    lens = CameraModel.from_fov(97, 73, np.deg2rad(69.4), height_m=0.6, pitch_rad=-0.5)
    _, depth = EmbreeRenderer(_box_room(6.0, 4.0, 2.5)).render(np.array([1.0, 2.0, 0.0]), lens)
    assert depth[36, 48] == pytest.approx(lens.height_m / np.sin(0.5), abs=0.02)


def test_smoothing_changes_edges_and_leaves_depth_alone(scene: Scene) -> None:
    pose = scene.clearance.sample_poses(np.random.default_rng(2), 1)[0]
    smooth, depth = EmbreeRenderer(scene.surfaces).render(pose, LENS)
    jagged, same = EmbreeRenderer(scene.surfaces, supersampling=1).render(pose, LENS)
    assert np.array_equal(depth, same)
    changed = (smooth != jagged).any(-1).mean()
    assert 0 < changed < 0.6


def test_opening_a_camera_says_how_fast_it_is(scene: Scene, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    camera = open_renderer(scene)
    assert "per second" in caplog.text
    rgb, depth = camera.render(scene.clearance.sample_poses(np.random.default_rng(3), 1)[0], LENS)
    assert rgb.std() > 2
    assert depth.any()


@pytest.mark.parametrize(("machine", "advice"), [("x86_64", "pip install 'ltvn"), ("aarch64", "ltvn replay")])
def test_without_the_renderer_the_message_says_what_to_do(
    machine: str, advice: str, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    with pytest.raises(SceneError, match=advice):
        open_renderer(scene)


def test_a_blank_scene_is_refused(scene: Scene) -> None:
    builder = SurfaceBuilder()
    builder.box(builder.texture(_plain(GREY)), (900.0, 900.0, 0.5), (1.0, 1.0, 1.0))
    with pytest.raises(SceneError, match=r"first image of scene test room.* blank"):
        open_renderer(Seen(builder.build(), scene.clearance))


def _box_room(width: float, depth: float, height: float) -> Surfaces:
    """Return the inside of a box from (0, 0, 0) on."""
    builder = SurfaceBuilder()
    middle, size = (width / 2, depth / 2, height / 2), (width, depth, height)
    for axis in range(3):
        for side in (-0.05, size[axis] + 0.05):
            at, thick = list(middle), [length + 0.2 for length in size]
            at[axis], thick[axis] = side, 0.1
            builder.box(builder.texture(_plain(GREY)), (at[0], at[1], at[2]), (thick[0], thick[1], thick[2]))
    return builder.build()


def _depth_in_box(pose: Pose, width: float, depth: float, height: float, lens: CameraModel = LENS) -> Depth:
    """Return the depth (H, W) that a pinhole camera measures inside a box."""
    left = (lens.width / 2 - 0.5 - np.arange(lens.width)) / lens.fx
    up = (lens.height / 2 - 0.5 - np.arange(lens.height)) / lens.fx
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    rays = np.stack(np.broadcast_arrays(cos - sin * left[None], sin + cos * left[None], up[:, None]), -1)
    eye = np.array([pose[0], pose[1], lens.height_m])
    with np.errstate(divide="ignore"):
        to_walls = (np.where(rays > 0, np.array([width, depth, height]), 0.0) - eye) / rays
    return np.abs(to_walls).min(-1).astype(np.float32)


def _plain(colour: tuple[int, int, int]) -> np.ndarray:
    return np.full((1, 1, 3), colour, np.uint8)


def _columns_of(rgb: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Return the columns in which a primary colour dominates."""
    channel = int(np.argmax(colour))
    others = np.delete(rgb.astype(int), channel, axis=-1).max(-1)
    return np.unique(np.flatnonzero((rgb[..., channel] > others + 60).any(0)))
