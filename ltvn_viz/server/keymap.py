"""What each key does, in one table.

The page's bindings, the on-screen help and the documentation are all made from `KEYS`. Keys are named by
`KeyboardEvent.code`, the place on the keyboard, so that W A S D lies under the same fingers on every layout.
Owns no behaviour: the script sends directions and actions, the driver's seat and the session carry them out.
"""

from dataclasses import dataclass
from enum import StrEnum


class Direction(StrEnum):
    """Where a held input pushes the robot."""

    FORWARD = "forward"
    BACKWARD = "backward"
    LEFT = "left"
    RIGHT = "right"


class Action(StrEnum):
    """What a person asks for with one press or one click."""

    STOP = "stop"
    TAKE_OVER = "take_over"
    RELEASE = "release"
    RECORD = "record"
    KEEP = "keep"
    DISCARD = "discard"
    BUILD = "build"
    LEARN = "learn"
    """Carries the minutes to spend."""
    STOP_LEARNING = "stop_learning"
    USE_WEIGHTS = "use_weights"
    LEAVE_WEIGHTS = "leave_weights"
    GOAL = "goal"
    CANCEL = "cancel"
    PAUSE = "pause"
    STEP = "step"
    KEEP_GOING = "keep_going"
    """Carries 1 to let the robot drive on when the last page closes, 0 to let it pause."""
    SEEK_BACK = "seek_back"
    SEEK_FORWARD = "seek_forward"
    SEEK = "seek"
    """Carries the moment to show, in milliseconds after the beginning of the run."""
    PLAY = "play"
    """Let the time on show go on, or hold it."""
    SPEED = "speed"
    """Carries the speed of playing in per cent."""
    SHOW_NOW = "show_now"
    EVENT_BEFORE = "event_before"
    EVENT_AFTER = "event_after"
    QUERY_BEFORE = "query_before"
    QUERY_AFTER = "query_after"
    DOOR = "door"
    """Closes an open door, opens a closed one. Carries the door's number."""
    AIM_BOX = "aim_box"
    """Carries the number of the box to move by a click on the floor, 0 for a new one."""
    PUT_BOX = "put_box"
    TAKE_BOX = "take_box"
    """Carries the box's number."""
    LIGHT = "light"
    """Carries the brightness in per cent."""
    UNDO_CHANGE = "undo_change"
    WATCH_IT_LEARN = "watch_it_learn"
    HELP = "help"
    SELECT = "select"
    """A click on an image: look at it. Carries the image's id."""
    FOLLOW = "follow"
    """A click on a link in what a tool shows. Carries the link's number."""


OWN_VIEW = frozenset({Action.FOLLOW})
"""A page without the seat does these in its own view."""
FOR_EVERYBODY = frozenset({Action.STOP, Action.TAKE_OVER, Action.RELEASE, Action.HELP, *OWN_VIEW})
"""Watchers may ask for these; everything else changes what all pages see, and belongs to the driver."""


@dataclass(frozen=True, slots=True)
class KeyBinding:
    """Keys that do the same thing."""

    codes: tuple[str, ...]
    """`KeyboardEvent.code` of each key."""
    meaning: Direction | Action
    help: str

    @property
    def caps(self) -> str:
        """Return what is printed on the keys, for instance `W or ↑`."""
        return " or ".join(KEY_LABELS.get(code, code.removeprefix("Key")) for code in self.codes)


KEY_LABELS = {
    "ArrowUp": "↑",
    "ArrowDown": "↓",
    "ArrowLeft": "←",
    "ArrowRight": "→",
    "Escape": "Esc",
    "Period": ".",
    "BracketLeft": "[",
    "BracketRight": "]",
    "Semicolon": ";",
    "Quote": "'",
    "Minus": "-",
    "Equal": "=",
}

KEYS = (
    KeyBinding(("KeyW", "ArrowUp"), Direction.FORWARD, "drive forward while held"),
    KeyBinding(("KeyS", "ArrowDown"), Direction.BACKWARD, "back up while held"),
    KeyBinding(("KeyA", "ArrowLeft"), Direction.LEFT, "turn left while held"),
    KeyBinding(("KeyD", "ArrowRight"), Direction.RIGHT, "turn right while held"),
    KeyBinding(("Space",), Action.STOP, "stop the robot, whoever drives"),
    KeyBinding(("KeyR",), Action.RECORD, "start recording"),
    KeyBinding(("KeyN",), Action.KEEP, "keep the recording"),
    KeyBinding(("Backspace",), Action.DISCARD, "discard the recording"),
    KeyBinding(("KeyB",), Action.BUILD, "build a map"),
    KeyBinding(("KeyG",), Action.GOAL, "go to the selected goal"),
    KeyBinding(("Escape",), Action.CANCEL, "cancel the query"),
    KeyBinding(("KeyP",), Action.PAUSE, "pause, or go on"),
    KeyBinding(("Period",), Action.STEP, "one step, then pause"),
    KeyBinding(("BracketLeft",), Action.SEEK_BACK, "replay: back one second"),
    KeyBinding(("BracketRight",), Action.SEEK_FORWARD, "replay: on one second"),
    KeyBinding(("Semicolon",), Action.EVENT_BEFORE, "look back: at the event before"),
    KeyBinding(("Quote",), Action.EVENT_AFTER, "look back: at the next event"),
    KeyBinding(("Minus",), Action.QUERY_BEFORE, "look back: at the query before"),
    KeyBinding(("Equal",), Action.QUERY_AFTER, "look back: at the next query"),
    KeyBinding(("KeyH",), Action.HELP, "show or hide this help"),
)

SLOW_HELP = ("Shift", "drive slowly while held")


def key_label(meaning: Direction | Action) -> str:
    """Return what is printed on the keys that mean something; empty if none do."""
    return next((binding.caps for binding in KEYS if binding.meaning is meaning), "")


def help_rows() -> tuple[tuple[str, str], ...]:
    """Return (what is printed on the keys, what they do) of every binding, in the order of the help."""
    rows = [(binding.caps, binding.help) for binding in KEYS]
    last_direction = sum(isinstance(binding.meaning, Direction) for binding in KEYS)
    return (*rows[:last_direction], SLOW_HELP, *rows[last_direction:])


def direction_codes() -> dict[str, str]:
    """Return the script's table of held keys: code -> direction."""
    return {code: key.meaning.value for key in KEYS if isinstance(key.meaning, Direction) for code in key.codes}


def action_codes() -> dict[str, str]:
    """Return the script's table of pressed keys: code -> action."""
    return {code: key.meaning.value for key in KEYS if isinstance(key.meaning, Action) for code in key.codes}
