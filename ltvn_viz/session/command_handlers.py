"""Runs the commands of the page.

Owns the meaning of each command, and the content of new recordings; the maker writes them in a separate thread.
`wishes` decides which commands are legal now. Runs in the session's thread only.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, assert_never

from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.errors import LtvnError, OptionError, RecordingError
from ltvn_core.graph.connectivity import count_strongly_connected_components
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.recorded_map import build_recorded_map, save_recorded_map
from ltvn_core.navigation.events import GraphChanged, Severity
from ltvn_core.terminal_text import count_text
from ltvn_core.training.fine_tuning_data import DriveSource
from ltvn_core.types import NodeId, Observation
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.floor_plan_clicks import FloorPlanClicks
from ltvn_viz.session.goal_handlers import choose_goal, find_and_go, find_place, navigate, pick
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.recording_maker import MadeRecording, Progress
from ltvn_viz.session.seeking import play_or_hold, seek, seek_by, seek_mark, set_speed, show_now
from ltvn_viz.session.snapshot import JobProgress
from ltvn_viz.session.world_handlers import begin_story, change_map, world_of
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import LEAST_MINUTES, MOST_MINUTES, Mode
from ltvn_viz.wishes.wish_table import refusal

_STALE_LINK = "That answer was replaced before your click arrived. Click in the new answer."


def handle(state: AppState, command: c.Command) -> None:
    """Run a command, or show the reason why it cannot be run."""
    if (why_not := refusal(command, state.activity.mode)) is not None:
        state.say(why_not, Severity.WARN)
        return
    try:
        _carry_out(state, command)
    except OptionError as error:
        state.say(str(error), Severity.WARN)  # The request is at fault; the app itself is well.
    except LtvnError as error:
        state.say(str(error), Severity.ERROR)


def _carry_out(state: AppState, command: c.Command) -> None:
    match command:
        case c.Ask(action, value):
            if action in _ALONE:
                _ALONE[action](state)
            elif action in _WITH_VALUE:
                _WITH_VALUE[action](state, value)
        case c.PointAt(node, target):
            state.debugger.point_at(node, target)
        case c.AskQuestion(request):
            _ask(state, state.debugger.handle_request(request))
        case c.AskAbout(question, edge, request, at_s):
            if at_s is not None:
                handle(state, c.Seek(at_s))
            _choose_question(state, question)
            if edge is not None:
                state.debugger.point_at(*edge)
            if request is not None:
                _ask(state, state.debugger.handle_request(request))
        case c.EditMap(deltas):
            change_map(state, deltas)
        case c.OpenRecording():
            _open(state, command)
        case c.Seek(time_s):
            seek(state, time_s)
        case c.NavigateToImage(rgb, original):
            if isinstance(state.activity, Playback):
                find_place(state, state.activity, rgb if original is None else original)
            else:
                find_and_go(state, rgb, original)
        case c.ReportError(text):
            # The user's file is at fault; the app itself continues.
            state.say(text, Severity.WARN, title="Problem")
        case _:
            assert_never(command)


def _pick_edge(state: AppState, ends: tuple[NodeId, NodeId]) -> None:
    if not state.debugger.is_on:
        _choose_question(state, QuestionName.EDGE)
    state.debugger.point_at(*ends)


def _alignment(state: AppState) -> FloorPlanClicks:
    """Return the alignment of the floor plan. Raises OptionError without a plan."""
    if state.alignment is None:
        raise OptionError("There is no floor plan. Start the page with --floor-plan map.yaml to see one.")
    return state.alignment


def _use_alignment(state: AppState) -> None:
    _alignment(state).use()
    state.say("The floor plan is aligned. “World” shows the option that gives the same alignment next time.")


def _choose_floor(state: AppState, floor: int | None) -> None:
    state.floor.chosen = floor


def _close(state: AppState) -> None:
    state.activity = state.teleop


def _cancel(state: AppState) -> None:
    if not isinstance(state.activity, Navigation | MapBuilding):
        state.maker.cancel()
        if state.alignment is not None and state.alignment.is_on:
            state.alignment.toggle()
    state.cancel("Cancelled", "it was cancelled")


def _build_map(state: AppState) -> None:
    if isinstance(state.activity, Playback):
        build_from_replay(state, state.activity)
        return
    live_map = state.live_map
    before = _size(live_map.graph)

    def then() -> None:
        state.say(f"The map is rebuilt: {_change_of(before, live_map.graph)}. “Undo” brings the old map back.")

    state.activity = MapBuilding(state.live, state.worker, live_map.rebuild, then, findings=lambda: live_map.findings)


def _undo_build(state: AppState) -> None:
    live_map = state.live_map
    before = _size(live_map.graph)

    def show(deltas: Sequence[GraphDelta]) -> None:
        for delta in deltas:
            state.live.emit(GraphChanged(delta))
        state.say(f"The old map is back: {_change_of(before, live_map.graph)}.")

    state.live.robot.stop()
    state.worker.submit(live_map.undo_rebuild, show)


def _size(graph: TopologicalGraph) -> tuple[int, int]:
    return len(graph.nodes), len(graph.edges)


def _change_of(before: tuple[int, int], graph: TopologicalGraph) -> str:
    (nodes, edges), (nodes_now, edges_now) = before, _size(graph)
    return f"{nodes:,} → {nodes_now:,} nodes, {edges:,} → {edges_now:,} edges"


def take_made_recording(state: AppState) -> None:
    """Open a new recording and report doubtful findings, or report why it was not made."""
    match state.maker.collect():
        case None:
            pass
        case str(reason):
            state.say(reason, Severity.ERROR)
        case MadeRecording(name, text, findings):
            if isinstance(state.activity, Navigation | MapBuilding):
                text += " Open it under “Replay”."
            else:
                _open(state, c.OpenRecording(name))
            state.say(" ".join([text, *map(str, findings)]), Severity.WARN if findings else Severity.INFO)


def _keep_going(state: AppState, switch: int) -> None:
    if switch and not state.live.robot.clock.is_simulated:
        raise OptionError(
            "Only a simulated robot may drive on with no page open; a real one needs a person who watches it."
        )
    state.keeps_going = bool(switch)


def _play_drive(state: AppState) -> None:
    if state.played is None:
        raise OptionError("There is no recorded drive in the robot's place to play again.")
    state.played.play()


def _stop(state: AppState) -> None:
    if state.open_loop:
        state.say(state.open_loop, Severity.WARN)
    _end_steps(state, "Stopped", "the robot was stopped")


def _end_steps(state: AppState, how: str, why: str) -> None:
    if ended := state.end_steps(why):
        state.say(f"{how}; {ended} was cancelled.")


def _pause(state: AppState) -> None:
    match state.activity:
        case Playback() as replay:
            replay.play(playing=not replay.playing)
        case Navigation() as navigation:
            navigation.resume() if navigation.mode is Mode.PAUSED else navigation.pause()
        case _:
            pass  # It is legal only in another mode; `refusal` has checked this.


def _step(state: AppState) -> None:
    if isinstance(state.activity, Navigation):
        state.activity.step()


def _choose_question(state: AppState, name: str) -> None:
    """Show a question and count it in the recording; an unknown name asks nothing."""
    word, known = next((each for each in state.debugger.words.items() if each[1] == name), ("", QuestionName.FIRST))
    state.debugger.choose(known)
    if word:
        state.live.recorder.write_question(word)


def _ask(state: AppState, asked: c.Command | None) -> None:
    if asked is not None:
        handle(state, asked)


def _record(state: AppState) -> None:
    state.live.begin_recording()
    if state.world is not None:
        state.world.record()


def _keep(state: AppState) -> None:
    def kept(path: Path) -> None:
        state.last_recording = path.name
        state.say(f"Kept as {state.last_recording}. Open it under “Replay”.")

    state.live.recorder.keep(kept)


def _discard(state: AppState) -> None:
    state.live.recorder.discard(
        lambda place: state.say(f"The recording was set aside as {place}; delete it there if you like.")
    )


def _open(state: AppState, asked: c.OpenRecording) -> None:
    def show(replay: Playback) -> None:
        state.work = None
        if isinstance(state.activity, Navigation | MapBuilding):
            state.say(f"{asked.name} was not opened, because a query began meanwhile. Open it when that is over.")
            return
        replay.breakpoint_monitor = state.live.breakpoint_monitor
        replay.seek(asked.at_s)
        state.activity = replay
        for each in asked.then:
            handle(state, each)

    state.live.robot.stop()
    state.work = JobProgress(f"Opening {asked.name}")
    state.worker.submit(lambda: state.open_replay(asked.name), show)


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

    state.maker.begin(f"Importing {name}", make)


def build_from_replay(state: AppState, replay: Playback) -> None:
    """Start to build a map from the images of the open recording; raises RecordingError and OptionError."""
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
            f"Built {output.name} by {choice.name} from {count_text(len(observations), 'image')}: "
            f"{count_text(len(graph.nodes), 'node')}, {count_text(len(graph.edges), 'edge')}, "
            f"{count_text(pieces, 'piece')}. It knows {built.coverage.share:.0%} of the drive.",
            built.findings,
        )

    state.maker.begin(f"Building a map from {replay.name}", make)


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

    def rebuild(progress: Callable[[int, int], None]) -> Sequence[GraphDelta]:
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


SEEK_S = 1.0
"""Time in seconds by which a key moves the moment on show."""
_ALONE: Mapping[c.Action, Callable[[AppState], None]] = {
    c.Action.STOP: _stop,
    c.Action.TAKE_OVER: lambda state: _end_steps(state, "You took over", "somebody took over the robot"),
    c.Action.RECORD: _record,
    c.Action.KEEP: _keep,
    c.Action.DISCARD: _discard,
    c.Action.BUILD: _build_map,
    c.Action.UNDO_BUILD: _undo_build,
    c.Action.STOP_LEARNING: lambda state: state.fine_tuning.cancel(),
    c.Action.USE_WEIGHTS: use_weights,
    c.Action.LEAVE_WEIGHTS: lambda state: state.fine_tuning.dismiss(),
    c.Action.CANCEL: _cancel,
    c.Action.PAUSE: _pause,
    c.Action.STEP: _step,
    c.Action.PLAY_DRIVE: _play_drive,
    c.Action.CLOSE: _close,
    c.Action.SEEK_BACK: lambda state: seek_by(state, -SEEK_S),
    c.Action.SEEK_FORWARD: lambda state: seek_by(state, SEEK_S),
    c.Action.PLAY: play_or_hold,
    c.Action.SHOW_NOW: show_now,
    c.Action.EVENT_BEFORE: lambda state: seek_mark(state, None, forwards=False),
    c.Action.EVENT_AFTER: lambda state: seek_mark(state, None, forwards=True),
    c.Action.QUERY_BEFORE: lambda state: seek_mark(state, MarkKind.QUERY_START, forwards=False),
    c.Action.QUERY_AFTER: lambda state: seek_mark(state, MarkKind.QUERY_START, forwards=True),
    c.Action.UNDO_CHANGE: lambda state: world_of(state).undo(),
    c.Action.WATCH_IT_LEARN: begin_story,
    c.Action.ALIGN_PLAN: lambda state: _alignment(state).toggle(),
    c.Action.UNDO_PLAN_CLICK: lambda state: _alignment(state).undo(),
    c.Action.USE_ALIGNMENT: _use_alignment,
}
"""What each wish without a value does; the page and its seat fulfil those that are in neither table."""
_WITH_VALUE: Mapping[c.Action, Callable[[AppState, Any], None]] = {
    c.Action.LEARN: start_fine_tuning,
    c.Action.GOAL: navigate,
    c.Action.SELECT: choose_goal,
    c.Action.PICK: pick,
    c.Action.PICK_EDGE: _pick_edge,
    c.Action.END_ACTION: lambda state, switch: state.actions.answer(succeeded=bool(switch)),
    c.Action.KEEP_GOING: _keep_going,
    c.Action.OPEN: lambda state, name: _open(state, c.OpenRecording(name)),
    c.Action.IMPORT: import_source,
    c.Action.SEEK: lambda state, time_ms: seek(state, time_ms / 1000),
    c.Action.SPEED: set_speed,
    c.Action.DOOR: lambda state, door: world_of(state).toggle_door(door),
    c.Action.AIM_BOX: lambda state, number: world_of(state).aim_box(number),
    c.Action.PUT_BOX: lambda state, place: world_of(state).put_box(place),
    c.Action.TAKE_BOX: lambda state, number: world_of(state).take_box(number),
    c.Action.LIGHT: lambda state, percent: world_of(state).set_light(percent / 100),
    c.Action.SHOW_FLOOR: _choose_floor,
    c.Action.POINT_ON_PLAN: lambda state, place: _alignment(state).take_place(place),
    c.Action.QUESTION: _choose_question,
    c.Action.TELL: lambda state, text: _ask(state, state.debugger.handle_text(text)),
    c.Action.FOLLOW: lambda state, number: _ask(state, state.debugger.link(number) or c.ReportError(_STALE_LINK)),
}
"""What each wish with a value does; the value fits, because `server.drive_messages` checked it."""
