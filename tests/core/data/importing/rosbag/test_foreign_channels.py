"""An MCAP may hold channels that ROS 2 did not write: its own are read, the others are named."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.importing.raw_frame import DriveReader, RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from ltvn_core.errors import DriveError
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, BagBuilder, bag, colours, straight_drive

COLOURS = "/camera/color/image_raw"


def read(path: Path) -> tuple[list[RawFrame], DriveReader]:
    reader = RosbagReader.open(path, ReadOptions())
    return list(reader.frames()), reader


def add_foreign(builder: BagBuilder, topic: str, encoding: str) -> None:
    connection = builder.writer.add_connection(
        topic, "foxglove/msg/Log", msgdef="string name", rihs01="RIHS01_0", serialization_format=encoding
    )
    builder.writer.write(connection, round(BEGIN_S * 1e9), b'{"name": "hello"}')


def of_another_schema(folder: Path, encoding: bytes, content: bytes) -> Path:
    """Have the schema of the foreign channel be in an encoding that ROS does not know; both keep their lengths."""
    file = next(folder.glob("*.mcap"))
    whole, known = file.read_bytes(), b"foxglove/msg/Log\x07\x00\x00\x00ros2msg\x0b\x00\x00\x00string name"
    assert known in whole
    file.write_bytes(whole.replace(known, known.replace(b"ros2msg", encoding).replace(b"string name", content)))
    return file


@pytest.mark.parametrize(
    ("encoding", "schema", "content"),
    [("json", b"jsonsch", b'{"type":{}}'), ("protobuf", b"protobf", b"\n\x05x\xff\xfe\x80\x81\x82\x83\x84\x85")],
)
def test_channels_of_ros_2_are_read_and_others_are_named(
    tmp_path: Path, encoding: str, schema: bytes, content: bytes
) -> None:
    with bag(tmp_path / "drive") as builder:
        add_foreign(builder, "/log", encoding)
        for number in range(3):
            builder.image(COLOURS, colours(number), "rgb8", BEGIN_S + 0.1 * number)

    frames, reader = read(of_another_schema(tmp_path / "drive", schema, content))

    assert [np.array_equal(frame.rgb, colours(number)) for number, frame in enumerate(frames)] == [True] * 3
    assert any(f"/log ({encoding})" in doubt for doubt in reader.doubts)


def test_where_nothing_of_ros_2_is_left_the_error_names_what_is_there(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        add_foreign(builder, "/front/image", "protobuf")

    with pytest.raises(DriveError, match=r"no colour images.*/front/image \(protobuf\)"):
        read(tmp_path / "drive")


def of_profile(folder: Path, profile: bytes) -> Path:
    file = next(straight_drive(folder, frames=2).glob("*.mcap"))
    file.write_bytes(file.read_bytes().replace(b"\x04\x00\x00\x00ros2", b"\x04\x00\x00\x00" + profile, 1))
    return file


def test_a_file_of_ros_1_in_mcap_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match=r"not written by ROS 2.*ROS 1") as caught:
        read(of_profile(tmp_path / "drive", b"ros1"))
    assert "recover" not in str(caught.value)


def test_a_file_of_no_profile_is_read_by_what_its_channels_say(tmp_path: Path) -> None:
    frames, _ = read(of_profile(tmp_path / "drive", b"\0\0\0\0"))

    assert [np.array_equal(frame.rgb, colours(number)) for number, frame in enumerate(frames)] == [True] * 2


def test_only_a_file_that_was_cut_is_advised_to_be_recovered(tmp_path: Path) -> None:
    whole = next(straight_drive(tmp_path / "drive", frames=1).glob("*.mcap"))
    cut, other = tmp_path / "cut.mcap", tmp_path / "other.mcap"
    cut.write_bytes(whole.read_bytes()[:-40])
    other.write_bytes(b"a text")

    with pytest.raises(DriveError, match="mcap recover"):
        read(cut)
    with pytest.raises(DriveError, match="first bytes"):
        read(other)
