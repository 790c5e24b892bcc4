"""Carries out what a person asked for.

Owns the meaning of each command. Whether it is legal now is `modes`; runs in the session's thread alone.
"""

from collections.abc import Sequence

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.nav.events import GraphChanged, Severity
from ltvn_core.types import FrameId, NodeId, Rgb
from ltvn_viz import commands as c
from ltvn_viz.building import Building
from ltvn_viz.goals import LOOKALIKES
from ltvn_viz.lessons import learn, use_weights
from ltvn_viz.modes import Mode, refusal
from ltvn_viz.navigation import Navigation
from ltvn_viz.replay import Replay
from ltvn_viz.seeking import seek, seek_mark
from ltvn_viz.snapshot import Work
from ltvn_viz.stage import Stage
from ltvn_viz.why.tool import ToolName

REPLACED = "That answer was replaced before your click arrived. Look again, and click what it says now."


def obey(stage: Stage, command: c.Command) -> None:
    """Carry out a command, or say in the page why not."""
    if (why_not := refusal(command, stage.activity.mode)) is not None:
        stage.say(why_not, Severity.WARN)
        return
    try:
        _carry_out(stage, command)
    except LtvnError as error:
        stage.say(str(error), Severity.ERROR)


def _carry_out(stage: Stage, command: c.Command) -> None:
    match command:
        case c.Stop():
            _stop(stage)
        case c.Cancel():
            stage.give_up("Cancelled.")
        case c.TakeOver():
            stage.give_up("You took over; the task was cancelled.")
        case c.BuildMap():
            stage.activity = Building(stage.live, stage.worker, stage.mapping.rebuild)
        case c.Learn(minutes):
            learn(stage, minutes)
        case c.UseWeights():
            use_weights(stage)
        case c.StopLearning():
            stage.learning.give_up()
        case c.LeaveWeights():
            stage.learning.dismiss()
        case c.Select(node):
            stage.goals.selected = node
        case c.Pick(node):
            _pick(stage, node)
        case c.ChooseTool() | c.Follow() | c.Tell() | c.PointAt():
            _inspect(stage, command)
        case c.ChangeMap(deltas):
            _change(stage, deltas)
        case c.NavigateTo(node):
            _navigate(stage, node)
        case c.NavigateToPicture(rgb):
            _find_and_go(stage, rgb)
        case c.Report(text):
            stage.say(text, Severity.ERROR)
        case c.StartRecording() | c.KeepRecording() | c.DiscardRecording():
            _record(stage, command)
        case _:
            _play(stage, command)


def _stop(stage: Stage) -> None:
    stage.live.robot.stop()
    if isinstance(stage.activity, Navigation):
        stage.give_up("Stopped; the task was cancelled.")


def _play(stage: Stage, command: c.Command) -> None:
    """Commands that mean something to a task or a replay under way."""
    match command, stage.activity:
        case c.Pause(), Replay() as replay:
            replay.play(playing=not replay.playing)
        case c.Pause(), Navigation() as navigation:
            navigation.resume() if navigation.mode is Mode.PAUSED else navigation.pause()
        case c.StepOnce(), Navigation() as navigation:
            navigation.step()
        case c.Seek(time_s), _:
            seek(stage, time_s)
        case c.SeekMark(kind, forwards), _:
            seek_mark(stage, kind, forwards=forwards)
        case c.SeekBy(seconds), Replay() as replay:
            replay.seek(replay.time_s + seconds)
        case c.OpenRecording() as opening, _:
            _open(stage, opening)
        case c.CloseRecording(), _:
            stage.activity = stage.teleop


def _inspect(stage: Stage, command: c.Command) -> None:
    inspector = stage.inspector
    match command:
        case c.ChooseTool(name):
            inspector.choose(next((tool for tool in inspector.shown.offered if tool == name), ToolName.NONE))
        case c.PointAt(node, target):
            inspector.point_at(node, target)
        case c.Tell(text):
            _ask(stage, inspector.told(text))
        case c.Follow(number):
            _ask(stage, inspector.link(number) or c.Report(REPLACED))


def _ask(stage: Stage, asked: c.Command | None) -> None:
    if asked is not None:
        obey(stage, asked)


def _change(stage: Stage, deltas: Sequence[GraphDelta]) -> None:
    def show(changed: Sequence[GraphDelta]) -> None:
        for delta in changed:
            stage.live.emit(GraphChanged(delta))
        stage.cases.anew()

    stage.worker.submit(lambda: stage.mapping.change(deltas), show)


def _pick(stage: Stage, node: NodeId) -> None:
    if stage.inspector.is_on:
        stage.inspector.point_at(node)
    elif stage.activity is stage.teleop:
        _navigate(stage, node)
    elif not isinstance(stage.activity, Replay):
        stage.goals.selected = node


def _navigate(stage: Stage, node: NodeId | None) -> None:
    goal = stage.goals.selected if node is None else node
    if goal is None:
        raise OptionError("Choose a goal first: click a node in the scene or a picture under “Go”.")
    stage.live.robot.stop()
    stage.goals.selected = goal
    stage.queries += 1
    task = stage.mapping.query(stage.live.robot, goal, stage.queries)
    stage.activity = Navigation(stage.live, stage.worker, goal, task, stage.mapping.cancel)


def _find_and_go(stage: Stage, rgb: Rgb) -> None:
    def find() -> tuple[Sequence[NodeId], Sequence[tuple[FrameId, Rgb]]]:
        nodes = stage.mapping.lookalikes(rgb, LOOKALIKES)
        return nodes, stage.mapping.pictures(nodes)

    def go(found: tuple[Sequence[NodeId], Sequence[tuple[FrameId, Rgb]]]) -> None:
        stage.goals.offer_lookalikes(*found)
        if stage.activity is stage.teleop:
            stage.say("Going to the place that looks most like your picture. Others that look like it are shown below.")
            _navigate(stage, found[0][0])

    stage.worker.submit(find, go)


def _record(stage: Stage, command: c.Command) -> None:
    recorder = stage.live.recorder
    # What the map has learned must be in the timeline before a recording begins with it, or ends.
    stage.worker.settle()
    match command:
        case c.StartRecording():
            stage.live.begin_recording(stage.worker)
        case c.KeepRecording():
            stage.kept = recorder.keep().name
            stage.say(f"Kept as {stage.kept}. Open it under “Replay”.")
        case c.DiscardRecording():
            stage.say(f"The recording was set aside as {recorder.discard()}; delete it there if you like.")


def _open(stage: Stage, asked: c.OpenRecording) -> None:
    def show(replay: Replay) -> None:
        stage.work = None
        if isinstance(stage.activity, Navigation | Building):
            stage.say(f"{asked.name} was not opened, because a task began meanwhile. Open it when that is over.")
            return
        replay.watch = stage.live.watch
        replay.seek(asked.at_s)
        stage.activity = replay
        for each in asked.then:
            obey(stage, each)

    stage.live.robot.stop()
    stage.work = Work(f"Opening {asked.name}")
    stage.worker.submit(lambda: stage.open_replay(asked.name), show)
