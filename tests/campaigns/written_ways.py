"""The same short drive, written in each way in which the toolkit and Rerun's own tools write recordings."""

import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from ltvn_core.data.recording.excerpt import write_excerpt
from ltvn_core.data.recording.integrity import repair
from ltvn_core.data.recording.map_file import save_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.types import CONTROL_STEP_S, Observation
from ltvn_viz.session.recorder import Recorder
from ltvn_viz.session.recording_library import RecordingLibrary
from tests.core.data.recording import example_recording

FRAMES = 40
_LAST_S = CONTROL_STEP_S * FRAMES
_GLB = b"glTF" + bytes(range(256)) * 40


def _recorder(path: Path) -> None:
    example_recording.write(path, frames=FRAMES)


def _page(path: Path) -> None:
    """Record as the page does: the map first, then the scene, then images and events as they come."""
    library = RecordingLibrary(path.parent / "library")
    recorder = Recorder(library, _open_writer, take_map=_map, scene_glb=lambda: _GLB)
    recorder.start()
    for step in range(FRAMES):
        recorder.write_frame(example_recording.observation(step))
        recorder.tick(map_is_still=True)
    for event in example_recording.events():
        if not isinstance(event, GraphChanged):
            recorder.write_event(StampedEvent(FRAMES - 1, _LAST_S, event))
    written = recorder.close()
    assert written is not None
    written.rename(path)


def _open_writer(path: Path) -> RecordingWriter:
    return RecordingWriter(path, scene="demo", config={}, fingerprint="abc", patience_s=0)


def _map() -> tuple[TopologicalGraph, list[Observation]]:
    events = example_recording.events()
    graph = TopologicalGraph(event.delta for event in events if isinstance(event, GraphChanged))
    return graph, [example_recording.observation(frame) for frame in graph.frames]


def _map_file(path: Path) -> None:
    graph, seen = _map()
    save_map(path, graph, seen, scene="demo", fingerprint="abc", config={}, scene_glb=_GLB)


def _excerpt(path: Path) -> None:
    """Cut a moment out, as `ltvn export` and the page do."""
    write_excerpt(Recording.open(_source(path)), path, from_s=0.0, to_s=_LAST_S)


def _repaired(path: Path) -> None:
    repair(_source(path), path)


def _optimized(path: Path) -> None:
    _rerun("optimize", str(_source(path)), "-o", str(path))


def _merged(path: Path) -> None:
    _rerun("merge", str(_source(path)), "-o", str(path))


def _source(path: Path) -> Path:
    source = path.with_name(f"{path.stem}-source.rrd")
    _recorder(source)
    return source


def _rerun(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "rerun_cli", "rrd", *words], capture_output=True, check=True, timeout=120)


WAYS: dict[str, Callable[[Path], None]] = {
    "recorder": _recorder,
    "page": _page,
    "map": _map_file,
    "excerpt": _excerpt,
    "repaired": _repaired,
    **({"rerun optimize": _optimized, "rerun merge": _merged} if find_spec("rerun_cli") else {}),
}
"""Name -> what writes a new file."""
