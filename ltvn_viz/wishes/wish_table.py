"""The table of requests (wishes) on the page: for each, its command, texts, keys, value, and audience.

`WISHES` is the source of keys, buttons, viser's controls, the palette, the help, and the explanation of a refused
command. The command of a wish defines its legal modes; `session.command_handlers` runs it. Keys are named by
KeyboardEvent.code of the browser, which is the position on the keyboard and thus independent of the layout.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from typing import Any, TypeAlias

from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Command, Mode


class Action(StrEnum):
    """An action that a press or a click requests; the value is its name between page and server."""

    STOP = "stop"
    TAKE_OVER = "take_over"
    RELEASE = "release"
    RECORD = "record"
    KEEP = "keep"
    DISCARD = "discard"
    BUILD = "build"
    UNDO_BUILD = "undo_build"
    LEARN = "learn"
    STOP_LEARNING = "stop_learning"
    USE_WEIGHTS = "use_weights"
    LEAVE_WEIGHTS = "leave_weights"
    GOAL = "goal"
    SELECT = "select"
    PICK = "pick"
    PICK_EDGE = "pick_edge"
    CANCEL = "cancel"
    END_ACTION = "end_action"
    PAUSE = "pause"
    STEP = "step"
    KEEP_GOING = "keep_going"
    LARGER_PICTURE = "larger_picture"
    OPEN = "open"
    IMPORT = "import"
    CLOSE = "close"
    SEEK_BACK = "seek_back"
    SEEK_FORWARD = "seek_forward"
    SEEK = "seek"
    PLAY = "play"
    SPEED = "speed"
    SHOW_NOW = "show_now"
    EVENT_BEFORE = "event_before"
    EVENT_AFTER = "event_after"
    QUERY_BEFORE = "query_before"
    QUERY_AFTER = "query_after"
    DOOR = "door"
    AIM_BOX = "aim_box"
    PUT_BOX = "put_box"
    TAKE_BOX = "take_box"
    LIGHT = "light"
    UNDO_CHANGE = "undo_change"
    WATCH_IT_LEARN = "watch_it_learn"
    SHOW_FLOOR = "show_floor"
    ALIGN_PLAN = "align_plan"
    POINT_ON_PLAN = "point_on_plan"
    UNDO_PLAN_CLICK = "undo_plan_click"
    USE_ALIGNMENT = "use_alignment"
    QUESTION = "question"
    TELL = "tell"
    FOLLOW = "follow"
    HELP = "help"


class Audience(Enum):
    """Pages that may use a wish."""

    DRIVER = auto()
    """The page with the seat, because all pages see the effect."""
    EVERYBODY = auto()
    """Any page; the driver's seat or the page itself performs it."""


Value: TypeAlias = int | str | tuple[float, float] | None
"""Value that comes with a wish."""
MAX_WHOLE = 2**53 - 1
"""Largest integer that JavaScript represents exactly, as it does all smaller ones."""
MAX_TEXT = 500
"""Maximum number of characters of a name or a question."""
FARTHEST_M = 10_000.0


class Carried(Enum):
    """The kind of value that a wish carries."""

    NOTHING = auto()
    WHOLE = auto()
    """An integer of 0 or more."""
    WHOLE_OR_NOTHING = auto()
    SWITCH = auto()
    """A switch: 1 for on, 0 for off."""
    TEXT = auto()
    PLACE = auto()
    """A position (x, y) in metres."""
    EDGE = auto()
    """Source and target of an edge."""
    PLACE_OR_NOTHING = auto()

    def fits(self, value: Value) -> bool:
        """Tell whether a value is of this kind, and not too large."""
        match value:
            case None:
                return self in (Carried.NOTHING, Carried.WHOLE_OR_NOTHING, Carried.PLACE_OR_NOTHING)
            case bool():
                return False
            case int():
                most = 1 if self is Carried.SWITCH else MAX_WHOLE
                return self in _NUMBERS and 0 <= value <= most
            case str():
                return self is Carried.TEXT and len(value) <= MAX_TEXT
            case int() as source, int() as target if self is Carried.EDGE:
                return min(source, target) >= 0 and max(source, target) <= MAX_WHOLE
            case x, y:
                return self in _PLACES and max(abs(x), abs(y)) <= FARTHEST_M and math.isfinite(x + y)


