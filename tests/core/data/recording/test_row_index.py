"""A recording with an index shows the same as one that is read as a whole, without reading its images first."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from numpy.typing import NDArray

from ltvn_core.data.recording import indexed_rows
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrd_contents import open_contents
from ltvn_core.data.recording.rrf2.chunk_table import ListedChunk
from ltvn_core.data.recording.rrf2.closing_record import closing_bytes
from ltvn_core.data.recording.rrf2.file_check import check_file
from ltvn_core.data.recording.rrf2.layout import CHUNK_KIND
from ltvn_core.data.recording.rrf2.row_index import (
    FrameList,
    FrameTable,
    IndexedChunks,
    RowIndex,
    index_field,
    read_index,
)
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_core.protobuf_fields import bytes_field, number_field
from ltvn_core.types import OriginalImage, Tilt
from tests.core.data.recording import example_recording
from tests.repository import DEMO_DRIVE, DEMO_FAULT, DEMO_MAP


def is_indexed(path: Path) -> bool:
    return check_file(path).row_index is not None


def assert_same_as_whole(path: Path) -> None:
    """Compare everything that can be read of a recording with a reading of all its rows."""
    indexed, whole = Recording.open(path), Recording(path, open_contents(path, whole=True))
    assert indexed.meta == whole.meta
    assert indexed.frames == whole.frames
    assert indexed.half_frames == whole.half_frames
    assert indexed.stored_events == whole.stored_events
    assert indexed.scene_glb() == whole.scene_glb()
    assert all(one.equals(other) for one, other in zip(indexed.user_rows(), whole.user_rows(), strict=True))
    for one, other in zip(indexed.poses, whole.poses, strict=True):
        np.testing.assert_array_equal(one, other)
    for frame in indexed.frames:
        one, other = indexed.stored_frame(frame), whole.stored_frame(frame)
        assert one.intact
        assert one[1:] == other[1:]  # The checksums of all its contents.


@pytest.fixture
def rich(tmp_path: Path) -> Path:
    """A recording in many messages: pictures kept now and then, steps out of order, no exact pose, rows of a user."""
    path = tmp_path / "rich.rrd"
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        camera = Recording.open(DEMO_DRIVE).meta.camera
        for step in (3, 1, 2, 9, 7, 20, 21, 22):
            tilt = Tilt(0.0, 0.1) if step in (1, 21) else None
            seen = replace(example_recording.observation(step), exact_pose=None, tilt=tilt)
            if step % 2:
                seen = replace(seen, original=OriginalImage(b"\xff\xd8 a picture", camera))
            writer.write_frame(seen if step != 9 else replace(seen, depth=None))
            writer.log("my/score", step / 2)
            if step % 3 == 0:
                writer._stream.flush()
        writer.log("my/note", rr.TextLog("the end"))
    return path


def test_what_the_index_shows_is_what_the_file_holds(whole: Path, rich: Path) -> None:
    for path in (whole, rich):
        assert is_indexed(path)
        assert_same_as_whole(path)
        assert verify(path).frames == len(Recording.open(path).frames)


@pytest.mark.parametrize("path", [DEMO_DRIVE, DEMO_FAULT, DEMO_MAP], ids=lambda path: path.stem)
def test_a_rewritten_recording_has_an_index(path: Path, tmp_path: Path) -> None:
    repair(path, tmp_path / "new.rrd")
    assert is_indexed(tmp_path / "new.rrd")
    assert_same_as_whole(tmp_path / "new.rrd")


def test_verify_compares_the_poses_of_the_index_with_those_of_the_images(whole: Path, tmp_path: Path) -> None:
    found = check_file(whole)
    assert found.record is not None
    assert found.row_index is not None
    number_of = np.cumsum(found.record.messages["kind"] == CHUNK_KIND) - 1
    listed = {
        entity: [
            ListedChunk(int(number_of[message]), int(rows), 0, 0, is_static=False)
            for message, rows in zip(chunks.messages, chunks.rows, strict=True)
        ]
        for entity, chunks in found.row_index.chunks.items()
    }
    frames = found.row_index.frames
    moved = frames._replace(odometry=frames.odometry + 0.01)
    index = index_field(found.row_index.recording_id, found.row_index.body_crc32, listed, found.record.messages, moved)
    data = whole.read_bytes()[: found.record.messages_end]
    (tmp_path / "moved.rrd").write_bytes(data + closing_bytes(found.record, index=index))
    with pytest.raises(RecordingError, match="another pose"):
        verify(tmp_path / "moved.rrd")


def forged(whole: Path, path: Path, change: Callable[[RowIndex], RowIndex]) -> Path:
    """Write a recording whose index was changed, with all checksums right."""
    found = check_file(whole)
    assert found.record is not None
    assert found.row_index is not None
    changed = change(found.row_index)
    names = list(changed.chunks)
    rows = [(name, *row) for name in names for row in zip(*changed.chunks[name][:2], strict=True)]
    chunks = {
        "entity": pa.array([row[0] for row in rows]).dictionary_encode(),
        "message": pa.array([row[1] for row in rows], pa.int64()),
        "rows": pa.array([row[2] for row in rows], pa.int64()),
        "in_order": pa.array([True] * len(rows)),
    }
    columns = {
        "step": changed.frames.steps,
        "stamp": changed.frames.stamps,
        "has_original": changed.frames.has_original,
    }
    for name, poses in (("odometry", changed.frames.odometry), ("exact", changed.frames.exact)):
        columns |= {f"{name}_{axis}": poses[:, k] for k, axis in enumerate(("x", "y", "yaw"))}
    body = bytes_field(1, changed.recording_id.encode()) + number_field(2, changed.body_crc32)
    for number, table in ((3, chunks), (4, columns)):
        sink = pa.BufferOutputStream()
        batch = pa.record_batch(table)
        with pa.ipc.new_stream(sink, batch.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
            writer.write_batch(batch)
        body += bytes_field(number, sink.getvalue().to_pybytes())
    data = whole.read_bytes()[: found.record.messages_end]
    path.write_bytes(data + closing_bytes(found.record, index=bytes_field(7001, body)))
    return path


def with_frames(**arrays: Callable[[NDArray], NDArray]) -> Callable[[RowIndex], RowIndex]:
    """Change arrays of the frames."""

    def change(index: RowIndex) -> RowIndex:
        changed = {name: make(getattr(index.frames, name)) for name, make in arrays.items()}
        return replace(index, frames=index.frames._replace(**changed))

    return change


def with_chunks(make: Callable[[dict[str, IndexedChunks]], dict[str, IndexedChunks]]) -> Callable[[RowIndex], RowIndex]:
    """Change the chunks."""
    return lambda index: replace(index, chunks=make(dict(index.chunks)))


RGB, DEPTH, EVENTS = "/world/robot/camera/rgb", "/world/robot/camera/depth", "/events"
HALF = dict.fromkeys(FrameTable._fields, lambda array: array[::2])
FORGED = {
    "as written": with_frames(),
    "half of the frames": with_frames(**HALF),
    "no frame": with_frames(**dict.fromkeys(FrameTable._fields, lambda array: array[:0])),
    "steps of others": with_frames(steps=lambda steps: steps[::-1].copy()),
    "unknown steps": with_frames(steps=lambda steps: steps + 100),
    "equal steps": with_frames(steps=lambda steps: steps * 0),
    "other times": with_frames(stamps=lambda stamps: stamps + 1),
    "no times": with_frames(stamps=lambda stamps: stamps * np.nan),
    "texts for steps": with_frames(steps=lambda steps: steps.astype(str)),
    "many frames": with_frames(**dict.fromkeys(FrameTable._fields, lambda array: np.repeat(array, 10**6, axis=0))),
    "no events": with_chunks(lambda chunks: {name: each for name, each in chunks.items() if name != EVENTS}),
    "depth for colours": with_chunks(lambda chunks: chunks | {RGB: chunks[DEPTH], DEPTH: chunks[RGB]}),
    "messages before the first": with_chunks(
        lambda chunks: chunks | {RGB: chunks[RGB]._replace(messages=chunks[RGB].messages - 10**6)}
    ),
    "messages behind the last": with_chunks(
        lambda chunks: chunks | {RGB: chunks[RGB]._replace(messages=chunks[RGB].messages + 10**6)}
    ),
    "more rows than there can be": with_chunks(
        lambda chunks: chunks | {EVENTS: chunks[EVENTS]._replace(rows=chunks[EVENTS].rows + 2**40)}
    ),
}


@pytest.mark.parametrize("name", FORGED)
def test_an_index_that_differs_from_the_file_is_refused_or_not_used(whole: Path, tmp_path: Path, name: str) -> None:
    path = forged(whole, tmp_path / "forged.rrd", FORGED[name])
    if name != "as written" and is_indexed(path):
        with pytest.raises(RecordingError, match="ltvn repair"):
            verify(path)
    else:
        verify(path)
        right = Recording.open(whole)
        shown = Recording.open(path)
        assert shown.frames == right.frames
        assert shown.events == right.events
        assert all(shown.stored_frame(each)[1:] == right.stored_frame(each)[1:] for each in right.frames)
    saved = repair(path, tmp_path / "new.rrd")
    assert (saved.frames, saved.left_out) == (10, ())
    assert verify(tmp_path / "new.rrd").events == saved.events


def test_a_closing_record_without_numbers_of_rows_is_refused(whole: Path, tmp_path: Path) -> None:
    record = check_file(whole).record
    assert record is not None
    changed = closing_bytes(replace(record, rows={entity: "many" for entity in record.rows}))  # pyright: ignore[reportArgumentType]
    (tmp_path / "many.rrd").write_bytes(whole.read_bytes()[: record.messages_end] + changed)
    with pytest.raises(RecordingError, match="ltvn repair"):
        verify(tmp_path / "many.rrd")
    assert repair(tmp_path / "many.rrd", tmp_path / "new.rrd").frames == 10


def test_a_recording_without_images_has_an_index(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "empty.rrd", scene="demo", config={}, fingerprint=""):
        pass
    assert is_indexed(tmp_path / "empty.rrd")
    assert_same_as_whole(tmp_path / "empty.rrd")


def test_a_file_that_was_deleted_can_still_be_read(rich: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for in_memory in (0, 2**26):
        monkeypatch.setattr(indexed_rows, "_IN_MEMORY_BYTES", in_memory)
        copied = rich.with_name(f"copy-{in_memory}.rrd")
        copied.write_bytes(rich.read_bytes())
        opened = Recording.open(copied)
        copied.unlink()
        assert all(opened.is_intact(frame) for frame in opened.frames)


@pytest.mark.parametrize("damage", [b"", bytes(10**6)], ids=["emptied", "overwritten"])
def test_a_file_that_changed_after_it_was_opened_is_not_believed(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: bytes
) -> None:
    monkeypatch.setattr(indexed_rows, "_IN_MEMORY_BYTES", 0)
    copied = tmp_path / "copy.rrd"
    copied.write_bytes(whole.read_bytes())
    opened = Recording.open(copied)
    copied.write_bytes(damage)  # Into the same file.
    with pytest.raises(RecordingError, match="Open it again"):
        opened.observation(opened.frames[-1])


@pytest.mark.parametrize(
    ("chunks", "in_order"),
    [
        ([ListedChunk(0, 3, 4, 6, is_static=False)], True),
        ([ListedChunk(0, 2, 4, 6, is_static=False), ListedChunk(1, 1, 5, 5, is_static=False)], False),
        ([ListedChunk(0, 3, 4, 7, is_static=False)], False),
        ([ListedChunk(0, 2, 4, 5, is_static=False)], None),
        ([ListedChunk(0, 4, 4, 6, is_static=False)], None),
    ],
    ids=["as written", "sorted by columns", "another step", "a row less", "a row more"],
)
def test_the_order_of_images_is_believed_only_where_it_is_sure(
    chunks: Sequence[ListedChunk], *, in_order: bool | None, whole: Path
) -> None:
    record = check_file(whole).record
    assert record is not None
    rgb, depth = "/world/robot/camera/rgb", "/world/robot/camera/depth"
    listed = {rgb: chunks, depth: [ListedChunk(0, 3, 4, 6, is_static=False)]}
    frames = FrameList()
    for step in (4, 5, 6):
        frames.append(step, step / 5, np.zeros(3), None, has_original=False)
    index = read_index(index_field("id", 1, listed, record.messages, frames.table()), 10_000)
    assert (None if index is None else index.chunks[rgb].in_order) == in_order
