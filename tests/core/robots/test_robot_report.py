"""The floor in a depth image tells how a camera is tilted against what its profile says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.robot_report import fit_floor

SAID = CameraModel.from_fov(96, 72, math.radians(70), height_m=0.6, pitch_rad=-0.2)


def floor_depth(camera: CameraModel) -> np.ndarray:
    """The depth (72, 96) of an endless floor."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = camera.unproject(np.stack([columns, rows], axis=-1), np.ones(rows.shape)) - [0, 0, camera.height_m]
    with np.errstate(divide="ignore"):
        return np.where(rays[..., 2] < -1e-6, -camera.height_m / rays[..., 2], 0).astype(np.float32)


@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg", "height_m"), [(0, 0, 0), (4, 0, 0), (-3, 0, 0), (0, 3, 0), (2, -2, 0.05)]
)
def test_the_floor_tells_what_is_off(pitch_deg: float, roll_deg: float, height_m: float) -> None:
    true = replace(
        SAID,
        pitch_rad=SAID.pitch_rad + math.radians(pitch_deg),
        roll_rad=math.radians(roll_deg),
        height_m=SAID.height_m + height_m,
    )

    off = fit_floor(floor_depth(true), SAID)

    assert off is not None
    assert (off.pitch_off_deg, off.roll_off_deg) == pytest.approx((pitch_deg, roll_deg), abs=0.3)
    assert off.height_off_m == pytest.approx(height_m, abs=0.02)


def test_no_floor_tells_nothing() -> None:
    assert fit_floor(np.zeros((72, 96), np.float32), SAID) is None
