"""A bag that is cut, empty, foreign or made to do harm ends in one clear error."""

import struct
from contextlib import suppress
from pathlib import Path

import apsw
import numpy as np
import pytest
from backports import zstd

from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag.bag_files import MAX_CHUNK_BYTES
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from ltvn_core.errors import DriveError
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, bag, colours, jpeg, straight_drive


def read(path: Path) -> list[RawFrame]:
    return list(RosbagReader.open(path, ReadOptions()).frames())


def only_file(folder: Path) -> Path:
    return next(file for file in folder.iterdir() if file.suffix != ".yaml")


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "bag"])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.97])
def test_a_cut_file_ends_in_one_line(tmp_path: Path, kind: str, share: float) -> None:
    path = straight_drive(tmp_path / ("drive.bag" if kind == "bag" else "drive"), kind, frames=3)
    file = path if kind == "bag" else only_file(path)
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * share)])

    with pytest.raises(DriveError) as caught:
        read(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag"])
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 a zip", b"SQLite format 3\0" + bytes(2000), bytes(5000)])
def test_a_foreign_file_with_the_right_ending_ends_in_one_line(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"drive{suffix}"
    path.write_bytes(content)

    assert RosbagReader.recognises(path)
    with pytest.raises(DriveError, match="cannot be read as a bag"):
        read(path)


@pytest.mark.parametrize("kind", ["mcap", "bag"])
def test_damage_anywhere_gives_frames_or_one_error(tmp_path: Path, kind: str) -> None:
    path = straight_drive(tmp_path / ("drive.bag" if kind == "bag" else "drive"), kind, frames=2)
    file = path if kind == "bag" else only_file(path)
    whole, rng = file.read_bytes(), np.random.default_rng(5)
    for _ in range(15):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 8):
            damaged[place] = rng.integers(0, 256)
        file.write_bytes(damaged)
        with suppress(DriveError):
            assert len(read(file)) <= 2


def mcap_of_one_chunk(path: Path, *, uncompressed: int, content: bytes) -> None:
    """Write an MCAP without an index whose only chunk says that it unpacks to so many bytes."""

    def record(kind: int, body: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(body)) + body

    def text(words: str) -> bytes:
        return struct.pack("<I", len(words)) + words.encode()

    chunk = struct.pack("<QQQI", 0, 2**62, uncompressed, 0) + text("zstd") + struct.pack("<Q", len(content)) + content
    magic = b"\x89MCAP0\r\n"
    footer = struct.pack("<QQI", 0, 0, 0)
    path.write_bytes(magic + record(1, text("ros2") + text("")) + record(6, chunk) + record(2, footer) + magic)


@pytest.mark.parametrize("said", [1000, 2**40])
def test_a_chunk_that_unpacks_to_more_than_it_may_is_refused(tmp_path: Path, said: int) -> None:
    bomb = zstd.compress(bytes(30_000_000))
    mcap_of_one_chunk(tmp_path / "bomb.mcap", uncompressed=said, content=bomb)

    with pytest.raises(DriveError, match=r"unpacks to|mismatch"):
        read(tmp_path / "bomb.mcap")


def test_a_compressed_file_that_would_fill_the_disk_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bomb.db3.zstd").write_bytes(zstd.compress(bytes(30_000_000)))

    with pytest.raises(DriveError, match="unpacks to more than"):
        read(tmp_path / "bomb.db3.zstd")


def test_a_huge_value_that_a_database_computes_is_refused(tmp_path: Path) -> None:
    path = straight_drive(tmp_path / "drive", "sqlite3", frames=3)
    with apsw.Connection(str(only_file(path))) as database:
        database.execute("ALTER TABLE messages RENAME TO small")
        database.execute(
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
            f"data BLOB GENERATED ALWAYS AS (zeroblob({MAX_CHUNK_BYTES + 1})))"
        )
        database.execute("INSERT INTO messages (id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM small")

    with pytest.raises(DriveError, match="too big"):
        read(path)


def test_definitions_of_messages_in_the_file_are_never_used(tmp_path: Path) -> None:
    """The library makes code of definitions; these would give the image other fields."""
    path = straight_drive(tmp_path / "drive", frames=3)
    file = only_file(path)
    file.write_bytes(file.read_bytes().replace(b"uint32 height", b"uint16 xeight"))

    assert len(read(path)) == 3


def test_an_image_that_lies_about_its_size_is_left_out(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for tick in range(3):
            builder.image("/camera/image_raw", colours(tick), "rgb8", BEGIN_S + tick)
        lying = colours(0)[:4]
        message = builder.make(
            "sensor_msgs/msg/Image",
            header=builder.header(BEGIN_S + 3, "camera"),
            height=2**31,
            width=2**31,
            encoding="rgb8",
            is_bigendian=0,
            step=2**31,
            data=lying.ravel(),
        )
        builder.write("/camera/image_raw", message, BEGIN_S + 3)
    reader = RosbagReader.open(tmp_path / "drive", ReadOptions())

    assert len(list(reader.frames())) == 3
    assert reader.dropped == {"damaged image": 1}


def test_a_bag_of_damaged_images_says_so(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.compressed("/camera/image_raw/compressed", jpeg(colours(0))[:200], "jpeg", BEGIN_S)

    with pytest.raises(DriveError, match="1 with damaged image"):
        read(tmp_path / "drive")


def test_a_bag_without_images_says_what_it_holds(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.camera_info("/camera/camera_info", BEGIN_S)

    with pytest.raises(DriveError, match=r"no colour images.*CameraInfo"):
        read(tmp_path / "drive")
