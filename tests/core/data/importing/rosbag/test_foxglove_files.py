"""MCAP files in Foxglove's schemas come out as the same frames as bags of ROS do."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.importing.raw_frame import DriveReader, RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from ltvn_core.errors import DriveError
from ltvn_core.protobuf_fields import bytes_field
from tests.core.data.importing.rosbag.bag_examples import (
    BEGIN_S,
    COLOUR_FRAME,
    Place,
    bag,
    colours,
    jpeg,
    metres,
    mounted,
    planar,
)
from tests.core.data.importing.rosbag.foxglove_examples import (
    FoxgloveFile,
    calibration,
    frame_transform,
    raw_image,
    time,
)

COLOURS, DEPTH = "/camera/color/image", "/camera/depth/image"


def read(path: Path, options: ReadOptions | None = None) -> tuple[list[RawFrame], DriveReader]:
    reader = RosbagReader.open(path, options or ReadOptions())
    return list(reader.frames()), reader


def write_images(file: FoxgloveFile, number: int, stamp: float) -> None:
    file.write(COLOURS, "RawImage", raw_image(colours(number), "rgb8", stamp), stamp)
    depth = np.round(metres(number) * 1000).astype("<u2")
    file.write(DEPTH, "RawImage", raw_image(depth, "mono16", stamp), stamp)


def is_at(frame: RawFrame, x: float) -> bool:
    return frame.odometry is not None and bool(np.allclose(frame.odometry, [x, 0, 0], atol=1e-6))


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_images_depth_lens_and_frames_of_foxglove_become_a_drive(tmp_path: Path, encoding: str) -> None:
    with FoxgloveFile(tmp_path / "drive.mcap", encoding) as file:
        file.write("/camera/color/calibration", "CameraCalibration", calibration(), BEGIN_S)
        mounting = frame_transform("base_link", COLOUR_FRAME, mounted(), BEGIN_S)
        file.write("/tf", "FrameTransforms", {"transforms": [mounting]}, BEGIN_S)  # Once, and it holds for good.
        for tick in range(24):
            stamp = BEGIN_S + 0.1 * tick
            moved = frame_transform("odom", "base_link", planar(0.05 * tick, 0, 0), stamp)
            file.write("/tf", "FrameTransforms", {"transforms": [moved]}, stamp)
            if tick % 4 == 2:
                write_images(file, tick // 4, stamp)

    frames, reader = read(tmp_path / "drive.mcap")

    assert [is_at(frame, 0.2 + 0.2 * number) for number, frame in enumerate(frames)] == [True] * 6
    for number, frame in enumerate(frames):
        assert np.array_equal(frame.rgb, colours(number))
        assert frame.depth_m is not None
        assert np.allclose(frame.depth_m, metres(number), atol=1e-6)
    camera = frames[0].camera
    assert camera is not None
    assert (camera.fx, camera.height_m) == (55.0, pytest.approx(0.6))
    assert not reader.dropped
    assert not reader.doubts


def test_a_pose_in_a_frame_is_the_odometry_where_no_frame_moves(tmp_path: Path) -> None:
    with FoxgloveFile(tmp_path / "drive.mcap", "json") as file:
        for tick in range(8):
            stamp = BEGIN_S + 0.1 * tick
            pose = {"position": {"x": 0.1 * tick, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
            file.write("/pose", "PoseInFrame", {"timestamp": time(stamp), "frame_id": "map", "pose": pose}, stamp)
            image = {"timestamp": time(stamp), "frame_id": COLOUR_FRAME, "data": jpeg(colours(tick)), "format": "jpeg"}
            file.write(COLOURS, "CompressedImage", image, stamp)

    frames, reader = read(tmp_path / "drive.mcap")

    assert [is_at(frame, 0.1 * number) for number, frame in enumerate(frames)] == [True] * 8
    assert {stream.name: stream.role for stream in reader.facts.streams}["/pose"] == "odometry"


def test_channels_of_ros_2_and_of_foxglove_in_one_file_are_both_used(tmp_path: Path) -> None:
    with bag(tmp_path / "ros") as builder:
        odometry = [(planar(0.1 * number, 0, 0), BEGIN_S + 0.1 * number) for number in range(4)]
        builder.odometry("/odom", Place(), BEGIN_S)
        store, kind = builder.store, "nav_msgs/msg/Odometry"
        messages = []
        builder.write = lambda topic, message, log_s: messages.append(bytes(store.serialize_cdr(message, kind)))
        for place, stamp in odometry:
            builder.odometry("/odom", place, stamp)
    with FoxgloveFile(tmp_path / "drive.mcap", profile="ros2") as file:
        for number, (_, stamp) in enumerate(odometry):
            file.write_raw("/odom", kind, ("ros2msg", "cdr"), messages[number], stamp)
            write_images(file, number, stamp)
            file.write("/log", "Log", {}, stamp)

    frames, reader = read(tmp_path / "drive.mcap", ReadOptions(depth="none"))

    assert [is_at(frame, 0.1 * number) for number, frame in enumerate(frames)] == [True] * 4
    assert any("/log (protobuf)" in doubt for doubt in reader.doubts)


@pytest.mark.parametrize(
    ("encoding", "data"),
    [
        ("protobuf", b"\xff" * 64),
        ("protobuf", bytes_field(1, b"") * 100_001),
        ("protobuf", bytes_field(2, b"no number")),
        ("json", b"[" * 100_000),
        ("json", b'{"width": 1e999}'),
        ("json", b'"text"'),
    ],
)
def test_a_message_that_is_none_of_its_schema_is_one_clear_error(tmp_path: Path, encoding: str, data: bytes) -> None:
    with FoxgloveFile(tmp_path / "drive.mcap", encoding) as file:
        file.write_raw(COLOURS, "foxglove.RawImage", ("", encoding), data, BEGIN_S)

    with pytest.raises(DriveError, match=r"foxglove.RawImage|can be used"):
        read(tmp_path / "drive.mcap")


def test_a_calibration_with_a_matrix_of_another_size_is_one_clear_error(tmp_path: Path) -> None:
    with FoxgloveFile(tmp_path / "drive.mcap") as file:
        write_images(file, 0, BEGIN_S)
        file.write("/camera/calibration", "CameraCalibration", calibration() | {"K": np.ones(4)}, BEGIN_S)

    with pytest.raises(DriveError, match="expected 9 and 12"):
        read(tmp_path / "drive.mcap")
