"""Summary of a recording in a few numbers; for a damaged recording, the data that can be recovered."""

import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.data.recording.integrity import repair
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrd_contents import require_rrd
from ltvn_core.errors import RecordingError
from ltvn_core.graph.corrections import Correction, UnsurePlaces, from_config
from ltvn_core.navigation.events import Collided, Judged, QueryEnded


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """The summary of a recording."""

    recording: Path
    whole: bool
    """Whether the recording is finished, complete and unchanged; otherwise the numbers are those after `ltvn
    repair`."""
    scene: str
    started_at: str
    """Wall-clock time of the start, ISO 8601 in UTC."""
    duration_s: float
    """Time from the first frame to the last on the robot's clock, in seconds."""
    frames: int
    nodes: int
    """Number of nodes in the map at the end."""
    edges: int
    reserve: int
    """Number of images of the mapping drive that became no node."""
    queries: int
    """Number of queries that ended."""
    reached: int | None
    """Number of reached goals by the evaluation's criterion; None without an evaluation."""
    collisions: int
    corrections: tuple[Correction, ...]
    """What building the map corrected or added by itself; empty for other recordings, and older maps."""
    unsure: UnsurePlaces | None
    """Where the course of the mapped drive stayed unsure; None for other recordings, and older maps."""
    events: Mapping[str, int]
    """Number of events of each kind."""
    questions: Mapping[str, int]
    """How often a person asked each question of the debugger, by its word."""
    fingerprint: str
    schema: int
    versions: Mapping[str, str]
    size_bytes: int


def read_info(path: Path | str) -> RecordingInfo:
    """Summarise a recording, intact or damaged. Raises RecordingError if it is not ours or nothing is readable."""
    path = Path(path)
    require_rrd(path)
    try:
        return _summary(Recording.open(path), path, whole=True)
    except RecordingError:
        pass  # The summary then tells what can be recovered, or why nothing can.
    with tempfile.TemporaryDirectory(prefix="ltvn-") as folder:
        repaired = Path(folder) / "repaired.rrd"
        repair(path, repaired)
        return _summary(Recording.open(repaired), path, whole=False)


def _summary(recording: Recording, path: Path, *, whole: bool) -> RecordingInfo:
    events = [stamped.event for stamped in recording.events]
    stamps = recording.poses.stamps
    graph = recording.final_graph()
    meta = recording.meta
    verdicts = [event.reached for event in events if isinstance(event, Judged)]
    return RecordingInfo(
        recording=path,
        whole=whole,
        scene=meta.scene,
        started_at=meta.started_at,
        duration_s=float(stamps[-1] - stamps[0]) if len(stamps) else 0.0,
        frames=len(recording.frames),
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        reserve=len(graph.reserve),
        queries=sum(isinstance(event, QueryEnded) for event in events),
        reached=sum(verdicts) if verdicts else None,
        collisions=sum(isinstance(event, Collided) for event in events),
        corrections=from_config(meta.config),
        unsure=UnsurePlaces.recorded(meta.config),
        events=dict(sorted(Counter(type(event).__name__ for event in events).items())),
        questions=dict(sorted(Counter(recording.questions_asked()).items())),
        fingerprint=meta.fingerprint,
        schema=meta.schema,
        versions=meta.versions,
        size_bytes=path.stat().st_size,
    )
