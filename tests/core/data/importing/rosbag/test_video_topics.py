"""Colours that a bag holds as a video are decoded packet by packet, and belong to the stamps of their messages."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.typesys import get_types_from_msg

from ltvn_core.data.importing.raw_frame import DriveReader, RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from ltvn_core.errors import DriveError
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, COLOUR_FRAME, BagBuilder, bag
from tests.core.data.importing.rosbag.foxglove_examples import FoxgloveFile, time

COLOURS = "/camera/image_raw/ffmpeg"
WIDTH, HEIGHT = 160, 120
GROUP = 5
"""Each fifth picture is a key frame."""
PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
FIELDS = "int32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
DEFINITIONS = {
    False: f"std_msgs/Header header\n{FIELDS}bool is_bigendian\nuint8[] data\n",
    True: f"std_msgs/Header header\nuint8[] data\n{FIELDS}",
}


def brightness(number: int) -> int:
    return 20 + 15 * number


def picture(number: int) -> NDArray[np.uint8]:
    return np.full((HEIGHT, WIDTH, 3), brightness(number), np.uint8)


def encoded(encoder: str = "libx264", count: int = 12, reordered: int = 0) -> list[tuple[int, bytes]]:
    """Return the packets of a video as (number of the picture, data) in the order in which they are sent."""
    context: Any = av.CodecContext.create(encoder, "w")
    context.width, context.height, context.pix_fmt, context.time_base = WIDTH, HEIGHT, "yuv420p", Fraction(1, 10)
    context.gop_size, context.max_b_frames = GROUP, reordered
    context.options = {"bf": str(reordered), "x265-params": "log-level=none"}
    if not reordered:
        context.options |= {"preset": "ultrafast", "tune": "zerolatency"}
    packets = []
    for number in range(count):
        frame = av.VideoFrame.from_ndarray(picture(number), format="rgb24")
        frame.pts = number
        packets += context.encode(frame)
    packets += context.encode(None)
    return [(packet.pts, bytes(packet)) for packet in packets]


def stamp_of(number: int) -> float:
    return BEGIN_S + 0.1 * number


def write_packet(builder: BagBuilder, topic: str, data: bytes, encoding: str, stamp: float, log_s: float = 0.0) -> None:
    if PACKET not in builder.store.types:
        builder.store.register(get_types_from_msg(DEFINITIONS[builder.ros1], PACKET))
    further = {} if builder.ros1 else {"is_bigendian": False}
    message = builder.make(
        PACKET,
        header=builder.header(stamp, COLOUR_FRAME),
        width=WIDTH,
        height=HEIGHT,
        encoding=encoding,
        pts=0,
        flags=0,
        data=np.frombuffer(data, np.uint8),
        **further,
    )
    builder.write(topic, message, log_s or stamp)


def video_bag(path: Path, packets: Sequence[tuple[int, bytes]], encoding: str = "libx264;yuv420p;bgr8;bgr8") -> Path:
    with bag(path) as builder:
        for number, data in packets:
            write_packet(builder, COLOURS, data, encoding, stamp_of(number))
    return path


def read(path: Path, options: ReadOptions | None = None) -> tuple[list[RawFrame], DriveReader]:
    reader = RosbagReader.open(path, options or ReadOptions())
    return list(reader.frames()), reader


def numbers(frames: Sequence[RawFrame]) -> list[int]:
    """Return which pictures the frames show, after a check that they have their stamps."""
    shown = [round((float(frame.rgb.mean()) - brightness(0)) / 15) for frame in frames]
    assert [frame.stamp for frame in frames] == pytest.approx([stamp_of(number) for number in shown], abs=1e-6)
    return shown


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "bag"])
def test_packets_of_ffmpeg_image_transport_are_decoded_beside_depth_images(tmp_path: Path, kind: str) -> None:
    path = tmp_path / ("drive.bag" if kind == "bag" else "drive")
    with bag(path, kind) as builder:
        builder.camera_info("/camera/camera_info", BEGIN_S, size=(WIDTH, HEIGHT), centre=(79.5, 59.5))
        for number, data in encoded():
            write_packet(builder, COLOURS, data, "libx264", stamp_of(number))
            depth = np.full((HEIGHT, WIDTH), 1000 + number, np.uint16)
            builder.image("/camera/depth/image_raw", depth, "16UC1", stamp_of(number))

    frames, reader = read(path)

    assert numbers(frames) == list(range(12))
    for number, frame in enumerate(frames):
        assert frame.depth_m is not None
        assert np.allclose(frame.depth_m, 1 + number / 1000)
    assert not reader.dropped
    assert not reader.doubts


@pytest.mark.parametrize(("form", "encoder"), [("h264", "libx264"), ("h265", "libx265"), ("hevc", "libx265")])
def test_video_in_compressed_images_is_decoded(tmp_path: Path, form: str, encoder: str) -> None:
    with bag(tmp_path / "drive") as builder:
        for number, data in encoded(encoder):
            builder.compressed("/front", data, form, stamp_of(number))

    frames, _ = read(tmp_path / "drive")

    assert numbers(frames) == list(range(12))


def test_video_of_foxglove_is_decoded_without_ros(tmp_path: Path) -> None:
    with FoxgloveFile(tmp_path / "drive.mcap") as file:
        for number, data in encoded():
            stamp = stamp_of(number)
            fields = {"timestamp": time(stamp), "frame_id": COLOUR_FRAME, "data": data, "format": "h264"}
            file.write("/video", "CompressedVideo", fields, stamp)

    frames, _ = read(tmp_path / "drive.mcap")

    assert numbers(frames) == list(range(12))


def test_pictures_that_an_encoder_sent_in_another_order_keep_their_stamps(tmp_path: Path) -> None:
    packets = encoded(reordered=2)
    assert [number for number, _ in packets] != sorted(number for number, _ in packets)
    with bag(tmp_path / "drive") as builder:
        for place, (number, data) in enumerate(packets):
            write_packet(builder, COLOURS, data, "h264", stamp_of(number), log_s=stamp_of(place + 3))

    frames, reader = read(tmp_path / "drive")

    assert numbers(frames) == list(range(12))
    assert not reader.dropped


def test_a_video_begins_with_its_first_key_frame(tmp_path: Path) -> None:
    frames, reader = read(video_bag(tmp_path / "drive", encoded()[2:]))

    assert numbers(frames) == list(range(GROUP, 12))
    assert dict(reader.dropped) == {"no key frame of the video before it": GROUP - 2}


@pytest.mark.parametrize("damage", [b"junk" * 20, b"", b"\0\0\0\1\x65" + b"\xff" * 40])
def test_after_a_damaged_packet_images_are_left_out_up_to_the_next_key_frame(tmp_path: Path, damage: bytes) -> None:
    packets = encoded()
    packets[GROUP + 1] = (GROUP + 1, damage)

    frames, reader = read(video_bag(tmp_path / "drive", packets))

    assert numbers(frames) == [*range(GROUP + 1), *range(2 * GROUP, 12)]
    assert sum(reader.dropped.values()) == GROUP - 1
    assert any("key frame" in doubt for doubt in reader.doubts)


def test_where_no_packet_can_be_decoded_that_is_one_clear_error(tmp_path: Path) -> None:
    path = video_bag(tmp_path / "drive", [(number, b"x") for number in range(3)])

    with pytest.raises(DriveError, match="3 with damaged image"):
        read(path)


def test_a_picture_that_is_larger_than_video_can_be_is_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ltvn_core.data.importing.rosbag.video_stream._MOST_PIXELS", WIDTH * HEIGHT // 4)

    with pytest.raises(DriveError, match="can be used"):
        read(video_bag(tmp_path / "drive", encoded()))


def test_video_of_an_unknown_codec_is_named(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match=r"theora.*h264"):
        read(video_bag(tmp_path / "drive", encoded(), "theora"))


def test_depth_as_a_video_is_named_and_not_taken_for_colours(tmp_path: Path) -> None:
    depth = "/camera/depth/image_raw/ffmpeg"
    with bag(tmp_path / "drive") as builder:
        for number, data in encoded():
            write_packet(builder, COLOURS, data, "h264", stamp_of(number))
            write_packet(builder, depth, data, "libx265;gray12le;mono16;16UC1", stamp_of(number))

    frames, reader = read(tmp_path / "drive")

    assert numbers(frames) == list(range(12))
    assert any(depth in doubt for doubt in reader.doubts)
    assert {stream.name: stream.role for stream in reader.facts.streams}[depth] == ""
    with pytest.raises(DriveError, match=f"{depth} is depth as a video"):
        read(tmp_path / "drive", ReadOptions(depth=depth))


def test_images_are_preferred_to_the_video_of_the_same_camera(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for number, data in encoded():
            write_packet(builder, COLOURS, data, "h264", stamp_of(number))
            builder.image("/camera/image_raw", picture(number), "rgb8", stamp_of(number))

    frames, reader = read(tmp_path / "drive")

    assert len(frames) == 12
    assert {stream.role: stream.name for stream in reader.facts.streams}["rgb"] == "/camera/image_raw"
