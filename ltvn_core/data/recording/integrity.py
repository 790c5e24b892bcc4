"""Verifies recordings, repairs damaged ones, and reports what was lost.

Owns `verify` and `repair`, and the report of losses, which compares the file's closing record with the recovered data.
Never changes its input and never overwrites another file.
"""

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ltvn_core.atomic_files import atomic_output
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.reader import WITHOUT_FIRST_EVENTS, Recording
from ltvn_core.data.recording.rewriting import rewrite
from ltvn_core.data.recording.rrd_contents import open_contents, require_file
from ltvn_core.data.recording.rrf2.closing_record import ClosingRecord
from ltvn_core.data.recording.salvage import Salvage, open_salvage
from ltvn_core.errors import MapError, RecordingError
from ltvn_core.garbage_collection import garbage_collection_paused
from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.types import FrameId

_NAMED = 12
"""Largest number of frames or places that are listed individually."""
_NO_RECORD = (
    "rewritten by Rerun, or older than checksums: frames and events have their own checksums and are correct; the "
    "file has no table of checksums"
)


class Losses(NamedTuple):
    """Data left out of a repaired recording."""

    lines: Sequence[str]
    """Messages for the user, one loss each; without events, because some are left out only when the map is rebuilt."""
    frames: Sequence[FrameId]
    """Known ids of lost frames."""
    more_frames: int | None
    """Number of further lost frames whose ids are unknown; None if the number is unknown."""
    events_written: int
    only_behind: FrameId | None
    """Last frame of a recording that was only cut off, so no earlier frame is lost; None otherwise."""

    @property
    def frame_count(self) -> int:
        """Number of frames that are known to be lost."""
        return len(self.frames) + (self.more_frames or 0)

    def without_image(self, recording: Recording, saved: Sequence[FrameId]) -> Set[FrameId]:
        """Return the nodes whose image is lost. In a recording that was made without images, none is lost."""
        nodes = set(_nodes(recording)) - set(saved)
        if not saved or (self.more_frames == 0 and not self.frames):
            return set()
        if self.more_frames == 0:
            return nodes & set(self.frames)
        if self.only_behind is not None:
            return {node for node in nodes if node > self.only_behind} | nodes & set(self.frames)
        return nodes


def find_losses(salvage: Salvage, saved: Sequence[FrameId]) -> Losses:
    """Compare the salvaged data, whose complete frames are `saved`, with the original content of the file."""
    recording = salvage.recording
    record = salvage.record
    known = sorted({*recording.half_frames, *recording.frames} - set(saved))
    events = len(recording.stored_events)
    more: int | None = None
    if record is not None and record.rows:
        more = max(0, record.rows.get(schema.RGB, 0) - len(saved) - len(known))
        events = max(events, record.rows.get(schema.EVENTS, 0))
    elif salvage.ended and not salvage.lost_places:
        more = 0
    highest = max((stored.event.sequence + 1 for stored in recording.stored_events), default=0)
    only_cut = not salvage.ended and not salvage.lost_places
    return Losses(
        lines=tuple(_lines(salvage, known, more)),
        frames=known,
        more_frames=more,
        events_written=max(events, highest),
        only_behind=max(saved, default=None) if only_cut else None,
    )


def _lines(salvage: Salvage, frames: Sequence[FrameId], more: int | None) -> Iterable[str]:
    recording = salvage.recording
    record = salvage.record
    if not salvage.ended:
        yield "the last part: the file was never finished, was cut off, or has the end of another file"
    if frames:
        yield f"{len(frames)} frames: {_listed(frames)}"
    if more:
        yield f"{more} frames{' more' if frames else ''}, which are lost completely"
    if first := _first_event(recording):
        yield f"the first {first} events, without which later changes of the map do not fit"
    if not salvage.described:
        yield "the description (scene, settings, camera); the default robot's camera is used instead of its own"
    if record is not None:
        if (originals := record.rows.get(schema.ORIGINAL, 0) - (recording.row_count(schema.ORIGINAL) or 0)) > 0:
            yield f"{originals} of the camera's original images"
        if record.static_rows.get(schema.SCENE) and recording.scene_glb() is None:
            yield "the drawn scene"
    if salvage.lost_places:
        places = [f"{position:,} to {position + size:,}" for position, size in salvage.lost_places]
        yield f"damaged bytes {_listed(places)}"


def _first_event(recording: Recording) -> int:
    """Return the number of the first event, which is 0 unless the first events are missing."""
    return next((stored.event.sequence for stored in recording.stored_events), 0)


def _listed(things: Sequence[object]) -> str:
    named = ", ".join(map(str, things[:_NAMED]))
    return f"{named} and {len(things) - _NAMED} more" if len(things) > _NAMED else named


def _nodes(recording: Recording) -> Iterable[FrameId]:
    for stored in recording.stored_events:
        change = stored.event.decoded().event if stored.intact else None
        if isinstance(change, GraphChanged) and isinstance(change.delta, NodeAdded):
            yield change.delta.node.id


@dataclass(frozen=True, slots=True)
class VerifiedRecording:
    """Result for an undamaged recording."""

    recording: Path
    frames: int
    events: int
    size_bytes: int
    checksummed: bool
    """Whether every byte has a checksum; older recordings have checksums only for frames and events."""
    note: str | None = None
    """Note about missing parts of the file that do not affect the data; None if there are none."""


