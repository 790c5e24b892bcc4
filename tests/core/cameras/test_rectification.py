"""Whatever camera took an image, the door makes of it what the predictor's own camera would have taken."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.cameras.original_images import OriginalSize, decompress_original
from ltvn_core.cameras.rectification import rectification, rectified_camera
from ltvn_core.errors import ImageError
from ltvn_core.preprocessing import preprocess_observation, recorded_observation, rectify_observation
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import Observation

NOMINAL = LOCOBOT.camera
WIDE = CameraModel.from_fov(640, 480, np.deg2rad(95), height_m=NOMINAL.height_m)
CAMERAS = {
    "larger": CameraModel.from_fov(320, 240, NOMINAL.horizontal_fov_rad, height_m=NOMINAL.height_m),
    "wider": WIDE,
    "wide screen": CameraModel.from_fov(640, 360, np.deg2rad(100), height_m=NOMINAL.height_m),
    "oblong pixels": replace(WIDE, fy=WIDE.fy * 0.8),
    "off centre": replace(WIDE, cx=290.0, cy=260.0),
    "distorted": replace(WIDE, distortion=(0.05, -0.08, 0.002, -0.001, 0.01)),
    "fisheye": replace(WIDE, fx=240.0, fy=240.0, fisheye=True, distortion=(0.02, -0.01, 0.004, -0.001)),
    "turned to the left": replace(WIDE, width=480, height=640, cx=239.5, cy=319.5, quarter_turns=1),
    "turned to the right": replace(WIDE, width=480, height=640, cx=239.5, cy=319.5, quarter_turns=3),
    "upside down": replace(WIDE, quarter_turns=2),
    "tilted and rolled": replace(WIDE, pitch_rad=-0.12, roll_rad=0.1),
}


@pytest.fixture(scope="module")
def renderer() -> EmbreeRenderer:
    return EmbreeRenderer(load_scene("tune-0").surfaces, supersampling=3)


@pytest.fixture(scope="module")
def pose() -> np.ndarray:
    return load_scene("tune-0").clearance.sample_poses(np.random.default_rng(3), 1, min_clearance_m=0.8)[0]


def observation(rgb: np.ndarray, depth: np.ndarray | None) -> Observation:
    return Observation(rgb=rgb, depth=depth, odometry=np.zeros(3), stamp=0.0, step=3)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_a_rectified_image_is_what_the_nominal_camera_would_have_rendered(
    renderer: EmbreeRenderer, pose: np.ndarray, camera: CameraModel
) -> None:
    expected_rgb, expected_depth = renderer.render(pose, NOMINAL)
    seen = rectify_observation(observation(*renderer.render(pose, camera)), camera, NOMINAL)
    depth = seen.require_depth("the test")
    assert seen.rgb.shape == expected_rgb.shape
    assert rectification(camera, NOMINAL).seen.mean() > 0.97
    colour_error = np.abs(seen.rgb.astype(int) - expected_rgb).mean(axis=-1)
    depth_error = np.abs(depth - expected_depth) / expected_depth
    assert colour_error.mean() < 4
    assert np.median(depth_error) < 0.005
    assert np.mean(depth_error < 0.03) > 0.93


def test_images_of_the_predictors_own_camera_come_in_bit_for_bit(renderer: EmbreeRenderer, pose: np.ndarray) -> None:
    seen = observation(*renderer.render(pose, NOMINAL))
    assert rectify_observation(seen, replace(NOMINAL, height_m=0.9), NOMINAL) is seen


def test_what_the_camera_does_not_see_is_black_and_has_no_depth() -> None:
    narrow = CameraModel.from_fov(200, 150, np.deg2rad(40))
    seen = rectify_observation(
        observation(np.full((150, 200, 3), 200, np.uint8), np.full((150, 200), 2, np.float32)), narrow, NOMINAL
    )
    depth, visible = seen.require_depth("the test"), rectification(narrow, NOMINAL).seen
    assert 0.2 < visible.mean() < 0.4
    assert np.array_equal(depth > 0, visible)
    assert (seen.rgb[visible] == 200).all()
    assert not seen.rgb[~visible].any()


def test_a_lens_that_folds_shows_nothing_twice() -> None:
    folding = CameraModel(width=200, height=150, fx=150, fy=150, cx=99.5, cy=74.5, distortion=(-0.5, 0.0, 0.0, 0.0))
    target = CameraModel.from_fov(96, 72, np.deg2rad(150))
    seen = rectification(folding, target).seen
    middle = np.abs(target.pixels_to_rays(np.stack(np.meshgrid(np.arange(96.0), np.arange(72.0)), axis=-1)))
    assert not seen[np.hypot(middle[..., 0], middle[..., 1]) > 0.9].any()


def test_a_wide_picture_is_cut_and_never_squashed_where_nobody_knows_its_camera() -> None:
    picture = np.zeros((90, 300, 3), np.uint8)
    picture[30:60, 135:165] = 255  # A square.
    seen = preprocess_observation(picture, None, np.zeros(3), stamp=0.0, step=0)
    rows, columns = np.nonzero(seen.rgb[..., 0] > 127)
    assert abs(np.ptp(rows) - np.ptp(columns)) <= 1


def test_depth_in_millimetres_comes_in_as_metres_when_the_camera_says_so() -> None:
    camera = replace(NOMINAL, depth_scale=MILLIMETRES)
    black, millimetres = np.zeros((72, 96, 3), np.uint8), np.full((72, 96), 2500, np.uint16)
    seen = preprocess_observation(black, millimetres, np.zeros(3), stamp=0.0, step=0, camera=camera)
    assert seen.require_depth("the test") == pytest.approx(np.full((72, 96), 2.5))


def test_no_depth_stays_no_depth_and_says_who_needs_it() -> None:
    seen = rectify_observation(observation(np.zeros((480, 640, 3), np.uint8), None), WIDE, NOMINAL)
    assert seen.depth is None
    with pytest.raises(ImageError, match="Image 3 has no depth, and the network needs it"):
        seen.require_depth("the network")


def test_an_image_of_another_size_than_its_camera_is_refused() -> None:
    with pytest.raises(ImageError, match=r"camera.* 640 x 480"):
        preprocess_observation(np.zeros((72, 96, 3), np.uint8), None, np.zeros(3), stamp=0.0, step=0, camera=WIDE)


def test_the_rectified_camera_stands_where_the_real_one_does() -> None:
    camera = rectified_camera(replace(WIDE, height_m=0.25, pitch_rad=-0.2), NOMINAL)
    assert (camera.height_m, camera.pitch_rad, camera.width, camera.fx) == (0.25, 0.0, 96, NOMINAL.fx)


@pytest.mark.parametrize(("size", "expected"), [(OriginalSize(), (240, 320)), (OriginalSize(64, 48), (48, 64))])
def test_the_original_picture_is_kept_small_with_its_own_camera(size: OriginalSize, expected: tuple[int, int]) -> None:
    picture = np.full((480, 640, 3), 90, np.uint8)
    seen = rectify_observation(observation(picture, None), WIDE, NOMINAL, original_size=size)
    assert seen.original is not None
    assert decompress_original(seen.original).shape == (*expected, 3)
    assert (seen.original.camera.height, seen.original.camera.width) == expected
    assert seen.original.camera.horizontal_fov_rad == pytest.approx(WIDE.horizontal_fov_rad)


def test_no_original_is_kept_twice_and_none_where_none_is_wished(renderer: EmbreeRenderer, pose: np.ndarray) -> None:
    own = observation(*renderer.render(pose, NOMINAL))
    assert rectify_observation(own, NOMINAL, NOMINAL, original_size=OriginalSize()).original is None
    assert rectify_observation(observation(np.zeros((480, 640, 3), np.uint8), None), WIDE, NOMINAL).original is None


def test_another_predictor_sees_old_drives_through_their_original_pictures(
    renderer: EmbreeRenderer, pose: np.ndarray
) -> None:
    recorded = rectify_observation(
        observation(*renderer.render(pose, WIDE)), WIDE, NOMINAL, original_size=OriginalSize()
    )
    larger = CameraModel.from_fov(160, 120, NOMINAL.horizontal_fov_rad, height_m=NOMINAL.height_m)
    expected, _ = renderer.render(pose, larger)
    seen = recorded_observation(recorded, NOMINAL, larger)
    without = recorded_observation(replace(recorded, original=None), NOMINAL, larger)
    assert seen.rgb.shape == without.rgb.shape == (120, 160, 3)
    assert seen.require_depth("the test").shape == (120, 160)
    sharp, blurred = (np.abs(each.rgb.astype(int) - expected).mean() for each in (seen, without))
    assert sharp < 0.9 * blurred
