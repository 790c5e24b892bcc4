"""Works out what a damaged recording has lost, from what it says it held and from what is left. Owns the wording."""

from collections.abc import Iterable, Sequence, Set
from typing import NamedTuple

from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.navigation.events import GraphChanged
from ltvn_core.recording import schema
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.salvage import Salvage
from ltvn_core.types import FrameId

_NAMED = 12
"""So many frames or places are named one by one."""


class Losses(NamedTuple):
    """What is left out of a repaired recording."""

    lines: Sequence[str]
    """For people, one thing each; without events, since some are left out only when the map is put together."""
    frames: Sequence[FrameId]
    """Frames that are known by name."""
    more_frames: int | None
    """How many beside them, None where nobody knows."""
    events_written: int
    lost_bytes: int
    only_behind: FrameId | None
    """In a recording that was only cut, the last frame: nothing before it is lost."""

    @property
    def frame_count(self) -> int:
        """How many frames are lost, as far as that is known."""
        return len(self.frames) + (self.more_frames or 0)

    def without_image(self, recording: Recording, saved: Sequence[FrameId]) -> Set[FrameId]:
        """Return the nodes whose image is lost. A recording may have been made without images, then none is."""
        nodes = set(_nodes(recording)) - set(saved)
        if not saved or (self.more_frames == 0 and not self.frames):
            return set()
        if self.more_frames == 0:
            return nodes & set(self.frames)
        if self.only_behind is not None:
            return {node for node in nodes if node > self.only_behind} | nodes & set(self.frames)
        return nodes


def find_losses(salvage: Salvage, saved: Sequence[FrameId]) -> Losses:
    """Compare what was salvaged, of which the frames `saved` are whole, with what the file held once."""
    recording, record = salvage.recording, salvage.record
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
        lost_bytes=salvage.lost_bytes,
        only_behind=max(saved, default=None) if only_cut else None,
    )


def _lines(salvage: Salvage, frames: Sequence[FrameId], more: int | None) -> Iterable[str]:
    recording, record = salvage.recording, salvage.record
    if not salvage.ended:
        yield "what was recorded last: the file was never finished, was cut, or has the ending of another"
    if frames:
        yield f"{len(frames)} frames: {_listed(frames)}"
    if more:
        yield f"{more} frames{' more' if frames else ''}, of which nothing is left"
    if not salvage.described:
        yield "the description (scene, settings, camera); the camera of the usual robot stands in for its own"
    if record is not None:
        if (originals := record.rows.get(schema.ORIGINAL, 0) - (recording.row_count(schema.ORIGINAL) or 0)) > 0:
            yield f"{originals} of the camera's own pictures"
        if record.static_rows.get(schema.SCENE) and recording.scene_glb() is None:
            yield "the drawn scene"
    if salvage.lost_places:
        places = [f"{position:,} to {position + size:,}" for position, size in salvage.lost_places]
        yield f"damaged bytes {_listed(places)}"


def _listed(things: Sequence[object]) -> str:
    named = ", ".join(map(str, things[:_NAMED]))
    return f"{named} and {len(things) - _NAMED} more" if len(things) > _NAMED else named


def _nodes(recording: Recording) -> Iterable[FrameId]:
    for stored in recording.stored_events:
        change = stored.event.decoded().event if stored.intact else None
        if isinstance(change, GraphChanged) and isinstance(change.delta, NodeAdded):
            yield change.delta.node.id
