"""Copies a time span of a recording to a separate small recording.

Owns the selection of the data for a time span: the map at its start, the images, and the running query. Does not change
the original recording.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

import pyarrow as pa

from ltvn_core.atomic_files import atomic_output
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rewriting import open_rewriter, rewrite_event
from ltvn_core.errors import RecordingError
from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import (
    ActionBegun,
    ActionEnded,
    AttemptEnded,
    AttemptStarted,
    Collided,
    GraphChanged,
    Judged,
    Localised,
    Note,
    Planned,
    QueryEnded,
    QueryStarted,
    StampedEvent,
    StateChanged,
    WorldChanged,
)
from ltvn_core.types import FrameId
from ltvn_core.worlds import subject


@dataclass(frozen=True, slots=True)
class Excerpt:
    """A time span that was copied."""

    recording: Path
    """Path of the original recording."""
    output: Path
    from_s: float
    """Start of the time span on the robot's clock, in seconds."""
    to_s: float
    frames: int
    events: int
    """Number of events of the time span, without those that build the map at its start."""
    size_bytes: int


@dataclass(frozen=True, slots=True)
class EventWindow:
    """The events of a time span, and the state before it."""

    graph_before: TopologicalGraph
    """The map at the start of the time span."""
    world_before: tuple[WorldChanged, ...]
    """The last change of each thing in the world before the start."""
    ongoing: tuple[StampedEvent, ...]
    """Events of the query and the attempt that were running at the start: their beginnings, and the last fix and
    plan."""
    events: tuple[StampedEvent, ...]
    """Events in the order in which they were written."""


def event_window(events: Sequence[StampedEvent], from_s: float, to_s: float) -> EventWindow:
    """Return the events from the first at or after `from_s` to the last at or before `to_s`, in linear time.

    Events out of order keep their position, so that the map at the end of the time span is that of the recording.
    """
    inside = [place for place, stamped in enumerate(events) if from_s <= stamped.stamp <= to_s]
    first = inside[0] if inside else sum(stamped.stamp < from_s for stamped in events)
    last = inside[-1] + 1 if inside else first
    changes = (stamped.event for stamped in events[:first])
    graph = TopologicalGraph(change.delta for change in changes if isinstance(change, GraphChanged))
    return EventWindow(
        graph_before=graph,
        world_before=_world_at_end(events[:first]),
        ongoing=_ongoing_at_start(events[:first]),
        events=tuple(events[first:last]),
    )


def time_span(recording: Recording) -> tuple[float, float]:
    """Return the first and the last time of a recording, in seconds on the robot's clock. Raises RecordingError."""
    stamps = [*recording.poses.stamps.tolist(), *(stamped.stamp for stamped in recording.events)]
    if not stamps:
        raise RecordingError(f"{recording.path} has no frames and no events, so no excerpt can be written.")
    return min(stamps), max(stamps)


def write_excerpt(
    recording: Recording, output: Path | str, *, from_s: float, to_s: float, named_only: bool = False
) -> Excerpt:
    """Write the time from `from_s` to `to_s` (robot clock) of a recording to a new file that is complete in itself.

    It holds the map at the start with the images of its nodes and its reserve. With `named_only`, it holds only the
    images that events of the time span refer to, which is much smaller, but cannot be used for navigation. Raises
    RecordingError if the file exists, or if nothing happened in that time.
    """
    output = Path(output)
    _check_times(recording, from_s, to_s)
    found = event_window(recording.events, from_s, to_s)
    frames = _frames(recording, found, from_s, to_s, named_only=named_only)
    with atomic_output(output) as part:
        _write(recording, part, found, frames, (from_s, to_s))
    return Excerpt(
        recording.path, output, from_s, to_s, len(frames), len(found.ongoing + found.events), output.stat().st_size
    )


def _world_at_end(events: Sequence[StampedEvent]) -> tuple[WorldChanged, ...]:
    """Return the last change of each thing in a world."""
    changes = (stamped.event for stamped in events if isinstance(stamped.event, WorldChanged))
    return tuple({subject(event.change): event for event in changes}.values())


def _ongoing_at_start(events: Sequence[StampedEvent]) -> tuple[StampedEvent, ...]:
    """Return the earlier events of a query that is still running, oldest first."""
    kept: dict[type, StampedEvent] = {}
    for stamped in events:
        event = stamped.event
        if isinstance(event, QueryStarted):
            kept = {QueryStarted: stamped}
        elif isinstance(event, QueryEnded):
            kept = {}
        elif isinstance(event, AttemptEnded):
            kept.pop(AttemptStarted, None)
        elif kept and isinstance(event, Localised | Planned | AttemptStarted):
            kept[type(event)] = stamped
    return tuple(sorted(kept.values(), key=events.index))


