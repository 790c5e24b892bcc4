"""A map of OpenNavMap comes in as the drive it was made of."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.opennavmap_reader import OPENNAVMAP
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.spatial_pose import BODY_FROM_OPTICAL
from ltvn_core.errors import DriveError

POSES = np.array([[0, 0, 0], [0.5, 0.1, 0.4], [1.0, 0.3, 0.8], [1.4, 0.7, 1.2]])


def write_map(folder: Path) -> Path:
    (folder / "seq").mkdir(parents=True)
    poses, stamps, lenses = [], [], []
    for k, (x, y, yaw) in enumerate(POSES.tolist()):
        name = f"seq/{k:06d}.color.jpg"
        cv2.imwrite(str(folder / name), np.full((48, 64, 3), 40 * k, np.uint8))
        cv2.imwrite(str(folder / f"seq/{k:06d}.depth.png"), np.full((48, 64), 1000 * (k + 1), np.uint16))
        to_camera = (Rotation.from_euler("z", yaw) * Rotation.from_matrix(BODY_FROM_OPTICAL)).inv()
        qx, qy, qz, qw = to_camera.as_quat()
        tx, ty, tz = -to_camera.apply([x, y, 0.6])
        poses.append(f"{name} {qw} {qx} {qy} {qz} {tx} {ty} {tz}")
        stamps.append(f"{name} {2.0 * k}")
        lenses.append(f"{name} 60 60 {31.5 + k} 23.5 64 48")
    for file, rows in (("poses", poses), ("timestamps", stamps), ("intrinsics", lenses)):
        (folder / f"{file}.txt").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def read(folder: Path, options: ReadOptions | None = None) -> list[RawFrame]:
    return list(OPENNAVMAP.open(folder, options or ReadOptions()).frames())


def test_images_come_with_depth_lens_time_and_pose(tmp_path: Path) -> None:
    frames = read(write_map(tmp_path / "map"))
    assert OPENNAVMAP.recognises(tmp_path / "map")
    assert [frame.stamp for frame in frames] == [0, 2, 4, 6]
    assert np.allclose([frame.truth for frame in frames if frame.truth is not None], POSES)
    assert [frame.depth_m.max() for frame in frames if frame.depth_m is not None] == pytest.approx([1, 2, 3, 4])
    assert [frame.camera.cx for frame in frames if frame.camera is not None] == [31.5, 32.5, 33.5, 34.5]
    assert all(frame.depth_m is None for frame in read(tmp_path / "map", ReadOptions(depth="none")))


def test_a_missing_image_is_left_out_and_counted(tmp_path: Path) -> None:
    (write_map(tmp_path / "map") / "seq/000001.color.jpg").unlink()
    reader = OPENNAVMAP.open(tmp_path / "map", ReadOptions())
    assert len(list(reader.frames())) == 3
    assert sum(reader.dropped.values()) == 1


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("poses.txt", "seq/000000.color.jpg 1 0 0\n", "poses.txt, line 1"),
        ("poses.txt", "seq/000000.color.jpg 1 1 1 1 0 0 0\n", "length 1"),
        ("poses.txt", "other.jpg 1 0 0 0 0 0 0\n", "no image in common"),
        ("timestamps.txt", "", "lists no images"),
        ("intrinsics.txt", "seq/000000.color.jpg a b c d e f\n", "intrinsics.txt, line 1"),
    ],
)
def test_a_list_that_cannot_be_right_is_refused(tmp_path: Path, file: str, text: str, message: str) -> None:
    (write_map(tmp_path / "map") / file).write_text(text, encoding="utf-8")
    with pytest.raises(DriveError, match=message):
        read(tmp_path / "map")