_NUMBERS = (Carried.WHOLE, Carried.WHOLE_OR_NOTHING, Carried.SWITCH)
_PLACES = (Carried.PLACE, Carried.PLACE_OR_NOTHING)


@dataclass(frozen=True, slots=True)
class Wish:
    """One row of the table."""

    command: type[Command] | None
    """The command for the session; None if the driver's seat or the page itself does it."""
    label: str
    """Text of the button; empty if there is no button."""
    help: str
    """Effect of the action; it begins with a small letter, because it follows the name of a key."""
    keys: tuple[str, ...] = ()
    carries: Carried = Carried.NOTHING
    audience: Audience = Audience.DRIVER
    make: Callable[..., Command] | None = None
    """Creates the command from the value; None uses the class of the command."""

    @property
    def modes(self) -> frozenset[Mode]:
        """Modes in which the wish is legal."""
        return c.ANYWHERE if self.command is None else self.command.modes

    @property
    def is_listed(self) -> bool:
        """Tell whether the palette can list the wish without a value."""
        return self.audience is Audience.DRIVER and self.carries.fits(None)


SEEK_S = 1.0
LEAST_SPEED, MOST_SPEED = 25, 800
"""Limits of the playing speed, in percent."""


def _speed(percent: int) -> Command:
    return c.SetPlaySpeed(min(max(percent, LEAST_SPEED), MOST_SPEED) / 100)