@dataclass(frozen=True, slots=True)
class RepairedRecording:
    """Result of a repair."""

    recording: Path
    output: Path
    frames: int
    """Number of intact frames that were saved."""
    events: int
    """Number of events that were saved."""
    last_step: int | None
    """Step of the last saved frame; None if there is none."""
    damaged_frames: int
    """Number of frames known to be left out because a part of them is missing or changed."""
    damaged_events: int
    """Number of events left out because they are missing or changed, or because they refer to lost images."""
    lost_bytes: int
    """Number of bytes that were lost."""
    left_out: tuple[str, ...]
    """Descriptions of the data missing in the output."""


@garbage_collection_paused()
def verify(path: Path | str) -> VerifiedRecording:
    """Check that a recording is finished and was written by this program, and that every frame and event is unchanged.

    Raises RecordingError otherwise; for a cut, unfinished or damaged file its message names `ltvn repair`.
    """
    path = Path(path)
    contents = open_contents(path)
    recording = Recording(path, contents)
    if contents.record is not None:
        _check_rows(recording, contents.record)
    if recording.half_frames:
        raise _changed(path, f"of frame {recording.half_frames[0]} only the colours or only the depth is there")
    damaged = [frame for frame in recording.frames if not recording.is_intact(frame)]
    if damaged:
        changed = f"{len(damaged)} of {len(recording.frames)} frames changed since they were written, the first is"
        raise _changed(path, f"{changed} {damaged[0]}")
    # `rerun rrd split` leaves the first events in another file.
    first = _first_event(recording) if contents.record is None else 0
    _check_events(recording, first)
    return VerifiedRecording(
        recording=path,
        frames=len(recording.frames),
        events=len(recording.stored_events),
        size_bytes=path.stat().st_size,
        checksummed=contents.record is not None,
        note=None if contents.record is not None else _NO_RECORD if first == 0 else WITHOUT_FIRST_EVENTS.format(first),
    )


def repair(path: Path | str, output: Path | str, *, recording_id: str | None = None) -> RepairedRecording:
    """Write all intact frames and events of a damaged or unfinished recording to a new file `output`.

    Damaged data are left out and reported. Raises RecordingError if `output` exists, if `path` is not a recording of
    this program, or if no frame and no event is intact although it is damaged or holds parts of frames. A file with
    several recordings needs a `recording_id`.
    """
    path = Path(path)
    output = Path(output)
    require_file(path)
    salvage = open_salvage(path, recording_id)
    recording = salvage.recording
    frames = [frame for frame in recording.frames if recording.is_intact(frame)]
    losses = find_losses(salvage, frames)
    events = list(_consistent_events(recording, losses.without_image(recording, frames)))
    if not frames and not events and (first := _first_event(recording)):
        raise RecordingError(f"{path}: {WITHOUT_FIRST_EVENTS.format(first)}")
    # A recording that was cut off before its first frame contains only the description and the scene.
    if not frames and not events and (salvage.ended or salvage.lost_bytes or losses.frame_count):
        parts = f" It ends before the first of {losses.frame_count} frames is complete." if losses.frame_count else ""
        raise RecordingError(
            f"{path} has no undamaged frame and no undamaged event; nothing can be recovered.{parts} Copy the whole "
            "file again from where it was recorded, or record the drive again."
        )
    with atomic_output(output) as part:
        rewrite(recording, part, frames, events)
    damaged_events = losses.events_written - len(events)
    return RepairedRecording(
        recording=path,
        output=output,
        frames=len(frames),
        events=len(events),
        last_step=frames[-1] if frames else None,
        damaged_frames=losses.frame_count,
        damaged_events=damaged_events,
        lost_bytes=salvage.lost_bytes,
        left_out=(*losses.lines, *([f"{damaged_events} events"] if damaged_events else [])),
    )


def _check_rows(recording: Recording, record: ClosingRecord) -> None:
    """Raise RecordingError if the file has fewer readable rows than were written, or its index names fewer.

    That each row is the one that an index promises is checked when it is read.
    """
    for entity, written in record.rows.items():
        found = recording.row_count(entity)
        if found is not None and found != written:
            raise _changed(recording.path, f"{written} rows of {entity} were written and {found} are there")
    if record.static_rows.get(schema.SCENE) and recording.scene_glb() is None:
        raise _changed(recording.path, "the drawn scene is not there")


def _check_events(recording: Recording, first: int) -> None:
    for place, stored in enumerate(recording.stored_events, first):
        if not stored.intact or stored.event.sequence != place:
            raise _changed(recording.path, f"event {place} is missing or changed since it was written")
    if first == 0:
        recording.final_graph()  # Raises MapError when the deltas do not fit together.


def _changed(path: Path, what: str) -> RecordingError:
    return RecordingError(
        f"{path}: {what}. Restore the file from a copy, or run `ltvn repair {path} --output NEW.rrd` to recover the "
        "undamaged part."
    )


def _consistent_events(recording: Recording, without_image: Set[FrameId]) -> Iterator[StampedEvent]:
    """Yield the intact events whose map changes are consistent with the salvaged data."""
    graph = TopologicalGraph()
    for stored in recording.stored_events:
        if not stored.intact:
            continue
        stamped = stored.event.decoded()
        change = stamped.event
        if isinstance(change, GraphChanged):
            if isinstance(change.delta, NodeAdded) and change.delta.node.id in without_image:
                continue
            try:
                graph.apply(change.delta)
            except MapError:
                continue
        yield stamped
