"""From what a page asks for on its drive socket to the session's commands.

Owns the table from keys' and buttons' actions to commands. Driving and stopping are not in it:
they go through the seat.
"""

from collections.abc import Callable

from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.errors import OptionError
from ltvn_core.types import Twist
from ltvn_viz.server.drive_socket import DriveListener
from ltvn_viz.server.driver_seat import ClientId, StopReason
from ltvn_viz.server.keymap import Action
from ltvn_viz.session import commands as c
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.share_links import commands_from_link

SEEK_S = 1.0
LEAST_SPEED, MOST_SPEED = 25, 800
"""Of playing, in per cent."""

PLAIN: dict[Action, Callable[[], c.Command]] = {
    Action.RECORD: c.StartRecording,
    Action.KEEP: c.KeepRecording,
    Action.DISCARD: c.DiscardRecording,
    Action.BUILD: c.BuildMap,
    Action.STOP_LEARNING: c.StopFineTuning,
    Action.USE_WEIGHTS: c.UseWeights,
    Action.LEAVE_WEIGHTS: c.DismissWeights,
    Action.CANCEL: c.Cancel,
    Action.PAUSE: c.Pause,
    Action.STEP: c.StepOnce,
    Action.SEEK_BACK: lambda: c.SeekBy(-SEEK_S),
    Action.SEEK_FORWARD: lambda: c.SeekBy(SEEK_S),
    Action.PUT_BOX: c.PutBox,
    Action.UNDO_CHANGE: c.UndoWorldChange,
    Action.WATCH_IT_LEARN: c.WatchItLearn,
    Action.PLAY: c.PlayTime,
    Action.SHOW_NOW: c.ShowNow,
    Action.EVENT_BEFORE: lambda: c.SeekMark(None, forwards=False),
    Action.EVENT_AFTER: lambda: c.SeekMark(None, forwards=True),
    Action.QUERY_BEFORE: lambda: c.SeekMark(MarkKind.QUERY_START, forwards=False),
    Action.QUERY_AFTER: lambda: c.SeekMark(MarkKind.QUERY_START, forwards=True),
}


ABOUT: dict[Action, Callable[[int], c.Command]] = {
    Action.LEARN: c.FineTune,
    Action.SELECT: c.ChooseGoal,
    Action.FOLLOW: c.FollowLink,
    Action.DOOR: c.ToggleDoor,
    Action.AIM_BOX: c.AimBox,
    Action.TAKE_BOX: c.TakeBox,
    Action.LIGHT: c.SetLight,
    Action.SEEK: lambda time_ms: c.Seek(time_ms / 1000),
    Action.SPEED: lambda percent: c.SetPlaySpeed(min(max(percent, LEAST_SPEED), MOST_SPEED) / 100),
}
"""Actions that carry what they are about."""


def command_for(action: Action, target: int | None) -> c.Command | None:
    """Return what an action asks the session for, None when it is no business of the session's."""
    if action is Action.GOAL:
        return c.NavigateTo(target)
    if action is Action.KEEP_GOING and target in (0, 1):
        return c.KeepGoing(target == 1)
    if action in ABOUT and target is not None:
        return ABOUT[action](target)
    make = PLAIN.get(action)
    return make() if make is not None else None


def drive_listener(session: Session) -> DriveListener:
    """Return whom the drive socket should tell, so that the session hears at once."""

    def on_drive(_client: ClientId, _twist: Twist) -> None:
        session.wake()

    def on_stop(_client: ClientId | None, reason: StopReason) -> None:
        if reason in (StopReason.STOPPED, StopReason.TAKEN_OVER):
            session.send(c.StopRobot())
        session.wake()

    def on_action(_client: ClientId, action: Action, target: int | None) -> None:
        command = command_for(action, target)
        if command is not None:
            session.send(command)

    def on_link(_client: ClientId, query: str) -> None:
        try:
            asked = commands_from_link(query, session.state.debugger.words)
        except OptionError as error:
            asked = (c.ReportError(str(error)),)
        for command in asked:
            session.send(command)

    def on_own_action(client: ClientId, action: Action, target: int | None) -> None:
        command = command_for(action, target)
        if command is not None:
            session.send(command, watcher=client)

    return DriveListener(
        on_drive=on_drive,
        on_stop=on_stop,
        on_action=on_action,
        on_own_action=on_own_action,
        on_link=on_link,
        on_absence=session.wake,
    )