WISHES: Mapping[Action, Wish] = {
    Action.STOP: Wish(
        c.StopRobot, "Stop", "stop the robot, whoever drives", keys=("Space",), audience=Audience.EVERYBODY
    ),
    Action.TAKE_OVER: Wish(None, "Take over", "drive from this page", audience=Audience.EVERYBODY),
    Action.RELEASE: Wish(None, "", "let another page drive", audience=Audience.EVERYBODY),
    Action.RECORD: Wish(c.StartRecording, "Record", "start recording", keys=("KeyR",)),
    Action.KEEP: Wish(c.KeepRecording, "Keep", "end the recording and keep it", keys=("KeyN",)),
    Action.DISCARD: Wish(c.DiscardRecording, "Discard", "end the recording and set it aside", keys=("Backspace",)),
    Action.BUILD: Wish(c.BuildMap, "Build a map", "build a map of all images", keys=("KeyB",)),
    Action.UNDO_BUILD: Wish(c.UndoBuild, "Undo the rebuild", "restore the map from before the rebuild"),
    Action.LEARN: Wish(
        c.FineTune,
        "Learn from this drive",
        "fine-tune the network on these images; the map does not change until you use the new weights",
        carries=Carried.WHOLE,
    ),
    Action.STOP_LEARNING: Wish(c.StopFineTuning, "Stop learning", "stop learning; the network stays as it is"),
    Action.USE_WEIGHTS: Wish(
        c.UseWeights,
        "Use these weights and rebuild the map",
        "use the new weights; it takes about as long as building a map",
    ),
    Action.LEAVE_WEIGHTS: Wish(
        c.DismissWeights, "Discard the new weights", "keep the weights in use; the new ones stay on disk"
    ),
    Action.GOAL: Wish(
        c.NavigateTo, "Navigate", "go to the chosen goal", keys=("KeyG",), carries=Carried.WHOLE_OR_NOTHING
    ),
    Action.SELECT: Wish(c.ChooseGoal, "Choose a goal", "go to the node of an image", carries=Carried.WHOLE),
    Action.PICK: Wish(c.PickNode, "", "go to a node of the scene, or ask about it", carries=Carried.WHOLE),
    Action.PICK_EDGE: Wish(
        c.PickEdge, "", "ask about an edge of the map", carries=Carried.EDGE, make=lambda ends: c.PickEdge(*ends)
    ),
    Action.CANCEL: Wish(c.Cancel, "Cancel", "cancel the current activity", keys=("Escape",)),
    Action.END_ACTION: Wish(
        c.EndAction,
        "End the action",
        "tell the robot whether the action is done that it waits for",
        carries=Carried.SWITCH,
        make=lambda number: c.EndAction(succeeded=number == 1),
    ),
    Action.PAUSE: Wish(c.Pause, "Pause", "pause, or continue", keys=("KeyP",)),
    Action.STEP: Wish(c.StepOnce, "Step", "one control step, then pause", keys=("Period",)),
    Action.KEEP_GOING: Wish(
        c.KeepGoing,
        "Keep going when this page closes",
        "for long runs in simulation; otherwise a query pauses as soon as no page is open",
        carries=Carried.SWITCH,
        make=lambda number: c.KeepGoing(number == 1),
    ),
    Action.LARGER_PICTURE: Wish(
        c.ShowLarger,
        "Show a larger camera image",
        "only for people; it costs processor time, and the method still uses the small image",
        carries=Carried.SWITCH,
        make=lambda number: c.ShowLarger(number == 1),
    ),
    Action.OPEN: Wish(c.OpenRecording, "Open", "open a recording", carries=Carried.TEXT),
    Action.IMPORT: Wish(c.ImportDrive, "Import", "make a recording of a drive and open it", carries=Carried.TEXT),
    Action.CLOSE: Wish(c.CloseRecording, "Back to the robot", "leave the recording"),
    Action.SEEK_BACK: Wish(c.SeekBy, "", "go back one second", keys=("BracketLeft",), make=lambda: c.SeekBy(-SEEK_S)),
    Action.SEEK_FORWARD: Wish(
        c.SeekBy, "", "go forward one second", keys=("BracketRight",), make=lambda: c.SeekBy(SEEK_S)
    ),
    Action.SEEK: Wish(
        c.Seek,
        "Seek",
        "show a moment, given in milliseconds after the beginning",
        carries=Carried.WHOLE,
        make=lambda time_ms: c.Seek(time_ms / 1000),
    ),
    Action.PLAY: Wish(c.PlayTime, "Play", "play, or pause the time shown"),
    Action.SPEED: Wish(c.SetPlaySpeed, "", "set the speed of playing, in percent", carries=Carried.WHOLE, make=_speed),
    Action.SHOW_NOW: Wish(c.ShowNow, "Back to now", "go back to now"),
    Action.EVENT_BEFORE: Wish(
        c.SeekMark,
        "Go to an event",
        "look back: go to the previous event",
        keys=("Semicolon",),
        make=lambda: c.SeekMark(None, forwards=False),
    ),
    Action.EVENT_AFTER: Wish(
        c.SeekMark, "", "look back: go to the next event", keys=("Quote",), make=lambda: c.SeekMark(None, forwards=True)
    ),
    Action.QUERY_BEFORE: Wish(
        c.SeekMark,
        "",
        "look back: go to the previous query",
        keys=("Minus",),
        make=lambda: c.SeekMark(MarkKind.QUERY_START, forwards=False),
    ),
    Action.QUERY_AFTER: Wish(
        c.SeekMark,
        "",
        "look back: go to the next query",
        keys=("Equal",),
        make=lambda: c.SeekMark(MarkKind.QUERY_START, forwards=True),
    ),
    Action.DOOR: Wish(
        c.ToggleDoor, "Open or close a door", "close an open door, open a closed one", carries=Carried.WHOLE
    ),
    Action.AIM_BOX: Wish(
        c.AimBox, "Put a box on the floor", "then click its place on the floor", carries=Carried.WHOLE
    ),
    Action.PUT_BOX: Wish(
        c.PutBox, "Put a box in front of the robot", "put a box in front of the robot", carries=Carried.PLACE_OR_NOTHING
    ),
    Action.TAKE_BOX: Wish(c.TakeBox, "Take away a box", "take a box away", carries=Carried.WHOLE),
    Action.LIGHT: Wish(
        c.SetLight, "Change the light", "set the brightness of the light, in percent", carries=Carried.WHOLE
    ),
    Action.UNDO_CHANGE: Wish(c.UndoWorldChange, "Undo", "undo the last change of the world"),
    Action.WATCH_IT_LEARN: Wish(
        c.WatchItLearn,
        "Watch it learn",
        "watch how the map learns: a door on the robot's path closes, and opens again",
    ),
    Action.SHOW_FLOOR: Wish(
        c.ShowFloor,
        "Show the robot's floor",
        "show one floor of a map with several",
        carries=Carried.WHOLE_OR_NOTHING,
    ),
    Action.ALIGN_PLAN: Wish(
        c.AlignFloorPlan, "Align the floor plan by clicks", "lay the floor plan under the map, by clicks on both"
    ),
    Action.POINT_ON_PLAN: Wish(c.PointOnFloorPlan, "", "point to the node's place on the plan", carries=Carried.PLACE),
    Action.UNDO_PLAN_CLICK: Wish(c.UndoPlanClick, "", "take the last click of the alignment back"),
    Action.USE_ALIGNMENT: Wish(c.UseAlignment, "", "keep the floor plan as it lies now"),
    Action.QUESTION: Wish(c.ChooseQuestion, "Ask why", "choose a question", carries=Carried.TEXT),
    Action.TELL: Wish(
        c.SubmitText,
        "",
        "give the question shown the text that it asks for",
        carries=Carried.TEXT,
    ),
    Action.FOLLOW: Wish(c.FollowLink, "", "follow a link of the answer", carries=Carried.WHOLE),
    Action.HELP: Wish(None, "", "show or hide this help", keys=("KeyH",), audience=Audience.EVERYBODY),
}

