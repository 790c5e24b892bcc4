"""Databases with RTAB-Map's tables come out as frames; damaged and foreign ones end in one clear error."""

import sqlite3
import struct
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.importing.raw_frame import DriveReader, RawFrame, ReadOptions
from ltvn_core.data.importing.rtabmap_reader import RtabmapReader
from ltvn_core.errors import DriveError
from tests.core.data.importing.rtabmap.database_examples import (
    BEGIN_S,
    HEIGHT,
    OPTICAL,
    WIDTH,
    NodeRow,
    colours,
    float_blob,
    lossless,
    mono_blob,
    mounted,
    png,
    pose_blob,
    stereo_blob,
    straight_drive,
    write_database,
)
from tests.core.data.importing.rvl_encoder import encode_rvl


def read(path: Path, options: ReadOptions | None = None) -> tuple[list[RawFrame], DriveReader]:
    reader = RtabmapReader.open(path, options or ReadOptions())
    return list(reader.frames()), reader


def test_a_database_becomes_frames_with_depth_odometry_and_the_camera(tmp_path: Path) -> None:
    frames, reader = read(write_database(tmp_path / "drive.db", straight_drive()))

    assert RtabmapReader.recognises(tmp_path / "drive.db")
    assert [frame.stamp - BEGIN_S for frame in frames] == [1, 2, 3, 4]
    for number, frame in enumerate(frames):
        assert np.array_equal(frame.rgb, colours(number))
        assert frame.depth_m is not None
        assert np.allclose(frame.depth_m, 1.5)
        assert frame.odometry == pytest.approx([0.2 + 0.1 * number, 0, 0], abs=1e-6)
        assert frame.truth is None
        assert frame.tilt is None
    camera = frames[0].camera
    assert camera is not None
    assert (camera.fx, camera.width, camera.distortion) == (55.0, WIDTH, ())
    assert (camera.height_m, camera.pitch_rad) == (pytest.approx(0.5), pytest.approx(-0.1, abs=1e-6))
    assert not reader.dropped
    assert not reader.doubts


@pytest.mark.parametrize(
    ("version", "calibration", "has_depth"),
    [
        ("0.17.6", float_blob(mounted(), 55, 55, 31.5, 23.5, WIDTH, HEIGHT), True),
        ("0.11.0", float_blob(mounted(), 55, 55, 31.5, 23.5), True),
        ("0.17.6", float_blob(mounted(), 55, 55, 31.5, 23.5, 0.1, WIDTH, HEIGHT), False),
        ("0.11.0", float_blob(mounted(), 55, 55, 31.5, 23.5, 0.1), False),
        ("0.21.0", stereo_blob(mounted()), False),
        ("0.21.0", mono_blob(mounted(), focal=110, width=2 * WIDTH, height=2 * HEIGHT), True),
    ],
)
def test_every_layout_of_calibrations_is_read(
    tmp_path: Path, version: str, calibration: bytes, has_depth: bool
) -> None:
    nodes = straight_drive(2)
    for node in nodes:
        node.calibration = calibration

    frame = read(write_database(tmp_path / "drive.db", nodes, version=version))[0][0]

    assert frame.camera is not None
    assert (frame.camera.fx, frame.camera.width) == (pytest.approx(55), WIDTH)
    assert frame.camera.height_m == pytest.approx(0.5)
    assert (frame.depth_m is not None) == has_depth


def test_depth_in_floats_and_depth_compressed_by_rvl_are_metres(tmp_path: Path) -> None:
    metres = np.full((HEIGHT, WIDTH), 2.25, np.float32)
    metres[:5] = np.nan
    millimetres = np.full((HEIGHT, WIDTH), 2250, np.uint16)
    millimetres[:5] = 0
    rvl = b"DEPTHRVL" + struct.pack("<II", WIDTH, HEIGHT) + encode_rvl(millimetres)
    nodes = straight_drive(2)
    nodes[0].depth, nodes[1].depth = png(metres.view(np.uint8).reshape(HEIGHT, WIDTH, 4)), rvl

    frames, _ = read(write_database(tmp_path / "drive.db", nodes))

    assert len(frames) == 2
    for frame in frames:
        assert frame.depth_m is not None
        assert np.allclose(frame.depth_m[5:], 2.25)
        assert not frame.depth_m[:5].any()


def test_of_cameras_side_by_side_one_is_read(tmp_path: Path) -> None:
    row = np.hstack([colours(1), colours(7)])
    calibration = mono_blob(mounted()) + mono_blob(mounted(height=0.9))
    depth = png(np.hstack([np.full((HEIGHT, WIDTH), 1000 * n, np.uint16) for n in (1, 2)]))
    nodes = [NodeRow(pose_blob(0.1 * n), lossless(row), depth, calibration) for n in range(2)]
    path = write_database(tmp_path / "drive.db", nodes)

    (first, *_), doubtful = read(path)
    (second, *_), _ = read(path, ReadOptions(rgb="1"))

    assert np.array_equal(first.rgb, colours(1))
    assert any("side by side" in doubt for doubt in doubtful.doubts)
    assert np.array_equal(second.rgb, colours(7))
    assert second.depth_m is not None
    assert np.allclose(second.depth_m, 2.0)
    assert second.camera is not None
    assert second.camera.height_m == pytest.approx(0.9)


