"""The table of requests (wishes) on the page: for each, its legal modes, texts, keys, value, and audience.

`WISHES` is the source of keys, buttons, viser's controls, the palette, the help, and the explanation of a refused
command; `session.command_handlers` has the function of each wish. Keys are named by KeyboardEvent.code of the browser,
which is the position on the keyboard and thus independent of the layout.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto

from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Action, Ask, Command, Mode, Value


class Audience(Enum):
    """Pages that may use a wish."""

    DRIVER = auto()
    """The page with the seat, because all pages see the effect."""
    EVERYBODY = auto()
    """Any page; the driver's seat or the page itself performs it."""


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

    modes: frozenset[Mode]
    """Modes in which the wish is legal."""
    label: str
    """Text of the button; empty if there is no button."""
    help: str
    """Effect of the action; it begins with a small letter, because it follows the name of a key."""
    keys: tuple[str, ...] = ()
    carries: Carried = Carried.NOTHING
    audience: Audience = Audience.DRIVER

    @property
    def is_listed(self) -> bool:
        """Tell whether the palette can list the wish without a value."""
        return self.audience is Audience.DRIVER and self.carries.fits(None)


WISHES: Mapping[Action, Wish] = {
    Action.STOP: Wish(
        c.ANYWHERE, "Stop", "stop the robot, whoever drives", keys=("Space",), audience=Audience.EVERYBODY
    ),
    Action.TAKE_OVER: Wish(c.ANYWHERE, "Take over", "drive from this page", audience=Audience.EVERYBODY),
    Action.RELEASE: Wish(c.ANYWHERE, "", "let another page drive", audience=Audience.EVERYBODY),
    Action.RECORD: Wish(c.LIVE, "Record", "start recording", keys=("KeyR",)),
    Action.KEEP: Wish(c.LIVE, "Keep", "end the recording and keep it", keys=("KeyN",)),
    Action.DISCARD: Wish(c.LIVE, "Discard", "end the recording and set it aside", keys=("Backspace",)),
    Action.BUILD: Wish(c.STANDING, "Build a map", "build a map of all images", keys=("KeyB",)),
    Action.UNDO_BUILD: Wish(c.DRIVING, "Undo the rebuild", "restore the map from before the rebuild"),
    Action.LEARN: Wish(
        c.ANYWHERE,
        "Learn from this drive",
        "fine-tune the network on these images; the map does not change until you use the new weights",
        carries=Carried.WHOLE,
    ),
    Action.STOP_LEARNING: Wish(c.ANYWHERE, "Stop learning", "stop learning; the network stays as it is"),
    Action.USE_WEIGHTS: Wish(
        c.DRIVING,
        "Use these weights and rebuild the map",
        "use the new weights; it takes about as long as building a map",
    ),
    Action.LEAVE_WEIGHTS: Wish(
        c.ANYWHERE, "Discard the new weights", "keep the weights in use; the new ones stay on disk"
    ),
    Action.GOAL: Wish(c.DRIVING, "Navigate", "go to the chosen goal", keys=("KeyG",), carries=Carried.WHOLE_OR_NOTHING),
    Action.SELECT: Wish(c.LIVE, "Choose a goal", "go to the node of an image", carries=Carried.WHOLE),
    Action.PICK: Wish(c.ANYWHERE, "", "go to a node of the scene, or ask about it", carries=Carried.WHOLE),
    Action.PICK_EDGE: Wish(c.ANYWHERE, "", "ask about an edge of the map", carries=Carried.EDGE),
    Action.CANCEL: Wish(c.ANYWHERE, "Cancel", "cancel the current activity", keys=("Escape",)),
    Action.END_ACTION: Wish(
        c.UNDER_WAY,
        "End the action",
        "tell the robot whether the action is done that it waits for",
        carries=Carried.SWITCH,
    ),
    Action.PAUSE: Wish(c.UNDER_WAY | c.REPLAYING, "Pause", "pause, or continue", keys=("KeyP",)),
    Action.STEP: Wish(c.UNDER_WAY, "Step", "one control step, then pause", keys=("Period",)),
    Action.PLAY_DRIVE: Wish(
        c.DRIVING, "Play the drive again", "play the drive in the robot's place from its beginning"
    ),
    Action.KEEP_GOING: Wish(
        c.ANYWHERE,
        "Keep going when this page closes",
        "for long runs in simulation; otherwise a query pauses as soon as no page is open",
        carries=Carried.SWITCH,
    ),
    Action.OPEN: Wish(c.STANDING, "Open", "open a recording", carries=Carried.TEXT),
    Action.IMPORT: Wish(c.STANDING, "Import", "make a recording of a drive and open it", carries=Carried.TEXT),
    Action.CLOSE: Wish(c.REPLAYING, "Back to the robot", "leave the recording"),
    Action.SEEK_BACK: Wish(c.IN_TIME, "", "go back one second", keys=("BracketLeft",)),
    Action.SEEK_FORWARD: Wish(c.IN_TIME, "", "go forward one second", keys=("BracketRight",)),
    Action.SEEK: Wish(
        c.IN_TIME, "Seek", "show a moment, given in milliseconds after the beginning", carries=Carried.WHOLE
    ),
    Action.PLAY: Wish(c.IN_TIME, "Play", "play, or pause the time shown"),
    Action.SPEED: Wish(c.ANYWHERE, "", "set the speed of playing, in percent", carries=Carried.WHOLE),
    Action.SHOW_NOW: Wish(c.IN_TIME, "Back to now", "go back to now"),
    Action.EVENT_BEFORE: Wish(c.IN_TIME, "Go to an event", "look back: go to the previous event", keys=("Semicolon",)),
    Action.EVENT_AFTER: Wish(c.IN_TIME, "", "look back: go to the next event", keys=("Quote",)),
    Action.QUERY_BEFORE: Wish(c.IN_TIME, "", "look back: go to the previous query", keys=("Minus",)),
    Action.QUERY_AFTER: Wish(c.IN_TIME, "", "look back: go to the next query", keys=("Equal",)),
    Action.DOOR: Wish(c.LIVE, "Open or close a door", "close an open door, open a closed one", carries=Carried.WHOLE),
    Action.AIM_BOX: Wish(c.LIVE, "Put a box on the floor", "then click its place on the floor", carries=Carried.WHOLE),
    Action.PUT_BOX: Wish(
        c.LIVE, "Put a box in front of the robot", "put a box in front of the robot", carries=Carried.PLACE_OR_NOTHING
    ),
    Action.TAKE_BOX: Wish(c.LIVE, "Take away a box", "take a box away", carries=Carried.WHOLE),
    Action.LIGHT: Wish(
        c.LIVE, "Change the light", "set the brightness of the light, in percent", carries=Carried.WHOLE
    ),
    Action.UNDO_CHANGE: Wish(c.LIVE, "Undo", "undo the last change of the world"),
    Action.WATCH_IT_LEARN: Wish(
        c.DRIVING, "Watch it learn", "watch how the map learns: a door on the robot's path closes, and opens again"
    ),
    Action.SHOW_FLOOR: Wish(
        c.ANYWHERE, "Show the robot's floor", "show one floor of a map with several", carries=Carried.WHOLE_OR_NOTHING
    ),
    Action.ALIGN_PLAN: Wish(
        c.ANYWHERE, "Align the floor plan by clicks", "lay the floor plan under the map, by clicks on both"
    ),
    Action.POINT_ON_PLAN: Wish(c.ANYWHERE, "", "point to the node's place on the plan", carries=Carried.PLACE),
    Action.UNDO_PLAN_CLICK: Wish(c.ANYWHERE, "", "take the last click of the alignment back"),
    Action.USE_ALIGNMENT: Wish(c.ANYWHERE, "", "keep the floor plan as it lies now"),
    Action.QUESTION: Wish(c.ANYWHERE, "Ask why", "choose a question", carries=Carried.TEXT),
    Action.TELL: Wish(c.ANYWHERE, "", "give the question shown the text that it asks for", carries=Carried.TEXT),
    Action.FOLLOW: Wish(c.ANYWHERE, "", "follow a link of the answer", carries=Carried.WHOLE),
    Action.HELP: Wish(c.ANYWHERE, "", "show or hide this help", keys=("KeyH",), audience=Audience.EVERYBODY),
}

_OTHERS: Mapping[type[Command], tuple[frozenset[Mode], str]] = {
    c.NavigateToImage: (c.STANDING, "upload an image"),
    c.EditMap: (c.DRIVING, "change the map by hand"),
    c.OpenRecording: (c.STANDING, "open"),
    c.Seek: (c.IN_TIME, "seek"),
}
"""Legal modes and names of the commands outside the table; all others are legal in every mode."""


def refusal(command: Command, mode: Mode) -> str | None:
    """Return why `command` is illegal in `mode`, and what makes it possible; None if it is legal."""
    if isinstance(command, Ask):
        wish = WISHES[command.action]
        modes, words = wish.modes, wish.label or wish.help
    else:
        modes, words = _OTHERS.get(type(command), (c.ANYWHERE, ""))
    if mode in modes:
        return None
    return f"“{words[:1].upper()}{words[1:]}” is not possible while {_WHILE[mode]}. {_first(modes, mode)}"


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
