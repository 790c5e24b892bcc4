"""Rerun's own tools take our recordings, and we take what they make of them. Each test runs the real `rerun`."""

import subprocess
import sys
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrd_contents import joined_rows, open_contents
from ltvn_core.data.recording.rrf2 import chunk_table
from ltvn_core.data.recording.rrf2.file_check import check_file
from ltvn_core.data.recording.rrf2.layout import (
    CHUNK_KIND,
    HEADER_BYTES,
    MESSAGE_HEADER,
    TAIL_BYTES,
    Tail,
    read_manifests,
)
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_core.navigation.events import Note, StampedEvent
from tests.core.data.recording import example_recording

TOOLS: dict[str, Callable[[Path, Path], list[str]]] = {
    "optimize": lambda old, new: ["optimize", str(old), "-o", str(new)],
    "small chunks": lambda old, new: ["optimize", "--max-rows", "3", str(old), "-o", str(new)],
    "merge": lambda old, new: ["merge", str(old), "-o", str(new)],
    "filter": lambda old, new: ["filter", "--drop-timeline", "log_time", str(old), "-o", str(new)],
    "less drawn": lambda old, new: ["filter", "--drop-entity", "/world/trail", str(old), "-o", str(new)],
}


def rerun(*words: str) -> str:
    """Run `rerun rrd ...` and return what it says; it must not fail."""
    done = subprocess.run(
        [sys.executable, "-m", "rerun_cli", "rrd", *words], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def same_contents(one: Path, other: Path) -> bool:
    """Tell whether two recordings hold the same frames, events and description."""
    first, second = Recording.open(one), Recording.open(other)
    frames = all(
        np.array_equal(first.observation(frame).rgb, second.observation(frame).rgb)
        and np.array_equal(first.observation(frame).odometry, second.observation(frame).odometry)
        and second.is_intact(frame)
        for frame in first.frames
    )
    return (
        first.frames == second.frames
        and frames
        and first.events == second.events
        and np.array_equal(first.poses.stamps, second.poses.stamps)
        and first.meta == second.meta
    )


def manifests(path: Path) -> dict[bytes, tuple[bytes, pa.Table]]:
    """Return the checksum of the schema and the table of chunks of each store, from a file's footer."""
    data = path.read_bytes()
    tail = Tail.read(data[-TAIL_BYTES:])
    assert tail is not None
    footer = data[tail.footer_start : tail.footer_start + tail.footer_bytes]
    found = {}
    for manifest in read_manifests(footer):
        found[manifest.store] = manifest.schema_sha256, pa.Table.from_batches([manifest.chunks])
    return found


def test_a_finished_recording_is_whole_for_rerun(whole: Path) -> None:
    assert "without error" in rerun("verify", str(whole))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reader = RrdReader(whole)
        assert reader.blueprints()
        summary = reader.store().summary()
        streamed = len(list(reader.stream()))
    assert len(summary.splitlines()) == streamed
    assert verify(whole).checksummed


def test_the_table_of_chunks_is_the_one_that_rerun_makes(whole: Path, tmp_path: Path) -> None:
    rerun("merge", str(whole), "-o", str(tmp_path / "merged.rrd"))
    ours, theirs = manifests(whole), manifests(tmp_path / "merged.rrd")
    assert ours.keys() == theirs.keys()
    assert len(ours) == 2  # The recording, and the layout of the viewer.
    for store, (checksum, table) in ours.items():
        assert checksum == theirs[store][0]
        own, other = _rows(table), _rows(theirs[store][1])
        assert own.keys() >= other.keys()
        assert all(own[chunk] == other[chunk] for chunk in other)


def test_the_table_says_where_each_chunk_stands(whole: Path) -> None:
    record = check_file(whole).record
    assert record is not None
    position, chunks = HEADER_BYTES + MESSAGE_HEADER.size, set()
    for kind, _, length in record.messages.tolist():
        if kind == CHUNK_KIND:
            chunks.add((position, length))
        position += MESSAGE_HEADER.size + length
    found = set()
    for _, table in manifests(whole).values():
        offsets, sizes = (table.column(name).to_pylist() for name in ("chunk_byte_offset", "chunk_byte_size"))
        found |= {*zip(offsets, sizes, strict=True)}
    assert found == chunks


def test_a_table_that_would_grow_too_large_is_left_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(chunk_table, "MOST_CELLS", 100)
    example_recording.write(tmp_path / "drive.rrd")
    assert verify(tmp_path / "drive.rrd").checksummed
    tail = Tail.read((tmp_path / "drive.rrd").read_bytes()[-TAIL_BYTES:])
    assert tail is not None
    assert tail.footer_bytes == 0


@pytest.mark.parametrize("name", TOOLS)
def test_what_a_tool_of_rerun_rewrites_reads_as_before(whole: Path, tmp_path: Path, name: str) -> None:
    rewritten = tmp_path / "rewritten.rrd"
    rerun(*TOOLS[name](whole, rewritten))
    found = verify(rewritten)
    assert not found.checksummed
    assert found.note is not None
    assert "Rerun" in found.note
    assert same_contents(whole, rewritten)
    about = read_info(rewritten)
    assert (about.whole, about.frames) == (True, 10)
    saved = repair(rewritten, tmp_path / "repaired.rrd")
    assert (saved.frames, saved.events, saved.left_out) == (10, len(example_recording.events()), ())
    assert same_contents(whole, tmp_path / "repaired.rrd")
    assert verify(tmp_path / "repaired.rrd").checksummed
    rerun("verify", str(tmp_path / "repaired.rrd"))


def test_a_migrated_recording_reads_as_before(whole: Path, tmp_path: Path) -> None:
    migrated = tmp_path / "drive.rrd"
    migrated.write_bytes(whole.read_bytes())
    rerun("migrate", str(migrated))
    assert same_contents(whole, migrated)
    assert verify(migrated).frames == 10


def test_two_recordings_in_one_file_are_not_mixed(whole: Path, tmp_path: Path) -> None:
    example_recording.write(tmp_path / "other.rrd", frames=4)
    both = tmp_path / "both.rrd"
    rerun("merge", str(whole), str(tmp_path / "other.rrd"), "-o", str(both))
    other_id = Recording.open(tmp_path / "other.rrd").meta.recording_id
    for refused in (Recording.open, verify, read_info, lambda path: repair(path, tmp_path / "mixed.rrd")):
        with pytest.raises(RecordingError, match=r"2 recordings.*--recording-id"):
            refused(both)
    with pytest.raises(RecordingError, match="holds no recording"):
        repair(both, tmp_path / "none.rrd", recording_id="none")
    repair(both, tmp_path / "one.rrd", recording_id=other_id)
    assert same_contents(tmp_path / "other.rrd", tmp_path / "one.rrd")


def test_a_recording_without_its_steps_is_refused(whole: Path, tmp_path: Path) -> None:
    rerun("filter", "--drop-timeline", "step", str(whole), "-o", str(tmp_path / "no-steps.rrd"))
    for refused in (Recording.open, verify, read_info, lambda path: repair(path, tmp_path / "none.rrd")):
        with pytest.raises(RecordingError, match="timeline"):
            refused(tmp_path / "no-steps.rrd")


def split(path: Path, timeline: str, folder: Path) -> list[Path]:
    """Split a recording into two parts, the first one first."""
    folder.mkdir()
    rerun("split", str(path), "--timeline", timeline, "--num-parts", "2", "--output-dir", str(folder))
    return sorted(folder.iterdir(), key=lambda part: int(part.stem.split("_")[1]))


def test_each_part_of_a_split_recording_has_its_frames_scene_and_settings(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "drive.rrd", scene="demo", config={}, fingerprint="", scene_glb=b"glTF") as writer:
        for step in range(6):
            seen = example_recording.observation(step)
            writer.write_frame(seen)
            writer.write_event(StampedEvent(step, seen.stamp, Note(f"at {step}")))
    original = Recording.open(tmp_path / "drive.rrd")
    parts = split(original.path, "step", tmp_path / "parts")
    frames = set[int]()
    for part in parts:
        verify(part)
        saved = repair(part, tmp_path / f"repaired-{part.name}")
        for recording in (Recording.open(part), Recording.open(tmp_path / f"repaired-{part.name}")):
            assert replace(recording.meta, recording_id=original.meta.recording_id) == original.meta
            assert recording.scene_glb() == b"glTF"
            assert len(recording.frames) == saved.frames
            frames |= set(recording.frames)
            for frame in recording.frames:
                assert recording.stored_frame(frame)[1:] == original.stored_frame(frame)[1:]
    assert frames == set(original.frames)


def test_a_part_without_the_first_events_says_that_its_map_is_elsewhere(whole: Path, tmp_path: Path) -> None:
    first, second = split(whole, "event", tmp_path / "parts")
    assert verify(first).events + verify(second).events == len(example_recording.events())
    assert Recording.open(first).final_graph().nodes
    assert "ltvn export" in str(verify(second).note)
    with pytest.raises(RecordingError, match="ltvn export"):
        Recording.open(second).final_graph()


@pytest.mark.parametrize("timeline", ["sim_time", "event", "log_time"])
def test_a_recording_without_any_other_timeline_reads_as_before(whole: Path, tmp_path: Path, timeline: str) -> None:
    rerun("filter", "--drop-timeline", timeline, str(whole), "-o", str(tmp_path / "less.rrd"))
    assert same_contents(whole, tmp_path / "less.rrd")
    repair(tmp_path / "less.rrd", tmp_path / "repaired.rrd")
    assert same_contents(whole, tmp_path / "repaired.rrd")


def test_what_is_whole_of_a_damaged_rewritten_recording_comes_back(whole: Path, tmp_path: Path) -> None:
    rewritten, damaged = tmp_path / "rewritten.rrd", tmp_path / "damaged.rrd"
    rerun(*TOOLS["small chunks"](whole, rewritten))
    data, messages_end = rewritten.read_bytes(), check_file(rewritten).whole_bytes
    flipped = bytearray(data)
    flipped[messages_end + 5_000] ^= 4
    places = {"table": bytes(flipped), "end": data[:messages_end], "tail": data[:-20]}
    for name, changed in places.items():
        damaged.write_bytes(changed)
        with pytest.raises(RecordingError, match="ltvn repair"):
            verify(damaged)
        saved = repair(damaged, tmp_path / f"{name}.rrd")
        assert (saved.frames, saved.events) == (10, len(example_recording.events())), name
    damaged.write_bytes(data[: messages_end * 9 // 10])
    repair(damaged, tmp_path / "cut.rrd")
    kept = Recording.open(tmp_path / "cut.rrd")
    assert all(kept.is_intact(frame) for frame in kept.frames)


@pytest.mark.parametrize("seed", range(5))
def test_columns_in_any_batches_and_rows_in_any_order_are_joined(whole: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    (events,) = [each for each in open_contents(whole, whole=True).batches_of(schema.EVENTS) if each.num_rows > 1][:1]
    needed = schema.COLUMNS[schema.EVENTS].keys()
    keys = [name for name in events.schema.names if name not in needed or name == schema.STEP]
    parts = []
    for name in sorted(needed - {schema.STEP}):
        rows = rng.permutation(events.num_rows)
        cut = int(rng.integers(events.num_rows + 1))
        parts += [events.select([*keys, name]).take(pa.array(part)) for part in (rows[:cut], rows[cut:]) if len(part)]
    (joined,) = joined_rows([parts[place] for place in rng.permutation(len(parts))], needed)
    assert sorted(map(str, _cells(joined, needed))) == sorted(map(str, _cells(events, needed)))


def _rows(table: pa.Table) -> dict[bytes, dict[str, object]]:
    """Return the rows of a table of chunks by chunk, without what depends on where chunks stand in a file."""
    names = [name for name in table.schema.names if not name.startswith("chunk_byte")]
    columns = {name: _plain(table.column(name)).to_pylist() for name in sorted(names)}
    rows = [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]
    return {row["chunk_id"]: row for row in rows}


def _plain(column: pa.ChunkedArray) -> pa.ChunkedArray:
    temporal = pa.types.is_temporal(column.type)
    return column.cast(pa.int64()) if temporal else column


def _cells(batch: pa.RecordBatch, names: Iterable[str]) -> list[tuple[object, ...]]:
    return list(zip(*(batch.column(name).to_pylist() for name in sorted(names)), strict=True))
