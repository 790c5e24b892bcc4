"""Does the wishes that make something of images: maps, recordings of drives, new weights.

The table of wishes names these functions; `Job` and `FineTuning` do the work. Run in the session's thread
only.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.recorded_map import build_recorded_map, save_recorded_map
from ltvn_core.navigation.events import Severity
from ltvn_core.terminal_text import count_text
from ltvn_core.training.fine_tuning_data import DriveSource
from ltvn_core.types import Observation
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.command_handlers import open_recording
from ltvn_viz.session.job import Phase, Progress
from ltvn_viz.session.recording_library import MadeRecording
from ltvn_viz.wishes.wish_table import LEAST_MINUTES, MOST_MINUTES


def build_map(state: AppState) -> None:
    """Build the map anew from its images, or a map from the open recording. Raises RecordingError and OptionError."""
    if isinstance(state.activity, Playback):
        build_from_replay(state, state.activity)
        return
    live_map = state.live_map
    before = _size(live_map.graph)

    def then() -> None:
        state.say(f"The map is rebuilt: {_change_of(before, live_map.graph)}. “Undo” brings the old map back.")

    state.activity = MapBuilding(state.live, state.worker, live_map.rebuild, then, findings=lambda: live_map.findings)


def undo_build(state: AppState) -> None:
    """Restore the map from before the rebuild."""
    live_map = state.live_map
    before = _size(live_map.graph)

    def show(deltas: Sequence[GraphDelta]) -> None:
        state.live.emit_changes(deltas)
        state.say(f"The old map is back: {_change_of(before, live_map.graph)}.")

    state.live.robot.stop()
    state.worker.submit(live_map.undo_rebuild, show)


def _size(graph: TopologicalGraph) -> tuple[int, int]:
    return len(graph.nodes), len(graph.edges)


def _change_of(before: tuple[int, int], graph: TopologicalGraph) -> str:
    (nodes, edges), (nodes_now, edges_now) = before, _size(graph)
    return f"{nodes:,} → {nodes_now:,} nodes, {edges:,} → {edges_now:,} edges"


def import_source(state: AppState, name: str) -> None:
    """Start to import a drive of the folder into a new recording; raises RecordingError and OptionError."""
    source = state.library.source(name)
    output = state.library.new_file(source.stem)

    def make(progress: Progress) -> MadeRecording:
        summary = import_drive(open_drive(source), output, progress=progress)
        dropped = sum(summary.dropped.values())
        return MadeRecording(
            output.name,
            f"Imported {name} as {output.name}: {count_text(summary.frames, 'image')}, {dropped:,} left out.",
            summary.findings,
        )

    _make(state, f"Importing {name}", make)


def build_from_replay(state: AppState, replay: Playback) -> None:
    """Start to build a map from the images of the open recording; raises RecordingError and OptionError."""
    source = state.library.path(replay.name)
    output = state.library.new_file(f"{Path(replay.name).stem}-map")
    options = replace(state.build_options, weights=state.fine_tuning.weights or state.build_options.weights)

    def make(progress: Progress) -> MadeRecording:
        built, choice, observations = build_recorded_map(source, options, progress)
        save_recorded_map(built, output, options)
        graph = built.graph
        pieces = len(strongly_connected_components(graph))
        assert built.coverage is not None
        return MadeRecording(
            output.name,
            f"Built {output.name} by {choice.name} from {count_text(len(observations), 'image')}: "
            f"{count_text(len(graph.nodes), 'node')}, {count_text(len(graph.edges), 'edge')}, "
            f"{count_text(pieces, 'piece')}. It knows {built.coverage.share:.0%} of the drive.",
            built.findings,
        )

    _make(state, f"Building a map from {replay.name}", make)


def _make(state: AppState, label: str, make: Callable[[Progress], MadeRecording]) -> None:
    """Make a recording; then open it and report doubtful findings, or report why it was not made."""

    def made() -> None:
        if (found := state.making.result) is None:
            was_cancelled = state.making.phase is Phase.CANCELLED
            state.say(
                f"{label} was cancelled; nothing was written." if was_cancelled else state.making.reason, Severity.ERROR
            )
            return
        text = found.text
        if isinstance(state.activity, Navigation | MapBuilding):
            text += " Open it under “Replay”."
        else:
            open_recording(state, found.name)
        state.say(" ".join([text, *map(str, found.findings)]), Severity.WARN if found.findings else Severity.INFO)

    state.making.begin(label, make, made)


MAP_IMAGES = "images-at-hand"
"""Name in the card of weights for a drive that is not a recording."""


def drive_name(state: AppState) -> str:
    """Return the drive to learn from: the open recording, else the last kept one, else the images of the map."""
    return _recording(state) or f"the {len(state.live_map.keyframes):,} images of the map"


def start_fine_tuning(state: AppState, minutes: float) -> None:
    """Start fine-tuning; raises OptionError and RecordingError."""
    state.fine_tuning.require_free()
    if not LEAST_MINUTES <= minutes <= MOST_MINUTES:
        raise OptionError(f"Learning takes {LEAST_MINUTES} to {MOST_MINUTES} minutes, not {minutes:g}.")
    name = _recording(state)
    output = state.library.new_weights(name or MAP_IMAGES, datetime.now())
    if name is not None:
        state.fine_tuning.begin(DriveSource(name, state.library.path(name)), output, minutes)
        return

    def begin(observations: Sequence[Observation]) -> None:
        try:
            state.fine_tuning.begin(DriveSource(MAP_IMAGES, observations), output, minutes)
        except OptionError as error:  # The button was pressed twice.
            state.say(str(error), Severity.WARN)

    state.worker.submit(state.live_map.observations, begin)


def use_weights(state: AppState) -> None:
    """Rebuild the map with the new weights and use them from now on; raises OptionError and RecordingError."""
    weights = state.fine_tuning.offer
    if state.live.recorder.is_on:
        raise RecordingError(
            "A recording contains the map of one set of weights. Keep this recording (N) or discard it, then use the "
            "new ones."
        )

    def rebuild(progress: Progress) -> Sequence[GraphDelta]:
        return state.live_map.rebuild_with(*state.predictor_for(weights), progress)

    def then() -> None:
        state.fine_tuning.adopt(weights)
        state.say(
            f"The map was rebuilt with the weights {state.live_map.fingerprint}. Start the app with --weights "
            f"{weights} to use them again later."
        )

    state.activity = MapBuilding(state.live, state.worker, rebuild, then, findings=lambda: state.live_map.findings)


def _recording(state: AppState) -> str | None:
    return state.activity.name if isinstance(state.activity, Playback) else state.last_recording
