"""What new recordings are made of: a drive in another format is imported, a map is built from an open recording.

Runs in the session's thread; the work itself is done in the maker's. No simulator and no robot is needed.
"""

from dataclasses import replace
from pathlib import Path

from ltvn_core.graph.connectivity import count_strongly_connected_components
from ltvn_core.importing.drive_import import import_drive
from ltvn_core.importing.reader_registry import open_drive
from ltvn_core.recorded_map import build_recorded_map, save_recorded_map
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.recording_maker import MadeRecording, Progress


def import_source(state: AppState, name: str) -> None:
    """Begin to import a drive of the folder into a new recording; raises RecordingError and OptionError."""
    source = state.library.source(name)
    output = state.library.new_file(source.stem)

    def make(progress: Progress) -> MadeRecording:
        summary = import_drive(open_drive(source), output, progress=progress)
        dropped = sum(summary.dropped.values())
        return MadeRecording(
            output.name,
            f"Imported {name} as {output.name}: {summary.frames:,} images, {dropped:,} left out.",
            summary.findings,
        )

    state.maker.begin(f"Importing {name}", make)


def build_from_replay(state: AppState, replay: Playback) -> None:
    """Begin to build a map from the images of the open recording; raises RecordingError and OptionError."""
    source = state.library.path(replay.name)
    output = state.library.new_file(f"{Path(replay.name).stem}-map")
    options = replace(state.build_options, weights=state.fine_tuning.weights or state.build_options.weights)

    def make(progress: Progress) -> MadeRecording:
        built, choice, observations = build_recorded_map(source, options, progress)
        save_recorded_map(built, output, options)
        graph = built.graph
        pieces = count_strongly_connected_components(graph)
        assert built.coverage is not None
        return MadeRecording(
            output.name,
            f"Built {output.name} by {choice.name} from {len(observations):,} images: {len(graph.nodes):,} nodes, "
            f"{len(graph.edges):,} edges, {pieces:,} {'piece' if pieces == 1 else 'pieces'}. It knows "
            f"{built.coverage.share:.0%} of the drive.",
            built.findings,
        )

    state.maker.begin(f"Building a map from {replay.name}", make)
