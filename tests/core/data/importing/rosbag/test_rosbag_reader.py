"""Bags of ROS, written by the library `rosbags`, come out as frames with the depth and the pose of their moment."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.raw_frame import DriveReader, FrameMoment, RawFrame, ReadOptions, SelectiveReader
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from ltvn_core.errors import DriveError
from tests.core.data.importing.rosbag.bag_examples import (
    BEGIN_S,
    COLOUR_FRAME,
    OPTICAL,
    Place,
    bag,
    colours,
    metres,
    mounted,
    planar,
    straight_drive,
)

COLOURS = "/camera/color/image_raw"


def read(path: Path, options: ReadOptions | None = None) -> tuple[list[RawFrame], DriveReader]:
    reader = RosbagReader.open(path, options or ReadOptions())
    return list(reader.frames()), reader


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "bag"])
def test_a_bag_of_each_kind_becomes_the_same_frames(tmp_path: Path, kind: str) -> None:
    path = straight_drive(tmp_path / ("drive.bag" if kind == "bag" else "drive"), kind)

    frames, reader = read(path)

    assert RosbagReader.recognises(path)
    assert [frame.stamp - BEGIN_S for frame in frames] == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9, 1.1], abs=1e-6)
    for number, frame in enumerate(frames):
        assert frame.odometry == pytest.approx([0.15 + 0.1 * number, 0, 0], abs=1e-6)  # Of the camera, 10 cm ahead.
        assert np.array_equal(frame.rgb, colours(number))
        assert frame.depth_m is not None
        assert np.allclose(frame.depth_m, metres(number), atol=1e-6)
    camera = frames[0].camera
    assert camera is not None
    assert (camera.fx, camera.height_m) == (55.0, pytest.approx(0.6))
    assert camera.pitch_rad == pytest.approx(-0.2)
    assert frames[0].tilt is None
    roles = {stream.role: stream.name for stream in reader.facts.streams}
    assert roles["rgb"] == COLOURS
    assert roles["odometry"] == "/odom"
    assert reader.facts.odometry_frame == "odom"
    assert reader.facts.frames == 6
    assert not reader.dropped
    assert not reader.doubts


def test_only_wanted_images_of_a_bag_are_decoded_and_their_moment_is_known_before(tmp_path: Path) -> None:
    reader = RosbagReader.open(straight_drive(tmp_path / "drive"), ReadOptions())
    assert isinstance(reader, SelectiveReader)
    moments: list[FrameMoment] = []

    def every_third(moment: FrameMoment) -> bool:
        moments.append(moment)
        return len(moments) % 3 == 1

    frames = list(reader.frames_where(every_third))

    assert len(moments) == 6
    assert [frame.stamp for frame in frames] == [moments[0].stamp, moments[3].stamp]
    for frame, moment in zip(frames, moments[::3], strict=True):
        assert frame.odometry is not None
        assert moment.odometry is not None
        assert np.array_equal(frame.odometry, moment.odometry)
    assert not reader.dropped


def test_a_single_file_of_a_folder_and_a_folder_without_metadata_are_read_too(tmp_path: Path) -> None:
    folder = straight_drive(tmp_path / "drive")
    (folder / "metadata.yaml").unlink()

    assert len(read(folder)[0]) == 6
    assert len(read(folder / "drive.mcap")[0]) == 6


@pytest.mark.parametrize(
    ("kind", "compression"),
    [("bag", "LZ4"), ("bag", "BZ2"), ("mcap", "STORAGE"), ("sqlite3", "FILE"), ("sqlite3", "MESSAGE")],
)
def test_compressed_bags_are_read(tmp_path: Path, kind: str, compression: str) -> None:
    path = straight_drive(tmp_path / ("drive.bag" if kind == "bag" else "drive"), kind, compression=compression)

    frames, _ = read(path)

    assert [np.array_equal(frame.rgb, colours(number)) for number, frame in enumerate(frames)] == [True] * 6


def test_poses_come_from_the_tree_of_frames_where_no_topic_has_them(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.transforms("/tf_static", {("base_link", COLOUR_FRAME): mounted()}, BEGIN_S)
        for tick in range(20):
            stamp = BEGIN_S + 0.1 * tick
            builder.transforms("/tf", {("odom", "base_link"): planar(0.0, 0.1 * tick, np.pi / 2)}, stamp)
            builder.transforms("/tf", {("map", "odom"): planar(5.0, 5.0, 1.0)}, stamp)
            if tick % 5 == 2:
                builder.image(COLOURS, colours(tick), "rgb8", stamp + 0.05)

    frames, _ = read(tmp_path / "drive")

    assert [frame.odometry for frame in frames] == [
        pytest.approx([0.0, 0.1 * tick + 0.05 + 0.1, np.pi / 2], abs=1e-6) for tick in (2, 7, 12, 17)
    ]


def test_a_robot_that_pitches_gives_each_image_its_own_tilt(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.transforms("/tf_static", {("base_footprint", COLOUR_FRAME): mounted(pitch_down=0.2)}, BEGIN_S)
        for tick in range(8):
            turn = Rotation.from_euler("ZYX", [0.3, -0.1 if tick >= 4 else 0.0, 0.0])
            builder.odometry("/odom", Place((0.0, 0.0, 0.0), turn), BEGIN_S + 0.1 * tick)
            builder.image(COLOURS, colours(tick), "rgb8", BEGIN_S + 0.1 * tick)

    frames, _ = read(tmp_path / "drive")

    assert frames[1].tilt is None
    assert frames[6].tilt is not None
    assert frames[6].tilt.pitch_rad == pytest.approx(-0.1)
    assert frames[6].odometry is not None
    assert frames[6].odometry[2] == pytest.approx(0.3)


def test_a_camera_on_its_side_is_turned_by_quarters(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        side = mounted(pitch_down=0.1, roll=np.pi / 2 + 0.02)
        builder.transforms("/tf_static", {("base_footprint", COLOUR_FRAME): side}, BEGIN_S)
        builder.camera_info("/camera/color/camera_info", BEGIN_S)
        for tick in range(3):
            builder.odometry("/odom", planar(0.1 * tick, 0, 0), BEGIN_S + 0.1 * tick)
            builder.image(COLOURS, colours(tick), "rgb8", BEGIN_S + 0.1 * tick)

    camera = read(tmp_path / "drive")[0][0].camera

    assert camera is not None
    assert camera.quarter_turns in (1, 3)
    assert camera.roll_rad == pytest.approx(0.02)
    # What is ahead of the robot is seen upright once the picture is turned.
    rotation = mounted(pitch_down=0.1, roll=np.pi / 2 + 0.02).turn * OPTICAL.inv()
    assert np.allclose(camera.rotation, rotation.as_matrix(), atol=1e-6)


def test_depth_of_a_camera_beside_is_laid_over_the_colours(tmp_path: Path) -> None:
    beside = Place((0.1, 0.05, 0.6), OPTICAL)
    with bag(tmp_path / "drive") as builder:
        edges = {
            ("base_footprint", COLOUR_FRAME): Place((0.1, 0.0, 0.6), OPTICAL),
            ("base_footprint", "camera_depth_optical_frame"): beside,
        }
        builder.transforms("/tf_static", edges, BEGIN_S)
        builder.camera_info("/camera/color/camera_info", BEGIN_S)
        builder.camera_info("/camera/depth/camera_info", BEGIN_S, frame="camera_depth_optical_frame")
        depth = np.full((48, 64), 2000, np.uint16)
        depth[20:28, 30:34] = 1000
        for tick in range(3):
            stamp = BEGIN_S + 0.1 * tick
            builder.odometry("/odom", planar(0.0, 0, 0), stamp)
            builder.image(COLOURS, colours(tick), "rgb8", stamp)
            builder.image("/camera/depth/image_rect_raw", depth, "16UC1", stamp, "camera_depth_optical_frame")

    frame = read(tmp_path / "drive")[0][0]

    assert frame.depth_camera is None
    assert frame.depth_m is not None
    rows, columns = np.nonzero((frame.depth_m > 0.9) & (frame.depth_m < 1.1))
    # The depth camera stands 5 cm to the left, so at one metre things are 55 px * 0.05 farther left for the colours.
    assert columns.mean() == pytest.approx(31.5 - 55 * 0.05, abs=0.6)
    assert rows.mean() == pytest.approx(23.5, abs=0.6)


def test_two_cameras_are_an_error_that_lists_them_and_an_option_chooses(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for tick in range(3):
            builder.odometry("/odom", planar(0.1 * tick, 0, 0), BEGIN_S + 0.1 * tick)
            for name in ("/cam0/image_raw", "/cam1/image_raw"):
                builder.image(name, colours(tick), "rgb8", BEGIN_S + 0.1 * tick)

    with pytest.raises(DriveError, match=r"--rgb: /cam0/image_raw, /cam1/image_raw"):
        read(tmp_path / "drive")
    assert len(read(tmp_path / "drive", ReadOptions(rgb="/cam1/image_raw"))[0]) == 3
    with pytest.raises(DriveError, match="no topic /cam7"):
        read(tmp_path / "drive", ReadOptions(rgb="/cam7"))


def test_ground_truth_is_found_by_its_name_and_is_no_odometry(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.transforms("/tf_static", {("base_footprint", COLOUR_FRAME): mounted(x=0.1)}, BEGIN_S)
        for tick in range(4):
            stamp = BEGIN_S + 0.1 * tick
            builder.odometry("/odom", planar(0.1 * tick, 0, 0), stamp)
            builder.pose("/vicon/robot/pose", planar(3.0 + 0.09 * tick, 1.0, 0), stamp)
            builder.image(COLOURS, colours(tick), "rgb8", stamp)

    frames, _ = read(tmp_path / "drive")

    assert frames[2].truth == pytest.approx([3.28, 1.0, 0.0])
    assert frames[2].odometry == pytest.approx([0.3, 0.0, 0.0])


def test_images_without_depth_or_pose_of_their_moment_are_dropped_and_counted(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for tick in range(20):
            stamp = BEGIN_S + 0.1 * tick
            if tick < 12:
                builder.odometry("/odom", planar(0.1 * tick, 0, 0), stamp)
            builder.image(COLOURS, colours(0), "rgb8", stamp)
            if tick % 2 == 0:
                builder.image("/camera/depth/image_raw", metres(0), "32FC1", stamp)

    frames, reader = read(tmp_path / "drive")

    assert len(frames) == 6
    assert reader.dropped == {"no depth image at that time": 10, "no pose at that time": 4}


def test_stamps_that_go_backwards_are_dropped_and_missing_ones_are_those_of_recording(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for tick, stamp in enumerate((0.0, 0.1, 0.05, 0.2)):
            builder.image(COLOURS, colours(tick), "rgb8", BEGIN_S + stamp, log_s=BEGIN_S + 0.1 * tick)
    with bag(tmp_path / "unstamped") as builder:
        for tick in range(4):
            log_s = BEGIN_S + 0.1 * tick
            builder.odometry("/odom", planar(0.1 * tick, 0, 0), log_s)
            builder.image(COLOURS, colours(tick), "rgb8", 0.0, log_s=log_s)

    frames, reader = read(tmp_path / "drive")
    unstamped, doubtful = read(tmp_path / "unstamped")

    assert [frame.stamp - BEGIN_S for frame in frames] == pytest.approx([0.0, 0.1, 0.2], abs=1e-6)
    assert reader.dropped == {"not later than the image before": 1}
    assert [frame.odometry[0] for frame in unstamped if frame.odometry is not None] == pytest.approx([0, 0.1, 0.2, 0.3])
    assert "time of recording" in doubtful.doubts[0]


@pytest.mark.parametrize(("log_begin_s", "first_image_s"), [(BEGIN_S, 0.0), (BEGIN_S, 0.1), (0.0, 0.0)])
def test_a_simulators_clock_may_begin_at_zero(tmp_path: Path, log_begin_s: float, first_image_s: float) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.transforms("/tf_static", {("base_footprint", COLOUR_FRAME): mounted(x=0.0)}, 0.0, log_begin_s or 0.001)
        for tick in range(30):
            stamp = 0.1 * tick
            log_s = log_begin_s + stamp + 0.001
            builder.odometry("/odom", planar(0.1 * tick, 0, 0), stamp, log_s=log_s)
            if stamp >= first_image_s:
                builder.image(COLOURS, colours(tick % 9), "rgb8", stamp, log_s=log_s)
                builder.image("/camera/depth/image_raw", metres(0), "32FC1", stamp, log_s=log_s)

    frames, reader = read(tmp_path / "drive")

    assert frames[0].stamp == pytest.approx(first_image_s)
    assert [frame.odometry[0] for frame in frames if frame.odometry is not None] == pytest.approx(
        [frame.stamp for frame in frames]
    )
    assert len(frames) == 30 - round(10 * first_image_s)
    assert not reader.dropped
    assert not reader.doubts


def test_where_no_message_has_a_stamp_the_time_of_recording_counts(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for tick in range(15):
            log_s = BEGIN_S + 0.1 * tick
            builder.odometry("/odom", planar(0.1 * tick, 0, 0), 0.0, log_s=log_s)
            builder.image(COLOURS, colours(tick), "rgb8", 0.0, log_s=log_s)

    frames, reader = read(tmp_path / "drive")

    assert [frame.stamp - BEGIN_S for frame in frames] == pytest.approx(0.1 * np.arange(15), abs=1e-6)
    assert "header.stamp" in reader.doubts[0]


def test_frames_by_another_clock_than_the_images_are_taken_by_the_time_of_recording(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.transforms("/tf_static", {("base_link", COLOUR_FRAME): mounted(x=0.0)}, BEGIN_S)
        for tick in range(12):
            log_s = BEGIN_S + 0.1 * tick
            builder.transforms("/tf", {("odom", "base_link"): planar(0.1 * tick, 0, 0)}, log_s + 900, log_s)
            builder.image(COLOURS, colours(tick), "rgb8", log_s, log_s=log_s)

    frames, reader = read(tmp_path / "drive")

    assert [frame.odometry[0] for frame in frames if frame.odometry is not None] == pytest.approx(0.1 * np.arange(12))
    assert "time of recording" in reader.doubts[0]


def test_poses_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for tick in range(6):
            x = np.nan if tick == 3 else 0.1 * tick
            builder.odometry("/odom", planar(x, 0, 0), BEGIN_S + 0.1 * tick)
            builder.image(COLOURS, colours(tick), "rgb8", BEGIN_S + 0.1 * tick)

    frames, reader = read(tmp_path / "drive")

    assert [frame.odometry[0] for frame in frames if frame.odometry is not None] == pytest.approx(0.1 * np.arange(6))
    assert any("not finite" in doubt for doubt in reader.doubts)


def test_odometry_can_be_left_out(tmp_path: Path) -> None:
    frames, _ = read(straight_drive(tmp_path / "drive"), ReadOptions(odometry="none", depth="none"))

    assert len(frames) == 6
    assert all(frame.odometry is None and frame.depth_m is None for frame in frames)
