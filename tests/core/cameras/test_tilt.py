"""A camera that is held by hand has another tilt in each image; what a predictor gets is level all the same."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.original_images import compress_original
from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import ImageError
from ltvn_core.image_validity import check_observation
from ltvn_core.preprocessing import preprocess_observation, recorded_observation, rectify_observation
from ltvn_core.types import Observation, Tilt
from tests.repository import ROOT

KINECT = CameraModel(width=160, height=120, fx=129.0, fy=129.0, cx=79.5, cy=63.0, pitch_rad=-0.2)
LEVEL = CameraModel.from_fov(96, 72, np.deg2rad(69.4))

tilts = st.builds(Tilt, st.floats(-0.35, 0.35), st.floats(-0.8, 0.8))


def horizon(camera: CameraModel) -> NDArray[np.uint8]:
    """Return what a camera sees of a world that is white above its horizon and dark below."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = camera.pixels_to_rays(np.stack([columns, rows], axis=-1))
    body = np.concatenate([np.ones((*rays.shape[:2], 1)), -rays], axis=-1) @ camera.rotation.T
    return np.where(body[..., 2:] > 0, 255, 60).astype(np.uint8).repeat(3, axis=2)


def taken(tilt: Tilt | None) -> Observation:
    camera = KINECT if tilt is None else replace(KINECT, pitch_rad=tilt.pitch_rad, roll_rad=tilt.roll_rad)
    depth = np.full((120, 160), 2.0, np.float32)
    return check_observation(horizon(camera), depth, np.zeros(3), stamp=1.5, step=3, tilt=tilt)


def assert_level(rgb: NDArray[np.uint8]) -> None:
    """Check that all that is seen above the middle is sky, and below it ground, but for a row between and the rim."""
    shade = binary_erosion(rgb[..., 0] > 0) * rgb[..., 0].astype(int)
    upper, lower = shade[: LEVEL.height // 2 - 1], shade[LEVEL.height // 2 + 1 :]
    assert (upper[upper > 0] > 245).all()
    assert (lower[lower > 0] < 70).all()
    assert (shade > 0).mean() > 0.2


@settings(max_examples=20, deadline=None)
@given(tilts)
def test_an_image_with_a_tilt_of_its_own_comes_out_level(tilt: Tilt) -> None:
    seen = rectify_observation(taken(tilt), KINECT, LEVEL)
    assert_level(seen.rgb)
    assert seen.tilt is None


@settings(max_examples=10, deadline=None)
@given(tilts)
def test_a_kept_original_is_levelled_as_the_image_is(tilt: Tilt) -> None:
    image = taken(tilt)
    original = compress_original(image.rgb, KINECT, None)
    narrow = replace(LEVEL, width=80, cx=39.5)
    seen = recorded_observation(replace(image, original=original), KINECT, narrow)
    assert seen.rgb.shape == (72, 80, 3)
    assert np.abs(seen.rgb.astype(int) - rectify_observation(image, KINECT, narrow).rgb).mean() < 6


def test_an_image_without_a_tilt_is_levelled_by_its_cameras_mounting() -> None:
    assert_level(rectify_observation(taken(None), KINECT, LEVEL).rgb)


def test_an_image_for_the_camera_that_took_it_stays_as_it_is_and_keeps_its_tilt() -> None:
    image = taken(Tilt(0.3, -0.2))
    assert rectify_observation(image, KINECT, replace(KINECT, height_m=1.2)) is image
    assert recorded_observation(image, KINECT, KINECT) is image


def test_an_image_that_was_held_by_hand_stays_as_it_is_for_another_drive_of_the_same_camera() -> None:
    image = taken(Tilt(0.3, -0.2))
    other_drive = replace(KINECT, pitch_rad=-0.5, roll_rad=0.1, height_m=1.2)
    assert rectify_observation(image, KINECT, other_drive) is image
    assert recorded_observation(image, KINECT, other_drive) is image
    assert rectify_observation(image, KINECT, replace(other_drive, fx=140.0)).tilt is None


@pytest.mark.parametrize("tilt", [Tilt(np.nan, 0.0), Tilt(0.0, np.inf), Tilt(1.6, 0.0)])
def test_a_tilt_that_cannot_be_is_refused(tilt: Tilt) -> None:
    with pytest.raises(ImageError, match=r"drive 7.*tilt"):
        preprocess_observation(horizon(KINECT), None, np.zeros(3), stamp=0.0, step=0, tilt=tilt, source="drive 7")


def test_tilts_go_through_a_recording_exactly_also_beside_frames_that_have_none(tmp_path: Path) -> None:
    images = [replace(taken(tilt), step=step) for step, tilt in enumerate((None, Tilt(-0.61, 1 / 3), None))]
    with RecordingWriter(tmp_path / "drive.rrd", scene="office", config={}, fingerprint="", camera=KINECT) as writer:
        for image in images:
            writer.write_frame(image)
    recording = Recording.open(tmp_path / "drive.rrd")
    assert [recording.observation(frame).tilt for frame in recording.frames] == [image.tilt for image in images]
    assert all(map(recording.is_intact, recording.frames))
    assert verify(recording.path).frames == 3


def test_a_recording_from_before_tilts_has_none() -> None:
    recording = Recording.open(ROOT / "tests/data/golden-schema-1.rrd")
    assert all(recording.observation(frame).tilt is None for frame in recording.frames[:5])
