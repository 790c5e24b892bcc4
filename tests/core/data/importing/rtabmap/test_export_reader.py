"""Folders that RTAB-Map exported come with lens, depth and poses, in all of its formats of poses."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.rtabmap_reader import RtabmapReader
from ltvn_core.data.importing.spatial_pose import BODY_FROM_OPTICAL
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import DriveError

COUNT = 4
ON_ROBOT = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""As a phone has it: the frame of the robot lies on its side."""
CALIBRATION = """\
%YAML:1.0
---
camera_name: calibration
image_width: 720
image_height: 960
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   data: [ 6.9768609619140625e+02, 0., 3.5901312255859375e+02, 0.,
       6.9768609619140625e+02, 4.8260501098632812e+02, 0., 0., 1. ]
distortion_coefficients:
   rows: 1
   cols: 5
   data: [ 0., 0., 0., 0., 0. ]
distortion_model: plumb_bob
local_transform:
   rows: 3
   cols: 4
   data: [ -1.19209290e-07, 0., 1.00000012e+00, 0., 0., -1.00000024e+00,
       0., 0., 1.00000012e+00, 0., -1.19209290e-07, 0. ]
"""


def camera(number: int) -> NDArray[np.float64]:
    """The optical frame of a camera that drives along x, 0.2 m an image, and looks a little down and aside."""
    pose = np.eye(4)
    body = Rotation.from_euler("ZYX", [0.1 * number, 0.2, 0.0]).as_matrix()
    pose[:3, :3], pose[:3, 3] = body @ BODY_FROM_OPTICAL, [0.2 * number, 1.0, 1.4]
    return pose


