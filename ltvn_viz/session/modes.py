"""What the app is doing, and which commands make sense while it does it.

Owns the table of legal commands and the friendly sentence for an illegal one. Carries nothing out.
"""

from enum import StrEnum

from ltvn_viz.session import commands as c


class Mode(StrEnum):
    """What the app is doing; the value is what the page shows."""

    TELEOP = "driving"
    """A person drives; the map may grow."""
    BUILDING = "building"
    """Algorithm 1 runs; the robot stands still."""
    NAVIGATING = "navigating"
    """The robot drives by itself."""
    PAUSED = "paused"
    """A query waits; the robot stands still."""
    REPLAY = "replay"
    """The page shows a recording; the robot stands still."""


ANYWHERE = frozenset(Mode)
LIVE = frozenset({Mode.TELEOP, Mode.NAVIGATING, Mode.PAUSED})

LEGAL_MODES: dict[type[c.Command], frozenset[Mode]] = {
    c.StopRobot: ANYWHERE,
    c.Cancel: ANYWHERE,
    c.Pause: frozenset({Mode.NAVIGATING, Mode.PAUSED, Mode.REPLAY}),
    c.StepOnce: frozenset({Mode.NAVIGATING, Mode.PAUSED}),
    c.KeepGoing: ANYWHERE,
    c.TakeOver: frozenset({Mode.NAVIGATING, Mode.PAUSED}),
    c.StartRecording: LIVE,
    c.KeepRecording: LIVE,
    c.DiscardRecording: LIVE,
    c.BuildMap: frozenset({Mode.TELEOP, Mode.REPLAY}),
    c.ImportDrive: frozenset({Mode.TELEOP, Mode.REPLAY}),
    c.FineTune: ANYWHERE,
    c.StopFineTuning: ANYWHERE,
    c.UseWeights: frozenset({Mode.TELEOP}),
    c.DismissWeights: ANYWHERE,
    c.ChooseQuestion: ANYWHERE,
    c.FollowLink: ANYWHERE,
    c.SubmitText: ANYWHERE,
    c.AskQuestion: ANYWHERE,
    c.PointAt: ANYWHERE,
    c.ChooseGoal: LIVE,
    c.PickNode: ANYWHERE,
    c.NavigateTo: frozenset({Mode.TELEOP}),
    c.NavigateToImage: frozenset({Mode.TELEOP, Mode.REPLAY}),
    c.OpenRecording: frozenset({Mode.TELEOP, Mode.REPLAY}),
    c.CloseRecording: frozenset({Mode.REPLAY}),
    c.Seek: LIVE | {Mode.REPLAY},
    c.EditMap: frozenset({Mode.TELEOP}),
    c.SeekMark: LIVE | {Mode.REPLAY},
    c.SeekBy: LIVE | {Mode.REPLAY},
    c.PlayTime: LIVE | {Mode.REPLAY},
    c.SetPlaySpeed: ANYWHERE,
    c.ShowNow: LIVE | {Mode.REPLAY},
    c.ToggleDoor: LIVE,
    c.AimBox: LIVE,
    c.PutBox: LIVE,
    c.TakeBox: LIVE,
    c.SetLight: LIVE,
    c.UndoWorldChange: LIVE,
    c.WatchItLearn: frozenset({Mode.TELEOP}),
    c.ReportError: ANYWHERE,
}


def refusal(command: c.Command, mode: Mode) -> str | None:
    """Return why `command` makes no sense in `mode` and what does, or None when it is legal."""
    if mode in LEGAL_MODES[type(command)]:
        return None
    when = " or ".join(sorted(LEGAL_MODES[type(command)]))
    possible = ", ".join(kind.label for kind, modes in LEGAL_MODES.items() if mode in modes and kind.label)
    label = command.label or "That"
    return f"“{label}” works while {when}; now the app is {mode}. You can: {possible}."