UNASKED: Mapping[type[Command], str] = {
    c.TakeOver: "take over",  # The session notices held keys by itself.
    c.NavigateToImage: "upload an image",  # A file comes in pieces that the drive socket does not carry.
    c.EditMap: "change the map by hand",  # A question builds it from a link or from typed text.
    c.AskQuestion: "",  # Sent by a link of an answer.
    c.PointAt: "",  # Sent by an address, or by a link of an answer.
    c.ReportError: "",  # Sent by the app itself.
}
"""Commands without an action, and their names on the page."""


def command_for(action: Action, value: Value = None) -> Command | None:
    """Return the command of an action for the session; None if the action is not for the session."""
    wish = WISHES[action]
    if wish.command is None:
        return None
    if not wish.carries.fits(value):
        return c.ReportError(f"“{wish.help}” does not accept the value {str(value)[:40]!r}.")
    make: Any = wish.make or wish.command  # A value that fits has the type that the command takes.
    made: Command = make() if wish.carries is Carried.NOTHING else make(value)
    return made


def refusal(command: Command, mode: Mode) -> str | None:
    """Return why `command` is illegal in `mode`, and what makes it possible; None if it is legal."""
    if mode in command.modes:
        return None
    label = _labels()[type(command)] or "that"
    return f"“{label[:1].upper()}{label[1:]}” is not possible while {_WHILE[mode]}. {_first(command.modes, mode)}"


_WHILE = {
    Mode.TELEOP: "the robot waits for you",
    Mode.BUILDING: "the map is being built",
    Mode.NAVIGATING: "the robot drives to a goal",
    Mode.PAUSED: "a query is paused",
    Mode.REPLAY: "a recording is open",
}
"""What the app does in each mode, in words."""


def _first(legal: frozenset[Mode], mode: Mode) -> str:
    """Return what a person must do first to come from a mode to one in which a command is legal."""
    match mode:
        case Mode.BUILDING:
            return "Wait until the map is done, or press Cancel."
        case Mode.NAVIGATING:
            return "Wait until the robot is there, or press Cancel."
        case Mode.PAUSED:
            return "Press Go on or Cancel first."
        case Mode.REPLAY:
            return "Press Back to the robot first."
        case Mode.TELEOP:
            is_of_replay = legal == {Mode.REPLAY}
            return "Open a recording under “Replay” first." if is_of_replay else "Choose a goal under “Go” first."


def _labels() -> dict[type[Command], str]:
    """Return the name of each command on the page, from its first row in the table."""
    labels: dict[type[Command], str] = {}
    for wish in WISHES.values():
        if wish.command is not None:
            labels.setdefault(wish.command, wish.label[:1].lower() + wish.label[1:])
    return {**labels, **UNASKED}
