"""Folders that somebody crafted end an import by a message: never by a crash, without end, or showing other files."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.data.importing.restricted_pickle import check_program
from ltvn_core.data.importing.stamped_lists import MOST_LINES
from ltvn_core.errors import DriveError
from tests.core.data.importing.drives import write_tum_folder
from tests.core.data.importing.rtabmap.test_export_reader import write_export
from tests.core.data.importing.test_euroc_reader import write_sequence
from tests.core.data.importing.test_folder_reader import write_pictures
from tests.core.data.importing.test_vint_reader import write_folder
from tests.platforms import needs_posix

LEVELS = 20_000
SECRET = "root:$6$rounds:19000"


def in_place(first: bytes, each: bytes) -> bytes:
    return b"\x80\x04" + first + each * LEVELS + b"."


NESTED = {
    "tuples": in_place(b"K\x01", b"\x85"),
    "a key of tuples": b"\x80\x04}K\x01" + b"\x85" * LEVELS + b"K\x01s.",
    "lists begun in one another": b"\x80\x04" + b"]" * LEVELS + b"a" * (LEVELS - 1) + b".",
    "lists behind a mark": b"\x80\x04" + b"(" * LEVELS + b"l" * LEVELS + b".",
    "mappings": b"\x80\x04" + b"}K\x01" * LEVELS + b"K\x01" + b"s" * LEVELS + b".",
    "remembered and put within": in_place(b"]q\x00", b"0](h\x00eq\x00"),
    "filled from outside": in_place(b"]q\x00]q\x01", b"h\x00h\x01a0q\x00]q\x01"),
    "within itself": b"\x80\x04]q\x00h\x00a.",
}


@pytest.mark.parametrize("program", NESTED.values(), ids=NESTED)
def test_a_pickle_nested_ten_thousands_deep_is_refused(tmp_path: Path, program: bytes) -> None:
    folder = write_folder(tmp_path / "hall", program)
    with pytest.raises(DriveError, match=r"traj_data\.pkl"):
        open_drive(folder)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_the_program_of_any_trajectory_may_run(protocol: int) -> None:
    kind, row = np.dtype("f4"), [1.0, 2.0]
    many = [(float(k), [row, row]) for k in range(3000)]
    objects = np.empty(2, object)
    objects[:] = [np.zeros(2), np.ones(2)]
    held = {"position": np.zeros((4, 2), kind), "yaw": np.ones(4, kind), "more": [many, objects, {1: {2, 3}}, None]}
    check_program(pickle.dumps(held, protocol))


def test_a_long_description_of_a_type_is_not_parsed(tmp_path: Path) -> None:
    text = b"i4," * 1_000_000 + b"i4"
    program = b"\x80\x04}\x8c\x08positioncnumpy\ndtype\nX" + len(text).to_bytes(4, "little") + text + b"\x85Rs."
    with pytest.raises(DriveError, match="type"):
        open_drive(write_folder(tmp_path / "hall", program))


@pytest.mark.parametrize("end", ["\n", "\r"])
def test_a_list_of_too_many_lines_is_refused(tmp_path: Path, end: str) -> None:
    folder = write_tum_folder(tmp_path / "desk")
    (folder / "groundtruth.txt").write_text(end * (MOST_LINES + 1), encoding="utf-8", newline="")
    with pytest.raises(DriveError, match="lines"):
        open_drive(folder)


def test_a_long_list_of_images_that_are_elsewhere_ends_soon(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "desk")
    lines = (f"{100 + k / 10:.1f} elsewhere/{k}.png\n" for k in range(4000))
    (folder / "rgb.txt").write_text("".join(lines), encoding="utf-8")
    reader = open_drive(folder)
    with pytest.raises(DriveError, match="first"):
        list(reader.frames())
    assert reader.dropped["damaged or missing image"] < 4000


def linked(folder: Path, name: str) -> Path:
    """Put a link to another file of the machine in place of a file of a folder."""
    secret = folder.parent / "secret"
    secret.mkdir(exist_ok=True)
    for each in ("shadow", "0.txt"):
        (secret / each).write_text(SECRET, encoding="utf-8")
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    path.symlink_to(secret if name == "pose" else secret / "shadow")
    return path


@needs_posix
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("tum", "rgb.txt"),
        ("tum", "groundtruth.txt"),
        ("tum", "odometry.txt"),
        ("tum", "calibration.txt"),
        ("folder", "camera.json"),
        ("folder", "odometry.csv"),
        ("folder", "traj.txt"),
        ("folder", "pose"),
        ("euroc", "mav0/cam0/data.csv"),
        ("euroc", "mav0/cam0/sensor.yaml"),
        ("rtabmap", "poses.txt"),
        ("vint", "traj_data.pkl"),
    ],
)
def test_a_link_out_of_a_folder_is_named_and_never_read(tmp_path: Path, kind: str, name: str) -> None:
    writers = {"tum": write_tum_folder, "vint": write_folder, "euroc": write_sequence, "rtabmap": write_export}
    folder = tmp_path / "drive"
    if kind == "folder":
        write_pictures(folder, ["0.jpg", "1.jpg"])
    else:
        writers[kind](folder)
    link = linked(folder, name)
    with pytest.raises(DriveError) as refused:
        list(open_drive(folder).frames())
    assert str(link) in str(refused.value)
    assert SECRET[:8] not in str(refused.value)


@needs_posix
def test_the_truth_beside_a_camera_that_was_named_alone_is_not_read_by_a_link(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path / "drive")
    linked(folder, "mav0/state_groundtruth_estimate0/data.csv")
    with pytest.raises(DriveError, match="link") as refused:
        open_drive(folder / "mav0/cam0")
    assert SECRET[:8] not in str(refused.value)


@needs_posix
def test_links_within_a_folder_and_to_a_folder_are_followed(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "desk")
    (folder / "rgb.txt").rename(folder / "rgb_all.txt")
    (folder / "rgb.txt").symlink_to("rgb_all.txt")
    (folder / "gone").symlink_to(tmp_path / "nothing is here")
    (tmp_path / "mine").symlink_to(folder)
    assert len(list(open_drive(tmp_path / "mine").frames())) == 4
