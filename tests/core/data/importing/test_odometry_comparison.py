"""Images and odometry that contradict each other are told at import; drives without evidence are not doubted."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.raw_frame import RawFrame
from tests.core.data.importing.drives import ListedDrive

CAMERA = CameraModel(width=160, height=120, fx=140.0, fy=140.0, cx=79.5, cy=59.5, height_m=0.5)
_PER_RAD = 140.0


def _panorama() -> NDArray[np.uint8]:
    """Return all that is to be seen around a camera: one column an angle, without a seam."""
    rng = np.random.default_rng(0)
    width = round(2 * np.pi * _PER_RAD)
    picture = cv2.resize(rng.integers(0, 255, (30, width // 8, 3), np.uint8), (width, 160))
    return np.asarray(np.hstack([picture, picture, picture]), np.uint8)


PANORAMA = _panorama()


def seen(yaw: float) -> NDArray[np.uint8]:
    """Return what the camera sees when it looks to `yaw`; objects move right when it turns left."""
    columns, rows = np.meshgrid(np.arange(160, dtype=np.float32), np.arange(120, dtype=np.float32))
    angle = np.arctan((columns - 79.5) / 140.0) - (yaw % (2 * np.pi))
    x = PANORAMA.shape[1] * 2 / 3 + angle * _PER_RAD
    return np.asarray(cv2.remap(PANORAMA, x.astype(np.float32), rows + 20, cv2.INTER_LINEAR), np.uint8)


def doubts(
    tmp_path: Path, images: Sequence[NDArray[np.uint8]], poses: Sequence[Sequence[float]], period_s: float = 0.2
) -> list[str]:
    frames = [
        RawFrame(stamp=100 + period_s * k, rgb=image, camera=CAMERA, odometry=np.array(pose))
        for k, (image, pose) in enumerate(zip(images, poses, strict=True))
    ]
    summary = import_drive(ListedDrive(frames, ("rgb", "odometry")), tmp_path / "drive.rrd")
    return [each for each in summary.doubts if any(word in each for word in ("opposite", "stood", "fits"))]


def turning(count: int = 30) -> NDArray[np.float64]:
    """Return headings of a robot that turns to and fro, 1 to 11 degrees an image."""
    return np.cumsum(np.radians(6 + 5 * np.sin(0.5 * np.arange(count))))


def along(yaws: NDArray[np.float64]) -> list[tuple[float, float, float]]:
    return [(0.0, 0.0, float(yaw)) for yaw in yaws]


def test_images_that_turn_with_the_odometry_are_not_doubted(tmp_path: Path) -> None:
    yaws = turning()

    assert doubts(tmp_path, [seen(yaw) for yaw in yaws], along(yaws)) == []


@pytest.mark.parametrize("fault", ["poses", "images"])
def test_odometry_or_images_that_are_mirrored_are_told(tmp_path: Path, fault: str) -> None:
    yaws = turning()
    images = [seen(yaw) for yaw in yaws]

    found = (
        doubts(tmp_path, images, along(-yaws))
        if fault == "poses"
        else doubts(tmp_path, [np.ascontiguousarray(image[:, ::-1]) for image in images], along(yaws))
    )

    assert len(found) == 1
    assert "opposite" in found[0]


def test_walls_without_texture_show_nothing_and_are_not_doubted(tmp_path: Path) -> None:
    yaws = turning()
    blank = [np.full((120, 160, 3), 90 + k % 7, np.uint8) for k in range(len(yaws))]

    assert doubts(tmp_path, blank, along(-yaws)) == []


def test_odometry_that_stands_while_the_images_move_is_told_with_the_time(tmp_path: Path) -> None:
    yaws = turning(40)
    held = yaws.copy()
    held[10:26] = yaws[10]  # From 2 s to 5 s.

    found = doubts(tmp_path, [seen(yaw) for yaw in yaws], along(held))

    assert len(found) == 1
    assert "stood exactly still from 2.2 s to 5" in found[0]


def test_a_robot_that_stands_while_somebody_passes_is_not_doubted(tmp_path: Path) -> None:
    yaws = np.concatenate([turning(20), np.full(30, turning(20)[-1])])
    images = [seen(yaw) for yaw in yaws]
    rng = np.random.default_rng(1)
    person = cv2.resize(rng.integers(0, 255, (20, 7, 3), np.uint8), (45, 120))
    for k in range(20, 50):
        images[k][:, 4 * (k - 20) : 4 * (k - 20) + 45] = person[:, : images[k][:, 4 * (k - 20) :].shape[1]]

    assert doubts(tmp_path, images, along(yaws)) == []


def test_images_that_stand_while_odometry_turns_are_told(tmp_path: Path) -> None:
    yaws = turning(40)
    shown = yaws.copy()
    shown[10:26] = yaws[10]
    noise = np.random.default_rng(2)
    images = [np.clip(seen(yaw) + noise.normal(0, 2, (120, 160, 3)), 0, 255).astype(np.uint8) for yaw in shown]

    found = doubts(tmp_path, images, along(yaws))

    assert any("images stood still from 2.4 s to 5" in each for each in found)


@pytest.mark.parametrize(("late_s", "said"), [(1.0, "1.0 s too late"), (-0.6, "0.6 s too early")])
def test_odometry_by_another_clock_is_told_with_the_offset(tmp_path: Path, late_s: float, said: str) -> None:
    stamps = 0.1 * np.arange(240)
    yaws = np.interp(stamps, stamps[::8], np.cumsum(np.radians(np.random.default_rng(3).uniform(-30, 30, 30))))
    poses = np.interp(stamps - late_s, stamps, yaws)

    found = doubts(tmp_path, [seen(yaw) for yaw in yaws], along(poses), period_s=0.1)

    assert any(said in each for each in found)
