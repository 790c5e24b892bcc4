"""Folders as GNM and ViNT are trained from come out as frames; a pickle that wants more than arrays is refused."""

import os
import pickle
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ltvn_core.data.importing.raw_frame import ReadOptions
from ltvn_core.data.importing.vint_reader import VINT
from ltvn_core.errors import DriveError

POSES = np.array([[0.0, 0.0, 0.0], [0.25, 0.0, 0.1], [0.5, 0.1, 0.2], [0.75, 0.1, 0.3]])


def colours(number: int) -> np.ndarray:
    rows, columns = np.mgrid[:48, :64]
    return np.stack([rows * 4, columns * 3, np.full_like(rows, 30 * number)], axis=-1).astype(np.uint8)


def write_folder(folder: Path, content: Any = None, images: int = 4) -> Path:
    folder.mkdir(parents=True)
    held = {"position": POSES[:, :2], "yaw": POSES[:, 2]} if content is None else content
    (folder / "traj_data.pkl").write_bytes(held if isinstance(held, bytes) else pickle.dumps(held))
    for number in range(images):
        cv2.imwrite(str(folder / f"{number}.jpg"), colours(number)[..., ::-1])
    return folder


def test_a_trajectory_becomes_frames_with_odometry(tmp_path: Path) -> None:
    reader = VINT.open(write_folder(tmp_path / "hall"), ReadOptions(rate_hz=5.0))
    frames = list(reader.frames())

    assert VINT.recognises(tmp_path / "hall")
    assert [frame.stamp for frame in frames] == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert np.allclose(np.array([frame.odometry for frame in frames], float), POSES)
    assert all(frame.depth_m is None for frame in frames)
    assert all(np.abs(frame.rgb.astype(int) - colours(n)).mean() < 3 for n, frame in enumerate(frames))
    assert not reader.doubts


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<f8"])
def test_pickles_of_all_kinds_are_read(tmp_path: Path, protocol: int, dtype: str) -> None:
    content = {
        "position": np.asfortranarray(POSES[:, :2].astype(dtype)),
        "yaw": POSES[:, 2:].astype(dtype),
        "speed": np.float64(0.4),
    }
    folder = write_folder(tmp_path / "hall", pickle.dumps(content, protocol))

    frames = list(VINT.open(folder, ReadOptions()).frames())

    assert np.allclose(np.array([frame.odometry for frame in frames], float), POSES, atol=1e-6)


def test_poses_may_be_plain_lists(tmp_path: Path) -> None:
    content = {"position": [list(row) for row in POSES[:, :2]], "yaw": POSES[:, 2].tolist()}

    frames = list(VINT.open(write_folder(tmp_path / "hall", content), ReadOptions()).frames())

    assert np.allclose(np.array([frame.odometry for frame in frames], float), POSES)


def objects(rows: list[Any], shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of Python objects, as pandas and careless conversions leave them."""
    array = np.empty(len(rows), object)
    array[:] = rows
    return array.reshape(shape)


@pytest.mark.parametrize(
    ("position", "yaw"),
    [
        (POSES[:, :2].astype(object), objects([np.array([yaw]) for yaw in POSES[:, 2]], (4,))),
        (objects(list(POSES[:, :2]), (4,)), POSES[:, 2:].astype(object)),
        (objects([np.array([x]) for x in POSES[:, :2].ravel()], (4, 2)), POSES[:, 2].tolist()),
    ],
    ids=["numbers and arrays of one", "rows", "arrays of one"],
)
def test_arrays_of_objects_that_hold_numbers_are_read(tmp_path: Path, position: Any, yaw: Any) -> None:
    folder = write_folder(tmp_path / "hall", {"position": position, "yaw": yaw})

    frames = list(VINT.open(folder, ReadOptions()).frames())

    assert np.allclose(np.array([frame.odometry for frame in frames], float), POSES)


def test_pickles_that_older_numpy_wrote_are_read(tmp_path: Path) -> None:
    older = pickle.dumps({"position": POSES[:, :2], "yaw": POSES[:, 2]}, 2).replace(b"numpy._core.", b"numpy.core.")

    assert len(list(VINT.open(write_folder(tmp_path / "hall", older), ReadOptions()).frames())) == 4


class RunsCode:
    def __init__(self, made: Path) -> None:
        self.made = made

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.made),)


def test_a_pickle_that_runs_code_is_refused_and_nothing_runs(tmp_path: Path) -> None:
    content = {"position": POSES[:, :2], "yaw": RunsCode(tmp_path / "harm")}

    with pytest.raises(DriveError, match=r"wants to call posix\.mkdir"):
        VINT.open(write_folder(tmp_path / "hall", content), ReadOptions())
    assert not (tmp_path / "harm").exists()


HUGE_MEMORY = b"\x80\x04Nr" + struct.pack("<I", 2**31) + b"."
HUGE_ARRAY = b"\x80\x04cnumpy\nndarray\n(J\xff\xff\xff\x7ftR."
HUGE_EMPTY = b"\x80\x04cnumpy._core.multiarray\n_reconstruct\n(cnumpy\nndarray\nJ\xff\xff\xff\x7f\x85C\x01dtR."
NESTED = b"\x80\x04G\0\0\0\0\0\0\0\0" + b"".join(
    b"q" + bytes([n]) + b"0](h" + bytes([n]) + b"h" + bytes([n]) + b"e" for n in range(60)
)
"""A list that holds a list twice, which holds a list twice, and so on: a few hundred bytes for 2^60 numbers."""
LYING_LENGTH = b"\x80\x04\x8e" + struct.pack("<Q", 2**62) + b"abc."


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no pickle at all",
        pickle.dumps({"position": POSES})[:40],
        HUGE_MEMORY,
        HUGE_ARRAY,
        HUGE_EMPTY,
        LYING_LENGTH,
        b"\x80\x04}(\x8c\x08position" + NESTED[2:] + b"\x8c\x03yawK\0u.",
        pickle.dumps({"position": [["x" * 1000] * 2] * 4, "yaw": [0.0] * 4}),
        pickle.dumps([1, 2]),
        pickle.dumps({"position": POSES, "yaw": np.zeros(9)}),
        pickle.dumps({"position": POSES * np.nan, "yaw": POSES[:, 2]}),
        pickle.dumps({"position": "far", "yaw": None}),
        pickle.dumps({"position": np.array([[{}, {}]] * 4, dtype=object), "yaw": POSES[:, 2]}),
        pickle.dumps({"position": POSES[:, :2], "yaw": np.array([0.1, "north", 0.2, None], dtype=object)}),
        pickle.dumps({"position": np.array([[], [1.0]], dtype=object), "yaw": POSES[:2, 2]}),
    ],
)
def test_what_is_no_trajectory_ends_in_one_line(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(DriveError) as caught:
        VINT.open(write_folder(tmp_path / "hall", content), ReadOptions())
    assert "\n" not in str(caught.value)


def test_images_without_a_pose_have_no_odometry(tmp_path: Path) -> None:
    frames = list(VINT.open(write_folder(tmp_path / "hall", images=5), ReadOptions()).frames())
    assert [frame.odometry is None for frame in frames] == [False] * 4 + [True]


def test_a_whole_data_set_lists_its_trajectories(tmp_path: Path) -> None:
    for name in ("hall", "lab"):
        write_folder(tmp_path / "set" / name)

    assert VINT.recognises(tmp_path / "set")
    with pytest.raises(DriveError, match="2 trajectories; name one of them: hall, lab"):
        VINT.open(tmp_path / "set", ReadOptions())
