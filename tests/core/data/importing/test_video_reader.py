"""A video of a phone is a drive: its images come out upright with their times, and a damaged one is said to be so."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.raw_frame import ReadOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.data.importing.source_camera import parse_camera
from ltvn_core.data.importing.video_reader import VideoReader
from ltvn_core.errors import DriveError

av = pytest.importorskip("av")


def write_video(path: Path, *, images: int = 12, rate: int = 5) -> Path:
    """Write a video whose left half is red and whose right half becomes brighter."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("mpeg4", rate=rate)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 64, 48, "yuv420p", 2_000_000
        for k in range(images):
            image = np.full((48, 64, 3), 20 * k % 256, np.uint8)
            image[:, :32] = (220, 20, 20)
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, "rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


@pytest.mark.parametrize("ending", ["mp4", "MOV", "mkv", "avi"])
def test_the_images_of_a_video_come_with_their_times(tmp_path: Path, ending: str) -> None:
    path = write_video(tmp_path / f"walk.{ending.lower()}").rename(tmp_path / f"walk.{ending}")
    reader = VideoReader.open(path, ReadOptions())
    frames = list(reader.frames())
    assert VideoReader.recognises(path)
    assert reader.facts.place == "walk"
    assert [frame.stamp for frame in frames] == pytest.approx([k / 5 for k in range(12)], abs=0.01)
    assert all(np.abs(frame.rgb[10, 50].astype(int) - 20 * k).max() < 25 for k, frame in enumerate(frames))
    assert frames[3].rgb[10, 10, 0] > 150 > frames[3].rgb[10, 10, 1]


def test_a_video_is_imported_by_its_ending_with_lens_and_odometry(tmp_path: Path) -> None:
    path = write_video(tmp_path / "walk.mp4")
    table = tmp_path / "odometry.csv"
    table.write_text("stamp,x,y,yaw\n" + "".join(f"{k / 5},{k / 5},0,0\n" for k in range(12)), encoding="utf-8")
    options = ReadOptions(camera=parse_camera("60,60,31.5,23.5,64,48"), odometry=str(table))
    reader = open_drive(path, "auto", options)
    summary = import_drive(reader, tmp_path / "tour.rrd")
    assert summary.format == "video"
    assert summary.frames == 12
    assert not any("lens" in doubt for doubt in summary.doubts)


def test_a_video_of_a_phone_on_its_side_is_set_upright(tmp_path: Path) -> None:
    path = write_video(tmp_path / "walk.mp4")
    data = path.read_bytes()
    unturned = struct.pack(">9i", 0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000)
    clockwise = struct.pack(">9i", 0, 0x10000, 0, -0x10000, 0, 0, 48 * 0x10000, 0, 0x40000000)
    track = data.index(b"tkhd")
    path.write_bytes(data[:track] + data[track:].replace(unturned, clockwise, 1))
    frame = list(VideoReader.open(path, ReadOptions()).frames())[1]
    assert frame.rgb.shape == (64, 48, 3)
    assert frame.rgb[10, 24, 0] > 150 > frame.rgb[50, 24, 0]


def test_a_cut_video_gives_what_can_be_read_and_says_so(tmp_path: Path) -> None:
    path = write_video(tmp_path / "walk.mkv", images=200)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    reader = VideoReader.open(path, ReadOptions())
    assert 0 < len(list(reader.frames())) < 200


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_video_whose_recording_was_interrupted_is_said_to_lack_its_index(tmp_path: Path, share: float) -> None:
    path = write_video(tmp_path / "walk.mp4", images=60)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * whole.index(b"moov"))])
    with pytest.raises(DriveError, match=r"walk\.mp4 .*index"):
        VideoReader.open(path, ReadOptions())


@pytest.mark.parametrize("content", [b"", b"\0\0\0\x18ftypmp42" + b"\0" * 200, b"RIFF....AVI " * 9])
def test_what_is_no_video_ends_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "walk.mp4"
    path.write_bytes(content)
    with pytest.raises(DriveError, match=r"walk\.mp4") as refusal:
        list(VideoReader.open(path, ReadOptions()).frames())
    assert "\n" not in str(refusal.value)


def test_other_files_and_other_contents_under_the_ending_are_not_taken_for_videos(tmp_path: Path) -> None:
    (tmp_path / "notes.mp4").write_bytes(b"this is a text and no video")
    (tmp_path / "folder.mp4").mkdir()
    assert not VideoReader.recognises(tmp_path / "notes.mp4")
    assert not VideoReader.recognises(tmp_path / "folder.mp4")
    assert not VideoReader.recognises(tmp_path / "missing.mp4")


def write_tracks(path: Path, tracks: list[tuple[str, tuple[int, int]]], images: int = 6) -> Path:
    """Write a Matroska file as k4arecorder does: colours, and 16-bit grey tracks of these titles and sizes."""
    with av.open(str(path), "w", format="matroska") as container:
        streams: list[Any] = []
        for title, (width, height) in [("COLOR", (64, 48)), *tracks]:
            stream: Any = container.add_stream("mjpeg" if title == "COLOR" else "ffv1", rate=5)
            stream.width, stream.height = width, height
            stream.pix_fmt = "yuvj420p" if title == "COLOR" else "gray16le"
            stream.metadata["title"] = title
            streams.append(stream)
        for k in range(images):
            for stream in streams:
                pixels = np.full((stream.height, stream.width), 1000 + 100 * k, np.uint16)
                frame = av.VideoFrame.from_ndarray(pixels, "gray16le")
                if stream is streams[0]:
                    frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 20 * k, np.uint8), "rgb24")
                frame = frame.reformat(format=stream.pix_fmt)
                frame.pts = k
                for packet in stream.encode(frame):
                    container.mux(packet)
        for stream in streams:
            for packet in stream.encode():
                container.mux(packet)
    return path


def test_the_depth_track_of_a_recording_is_read_in_step_with_the_colours(tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "k.mkv", [("DEPTH", (32, 24)), ("IR", (32, 24))])
    reader = VideoReader.open(path, ReadOptions())
    depths = [frame.depth_m for frame in reader.frames()]
    assert [float(np.median(depth)) for depth in depths if depth is not None] == pytest.approx(
        [1 + 0.1 * k for k in range(6)]
    )
    assert [stream.name for stream in reader.facts.streams if not stream.role] == ["IR"]


def test_a_depth_track_of_another_view_is_named_and_not_read(tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "k.mkv", [("DEPTH", (32, 32))])
    summary = import_drive(open_drive(path), tmp_path / "tour.rrd")
    assert summary.without_depth == summary.frames
    assert any("DEPTH" in doubt and "aligned" in doubt for doubt in summary.doubts)


def test_a_track_with_another_title_is_depth_if_it_is_named(tmp_path: Path) -> None:
    path = write_tracks(tmp_path / "k.mkv", [("z", (64, 48))])
    assert [stream.name for stream in open_drive(path).facts.unread("depth")] == ["z"]
    frames = list(open_drive(path, options=ReadOptions(depth="z", depth_unit_m=0.0002)).frames())
    assert frames[0].depth_m is not None
    assert float(frames[0].depth_m[5, 5]) == pytest.approx(0.2)