def stamped(number: int, pose: NDArray[np.float64], *, node: bool) -> str:
    words = [100 + number, *pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
    return " ".join([*(f"{word:.6f}" for word in words), *([str(10 * number + 3)] if node else [])])


def raw(number: int, pose: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.7f}" for value in pose[:3].ravel())


def motion_capture(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """What RTAB-Map's format 1 makes of a pose: another world, and the optical frame behind."""
    world, optical = np.eye(4), np.eye(4)
    world[:3, :3], optical[:3, :3] = [[0, 0, 1], [0, -1, 0], [1, 0, 0]], BODY_FROM_OPTICAL
    return optical.T @ world.T @ pose @ optical


def write_export(folder: Path, prefix: str = "", line: Callable[[int], str] | None = None, of: str = "camera_") -> Path:
    """Write an export whose images are called by the node's number, and a list of poses where one is given."""
    for name in ("rgb", "depth", "confidence", "calib"):
        (folder / f"{prefix}{name}").mkdir(parents=True)
    rng = np.random.default_rng(0)
    for number in range(COUNT):
        name = str(10 * number + 3)
        cv2.imwrite(str(folder / f"{prefix}rgb/{name}.jpg"), rng.integers(0, 255, (96, 72, 3), np.uint8))
        cv2.imwrite(str(folder / f"{prefix}depth/{name}.png"), np.full((32, 24), 1500, np.uint16))
        confidence = np.full((32, 24), 2, np.uint8)
        confidence[:8], confidence[8:16] = 0, 1
        cv2.imwrite(str(folder / f"{prefix}confidence/{name}.png"), confidence)
        (folder / f"{prefix}calib/{name}.yaml").write_text(CALIBRATION, encoding="utf-8")
    if line is not None:
        lines = ["#timestamp x y z qx qy qz qw", *map(line, range(COUNT))]
        (folder / f"{prefix}{of}poses.txt").write_text("\n".join(lines), encoding="utf-8")
    return folder


def read(folder: Path, options: ReadOptions | None = None) -> list[RawFrame]:
    return list(RtabmapReader.open(folder, options or ReadOptions()).frames())


@pytest.mark.parametrize("prefix", ["", "tour_"])
def test_an_export_comes_with_lens_depth_and_no_depth_where_confidence_is_low(tmp_path: Path, prefix: str) -> None:
    folder = write_export(tmp_path / "phone", prefix, lambda k: stamped(k, camera(k), node=True))

    frames = read(folder)

    assert RtabmapReader.recognises(folder)
    assert [frame.stamp for frame in frames] == pytest.approx([100, 101, 102, 103])
    lens, depth = frames[0].camera, frames[0].depth_m
    assert lens is not None
    assert (lens.width, lens.height, lens.distortion) == (72, 96, ())
    assert lens.fx == pytest.approx(69.768609619)
    assert depth is not None
    assert depth.shape == (32, 24)
    assert (depth[:8] == 0).all()
    assert depth[8:] == pytest.approx(1.5)
    summary = import_drive(RtabmapReader.open(folder, ReadOptions()), tmp_path / "tour.rrd")
    assert summary.frames == COUNT
    seen = Recording.open(tmp_path / "tour.rrd").observation(1)
    assert seen.depth is not None
    assert np.median(seen.depth) == pytest.approx(1.5, abs=0.01)


@pytest.mark.parametrize(
    ("of", "line"),
    [
        ("camera_", lambda k: stamped(k, camera(k), node=True)),
        ("camera_", lambda k: stamped(k, camera(k), node=False)),
        ("camera_", lambda k: raw(k, camera(k))),
        ("camera_", lambda k: stamped(k, motion_capture(camera(k)), node=False)),
        ("", lambda k: stamped(k, camera(k) @ np.linalg.inv(ON_ROBOT), node=True)),
        ("", lambda k: raw(k, camera(k) @ np.linalg.inv(ON_ROBOT))),
        ("", lambda k: stamped(k, motion_capture(camera(k) @ np.linalg.inv(ON_ROBOT)), node=False)),
    ],
)
def test_each_format_of_poses_says_where_the_camera_was(tmp_path: Path, of: str, line: Callable[[int], str]) -> None:
    frames = read(write_export(tmp_path, "", line, of))

    assert len(frames) == COUNT
    poses = np.array([frame.truth for frame in frames], float)
    assert np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) == pytest.approx(0.2, abs=1e-4)
    assert np.diff(poses[:, 2]) == pytest.approx(0.1, abs=1e-4)
    # It looks along its way in the beginning, whatever the world is turned by.
    way = np.arctan2(*(poses[1] - poses[0])[[1, 0]])
    assert np.cos(way - poses[0, 2]) == pytest.approx(1, abs=1e-3)
    assert frames[1].tilt == pytest.approx((-0.2, 0.0), abs=1e-4)


def test_an_export_without_poses_and_with_one_lens_for_all_is_a_drive_too(tmp_path: Path) -> None:
    folder = write_export(tmp_path)
    for path in (folder / "calib").iterdir():
        path.unlink()
    (folder / "calib").rmdir()
    (folder / "calibration.yaml").write_text(CALIBRATION, encoding="utf-8")
    (folder / "query").mkdir()
    (folder / "rgb").rename(folder / "query/rgb")

    frames = read(folder)

    assert [frame.stamp for frame in frames] == [0, 1, 2, 3]
    assert all(frame.camera is not None and frame.depth_m is not None and frame.truth is None for frame in frames)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("camera_poses.txt", "1 2 3\n"),
        ("camera_poses.txt", "north " * 8),
        ("camera_poses.txt", "900 0 0 0 0 0 0 1\n"),
        ("camera_poses.txt", "100 0 0 0 0 0 0 0 3\n"),
        ("camera_poses.txt", "\n".join(["1 0 0 0 0 9 0 0 0 0 1 0"] * COUNT)),
        ("calib/3.yaml", CALIBRATION.replace("camera_matrix", "matrix")),
        ("calib/3.yaml", CALIBRATION.replace("1.00000012", "9.0")),
    ],
)
def test_files_that_cannot_be_right_are_told_in_one_line(tmp_path: Path, file: str, text: str) -> None:
    folder = write_export(tmp_path, "", lambda k: stamped(k, camera(k), node=True))
    (folder / file).write_text(text, encoding="utf-8")
    try:
        reader = RtabmapReader.open(folder, ReadOptions())
        assert len(list(reader.frames())) == COUNT - 1
        said = reader.doubts[-1]
    except DriveError as error:
        said = str(error)
    assert file in said
    assert "\n" not in said
