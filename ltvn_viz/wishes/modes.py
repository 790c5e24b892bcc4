"""The modes of the app, and the sets of modes in which a wish is legal."""

from enum import StrEnum


class Mode(StrEnum):
    """Activity of the app; the value is the word that the page shows."""

    TELEOP = "manual"
    """A person drives; the map may grow."""
    BUILDING = "building"
    """Algorithm 1 runs; the robot is stopped."""
    NAVIGATING = "navigating"
    """The robot navigates to a goal."""
    PAUSED = "paused"
    """A query is paused; the robot is stopped."""
    REPLAY = "replay"
    """The page shows a recording; the robot is stopped."""


ANYWHERE = frozenset(Mode)
LIVE = frozenset({Mode.TELEOP, Mode.NAVIGATING, Mode.PAUSED})
DRIVING = frozenset({Mode.TELEOP})
UNDER_WAY = frozenset({Mode.NAVIGATING, Mode.PAUSED})
"""Modes in which a query is in progress."""
STANDING = frozenset({Mode.TELEOP, Mode.REPLAY})
"""Modes in which neither a query nor the building of a map is in progress."""
REPLAYING = frozenset({Mode.REPLAY})
IN_TIME = LIVE | REPLAYING
"""Modes in which the moment on show can be chosen."""

_WHILE = {
    Mode.TELEOP: "the robot waits for you",
    Mode.BUILDING: "the map is being built",
    Mode.NAVIGATING: "the robot drives to a goal",
    Mode.PAUSED: "a query is paused",
    Mode.REPLAY: "a recording is open",
}
"""What the app does in each mode, in words."""
_FIRST = {
    Mode.BUILDING: "Wait until the map is done, or press Cancel.",
    Mode.NAVIGATING: "Wait until the robot is there, or press Cancel.",
    Mode.PAUSED: "Press Go on or Cancel first.",
    Mode.REPLAY: "Press Back to the robot first.",
}
"""What leads from each mode to one in which a wish is legal."""


def refusal(words: str, legal: frozenset[Mode], mode: Mode) -> str | None:
    """Return why `words` are not possible in `mode`, and what makes them possible; None if they are."""
    if mode in legal:
        return None
    in_manual = "Open a recording under “Replay” first." if legal == REPLAYING else "Choose a goal under “Go” first."
    first = _FIRST.get(mode, in_manual)
    return f"“{words[:1].upper()}{words[1:]}” is not possible while {_WHILE[mode]}. {first}"


def reason_against(legal: frozenset[Mode], mode: Mode) -> str:
    """Return in a few words why nothing with these legal modes is possible in `mode`; empty if it is."""
    if mode in legal:
        return ""
    if mode is not Mode.TELEOP:
        return f"not while {_WHILE[mode]}"
    return "only while the robot drives to a goal" if legal & UNDER_WAY else "only while a recording is open"