def test_an_optimised_map_with_loop_closures_is_the_truth_and_said_to_be_no_measurement(tmp_path: Path) -> None:
    optimised = [pose_blob(0.09 * number, 1.0) for number in range(4)]

    frames, reader = read(write_database(tmp_path / "drive.db", straight_drive(), closures=2, optimised=optimised))
    without, _ = read(write_database(tmp_path / "open.db", straight_drive(), optimised=optimised))

    assert frames[3].truth == pytest.approx([0.2 + 0.27, 1.0, 0.0], abs=1e-6)
    assert frames[3].odometry == pytest.approx([0.5, 0.0, 0.0], abs=1e-6)
    assert any("2 loop closures" in doubt for doubt in reader.doubts)
    assert without[3].truth is None


def test_ground_truth_that_the_program_was_told_wins(tmp_path: Path) -> None:
    nodes = straight_drive()
    for number, node in enumerate(nodes):
        node.truth = pose_blob(5.0 + 0.1 * number)

    frames, reader = read(write_database(tmp_path / "drive.db", nodes))

    assert frames[0].truth == pytest.approx([5.2, 0, 0], abs=1e-6)
    assert not reader.doubts


def test_a_hand_held_camera_gives_each_image_its_own_tilt(tmp_path: Path) -> None:
    from scipy.spatial.transform import Rotation

    held = mono_blob(pose_blob(turn=OPTICAL))
    turns = [Rotation.from_euler("ZYX", [0.5, 0.3, 0.2]), Rotation.identity()]
    nodes = [NodeRow(pose_blob(turn=turn), lossless(colours(1)), None, held) for turn in turns]

    frames, _ = read(write_database(tmp_path / "drive.db", nodes))

    assert frames[0].tilt == pytest.approx((-0.3, 0.2), abs=1e-5)
    assert frames[0].odometry == pytest.approx([0, 0, 0.5], abs=1e-5)
    assert frames[1].tilt is None


def test_of_several_drives_the_longest_is_read_and_the_others_are_counted(tmp_path: Path) -> None:
    nodes = straight_drive(5)
    nodes[0].session = 7

    frames, reader = read(write_database(tmp_path / "drive.db", nodes))

    assert len(frames) == 4
    assert reader.dropped == {"of another drive": 1}


def test_nodes_without_stamps_are_counted_in_their_order(tmp_path: Path) -> None:
    nodes = straight_drive(3)
    for node in nodes:
        node.stamp = 0.0

    assert [frame.stamp for frame in read(write_database(tmp_path / "drive.db", nodes))[0]] == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    "damage",
    [
        {"image": b"\xff\xd8 no jpeg"},
        {"calibration": struct.pack("<11i", 0, 21, 0, 0, 64, 48, 2**30, 5, 9, 12, 12) + bytes(80)},
        {"calibration": b"abc"},
        {"calibration": mono_blob(mounted(), focal=-1.0)},
        {"calibration": mono_blob(mounted(), width=48, height=64)},
    ],
)
def test_a_damaged_node_is_left_out(tmp_path: Path, damage: dict[str, bytes]) -> None:
    nodes = straight_drive(3)
    for name, blob in damage.items():
        setattr(nodes[1], name, blob)

    frames, reader = read(write_database(tmp_path / "drive.db", nodes))

    assert [frame.stamp - BEGIN_S for frame in frames] == [1, 3]
    assert reader.dropped == {"damaged image": 1}
    assert "node 2" in reader.doubts[0]


@pytest.mark.parametrize(
    "depth",
    [
        b"DEPTHRVL" + struct.pack("<II", 2**31, 2**31) + bytes(100),
        png(np.zeros((HEIGHT, WIDTH), np.uint16))[:60],
    ],
)
def test_a_node_whose_depth_is_damaged_comes_without_depth_and_that_is_said(tmp_path: Path, depth: bytes) -> None:
    nodes = straight_drive(3)
    nodes[1].depth = depth

    frames, reader = read(write_database(tmp_path / "drive.db", nodes))

    assert [frame.depth_m is None for frame in frames] == [False, True, False]
    assert not reader.dropped
    assert any("node 2" in doubt and "1 depth" in doubt for doubt in reader.doubts)


def test_poses_that_are_none_leave_odometry_open(tmp_path: Path) -> None:
    nodes = straight_drive(3)
    nodes[1].pose = np.full(12, np.nan, "<f4").tobytes()
    nodes[2].pose = bytes(48)

    frames, _ = read(write_database(tmp_path / "drive.db", nodes))

    assert [frame.odometry is None for frame in frames] == [False, True, True]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5])
def test_a_cut_database_ends_in_one_line(tmp_path: Path, share: float) -> None:
    path = write_database(tmp_path / "drive.db", straight_drive(12))
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])

    with pytest.raises(DriveError) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_another_programs_database_and_another_file_are_refused(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "other.db") as database:
        database.execute("CREATE TABLE Songs (id INTEGER)")
    database.close()
    (tmp_path / "text.db").write_text("a diary", encoding="utf-8")

    with pytest.raises(DriveError, match="lacks its tables"):
        read(tmp_path / "other.db")
    with pytest.raises(DriveError, match="cannot be read as a database"):
        read(tmp_path / "text.db")


def test_a_database_that_computes_huge_values_or_never_ends_is_refused(tmp_path: Path) -> None:
    path = write_database(tmp_path / "drive.db", straight_drive(2))
    with sqlite3.connect(path) as database:
        database.executescript(
            "DROP TABLE Data; CREATE TABLE Data (id INTEGER PRIMARY KEY, depth BLOB, calibration BLOB, "
            "image BLOB GENERATED ALWAYS AS (zeroblob(900000000))); INSERT INTO Data (id) VALUES (1);"
        )
    database.close()

    with pytest.raises(DriveError, match="too big"):
        read(path)


def test_an_old_database_says_how_to_convert_it(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match=r"0\.8\.0.*newer RTAB-Map"):
        read(write_database(tmp_path / "drive.db", straight_drive(2), version="0.8.0"))