def _check_times(recording: Recording, from_s: float, to_s: float) -> None:
    begin, end = time_span(recording)
    whole = f"the recording runs from {begin:.1f} s to {end:.1f} s"
    if not (math.isfinite(from_s) and math.isfinite(to_s) and from_s <= to_s):
        raise RecordingError(f"An excerpt runs from an earlier to a later time, not {from_s} to {to_s} s; {whole}.")
    stamps = (*recording.poses.stamps.tolist(), *(stamped.stamp for stamped in recording.events))
    if not any(from_s <= stamp <= to_s for stamp in stamps):
        raise RecordingError(f"{recording.path}: nothing happened between {from_s} and {to_s} s; {whole}.")


def _frames(
    recording: Recording, found: EventWindow, from_s: float, to_s: float, *, named_only: bool
) -> tuple[FrameId, ...]:
    """Return the frames that the time span needs and the recording holds, in order."""
    stamps = zip(recording.frames, recording.poses.stamps.tolist(), strict=True)
    wanted = {frame for frame, stamp in stamps if from_s <= stamp <= to_s}
    wanted.update(*(_named(stamped) for stamped in found.ongoing + found.events))
    if not named_only:
        wanted |= set(found.graph_before.frames)
    return tuple(frame for frame in recording.frames if frame in wanted)


def _named(stamped: StampedEvent) -> Iterator[FrameId]:
    """Yield the frames that an event refers to."""
    match stamped.event:
        case QueryStarted(goal=goal):
            yield goal
        case Localised(frame=frame, node=node, runner_up=runner_up):
            yield from (each for each in (frame, node, runner_up) if each is not None)
        case Planned(nodes=nodes):
            yield from nodes
        case (
            AttemptStarted(source=source, target=target, frame=frame)
            | AttemptEnded(source=source, target=target, frame=frame)
            | ActionBegun(source=source, target=target, frame=frame)
            | ActionEnded(source=source, target=target, frame=frame)
        ):
            yield from (each for each in (source, target, frame) if each is not None)
        case GraphChanged(delta=NodeAdded(node=node)):
            yield node.id
        case StateChanged() | Collided() | GraphChanged() | WorldChanged() | QueryEnded() | Judged() | Note():
            return


def _write(
    recording: Recording, output: Path, found: EventWindow, frames: Sequence[FrameId], times: tuple[float, float]
) -> None:
    meta = recording.meta
    graph = found.graph_before.copy()
    origin = {"recording": recording.path.name, "id": meta.recording_id, "from_s": times[0], "to_s": times[1]}
    everything = found.ongoing + found.events
    config = {**meta.config, "excerpt": origin}
    with open_rewriter(recording, output, recording_id=str(uuid4()), config=config) as writer:
        for frame in frames:
            writer.write_encoded_frame(recording.stored_frame(frame).frame)
        begin = _start_note(recording, everything, times[0])
        for delta in graph.deltas():
            writer.write_event(begin._replace(event=GraphChanged(delta)))
        for changed in found.world_before:
            writer.write_event(begin._replace(event=changed))
        writer.write_event(begin)
        writer.draw_graph(graph, begin.step, begin.stamp)
        for stamped in everything:
            rewrite_event(writer, stamped, graph)
        for batch in recording.user_rows():
            writer.copy_user_rows(_between(batch, *times))


def _between(batch: pa.RecordBatch, from_s: float, to_s: float) -> pa.RecordBatch:
    """Return the rows of a time span, and rows without a time."""
    if schema.SIM_TIME not in batch.schema.names:
        return batch
    stamps = batch.column(schema.SIM_TIME).cast(pa.int64()).to_numpy(zero_copy_only=False) / 1e9
    return batch.filter(pa.array((stamps >= from_s) & (stamps <= to_s)))


def _start_note(recording: Recording, events: Sequence[StampedEvent], from_s: float) -> StampedEvent:
    """Return a note at the time from which on the map is that of the recording."""
    text = f"cut out of {recording.path.name} at {from_s:.1f} s"
    if events:
        first = min(events, key=lambda stamped: stamped.step)
        return StampedEvent(first.step, min(first.stamp, from_s), Note(text))
    after = recording.poses.stamps.searchsorted(from_s)
    return StampedEvent(int(recording.poses.steps[after]), float(recording.poses.stamps[after]), Note(text))
