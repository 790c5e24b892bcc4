"""Says whether a recording is whole, and gives back what is whole of a damaged one.

Owns `verify` and `repair`. Never changes the file it is given and never overwrites another.
"""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.atomic_files import atomic_output
from ltvn_core.errors import MapError, RecordingError
from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.recording import rrd_framing
from ltvn_core.recording.closing_record import ClosingRecord
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.rewriting import open_rewriter, rewrite_event
from ltvn_core.recording.rrd_contents import read_contents, require_rrd, require_whole
from ltvn_core.types import FrameId


@dataclass(frozen=True, slots=True)
class VerifiedRecording:
    """A recording that is whole."""

    recording: Path
    frames: int
    events: int
    size_bytes: int
    checksummed: bool
    """Every byte has a checksum. An older recording has them only for its frames and events."""


@dataclass(frozen=True, slots=True)
class RepairedRecording:
    """What was saved of a damaged recording."""

    recording: Path
    output: Path
    frames: int
    """Whole frames saved."""
    events: int
    """Events saved."""
    last_step: int | None
    """Step of the last frame saved."""
    damaged_frames: int
    """Frames left out because their checksum is wrong."""
    damaged_events: int
    """Events left out because their checksum is wrong or the images that they speak of are lost."""
    lost_bytes: int
    """Bytes after the cut, of which nothing could be saved."""


def verify(path: Path | str) -> VerifiedRecording:
    """Check that a recording is finished, of our making, and that every frame and event is as it was written.

    Raises RecordingError otherwise; a cut or unfinished file names `ltvn repair`.
    """
    path = Path(path)
    record = require_whole(path).record
    recording = Recording.open(path)
    if record is not None:
        _check_rows(recording, record)
    damaged = [frame for frame in recording.frames if not recording.stored_frame(frame).intact]
    if damaged:
        raise RecordingError(
            f"{path}: {len(damaged)} of {len(recording.frames)} frames changed since they were written, the first is "
            f"{damaged[0]}. Restore the file from a copy, or run `ltvn repair {path} --output NEW.rrd` to drop them."
        )
    _check_events(recording)
    return VerifiedRecording(
        recording=path,
        frames=len(recording.frames),
        events=len(recording.events),
        size_bytes=path.stat().st_size,
        checksummed=record is not None,
    )


def repair(path: Path | str, output: Path | str) -> RepairedRecording:
    """Write all whole frames and events of a damaged or unfinished recording to a new file `output`.

    Raises RecordingError when `output` exists, when `path` is not ours, or when nothing in it is whole.
    """
    path, output = Path(path), Path(output)
    require_rrd(path)
    found = rrd_framing.scan_rrd(path)
    with open_readable_part(path, found) as recording:
        frames = [frame for frame in recording.frames if recording.stored_frame(frame).intact]
        events = list(_consistent_events(recording, frames))
        with atomic_output(output) as part:
            _rewrite(recording, part, frames, events)
        return RepairedRecording(
            recording=path,
            output=output,
            frames=len(frames),
            events=len(events),
            last_step=frames[-1] if frames else None,
            damaged_frames=len(recording.frames) - len(frames),
            damaged_events=len(recording.stored_events) - len(events),
            lost_bytes=0 if found.finished else path.stat().st_size - found.whole_bytes,
        )


@contextmanager
def open_readable_part(path: Path, found: rrd_framing.RrdFraming) -> Iterator[Recording]:
    """Open the whole messages of a Rerun file, from a temporary copy when it is cut.

    Raises RecordingError when not even the description at its beginning is whole.
    """
    if found.finished:
        yield Recording(path, read_contents(path))
        return
    if found.messages == 0:
        raise RecordingError(f"{path} was cut before its first whole frame; nothing in it can be saved.")
    with tempfile.TemporaryDirectory(prefix="ltvn-") as folder:
        copy = Path(folder) / "whole.rrd"
        rrd_framing.copy_whole_messages(path, copy, found)
        yield Recording(path, read_contents(copy))


def _check_rows(recording: Recording, record: ClosingRecord) -> None:
    """Raise RecordingError when fewer rows can be read than were written."""
    for entity, written in record.rows.items():
        found = recording.row_count(entity)
        if found is not None and found != written:
            raise RecordingError(
                f"{recording.path}: {written} rows of {entity} were written and {found} are there. Restore the file "
                f"from a copy, or run `ltvn repair {recording.path} --output NEW.rrd` to get back what is there."
            )


def _check_events(recording: Recording) -> None:
    for place, stored in enumerate(recording.stored_events):
        if not stored.intact or stored.event.sequence != place:
            raise RecordingError(
                f"{recording.path}: event {place} is missing or changed since it was written. Restore the file from a "
                f"copy, or run `ltvn repair {recording.path} --output NEW.rrd` to leave it out."
            )
    recording.final_graph()  # Raises MapError when the deltas do not fit together.


def _consistent_events(recording: Recording, frames: Sequence[FrameId]) -> Iterator[StampedEvent]:
    """Yield the events that are intact and whose changes of the map fit what was saved."""
    graph, saved = TopologicalGraph(), frozenset(frames)
    lost = frozenset(recording.frames) - saved
    last = max(saved, default=None)
    for stored in recording.stored_events:
        if not stored.intact:
            continue
        stamped = stored.event.decoded()
        change = stamped.event
        if isinstance(change, GraphChanged):
            if isinstance(change.delta, NodeAdded) and _is_image_lost(change.delta.node.id, lost, saved, last):
                continue
            try:
                graph.apply(change.delta)
            except MapError:
                continue
        yield stamped


def _is_image_lost(node: FrameId, lost: frozenset[FrameId], saved: frozenset[FrameId], last: FrameId | None) -> bool:
    # A recording may have been made without images; then nothing of them can be lost.
    return node in lost or (last is not None and node > last and node not in saved)


def _rewrite(recording: Recording, output: Path, frames: Sequence[FrameId], events: Sequence[StampedEvent]) -> None:
    graph = TopologicalGraph()
    left = list(reversed(frames))
    with open_rewriter(recording, output, recording_id=recording.meta.recording_id) as writer:
        for stamped in events:
            while left and left[-1] <= stamped.step:
                writer.write_encoded_frame(recording.stored_frame(left.pop()).frame)
            rewrite_event(writer, stamped, graph)
        while left:
            writer.write_encoded_frame(recording.stored_frame(left.pop()).frame)
