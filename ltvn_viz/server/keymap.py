"""The key bindings for the page's script and its help: keys for directions while held, and those of wishes.

Owns no behaviour: the script sends directions and actions; the driver's seat and the session execute them.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

from ltvn_viz.wishes.wish_table import Action


class Direction(StrEnum):
    """Direction in which a held input drives the robot."""

    FORWARD = "forward"
    BACKWARD = "backward"
    LEFT = "left"
    RIGHT = "right"


class HeldKeys(NamedTuple):
    """Keys that drive the robot in one direction while they are held."""

    codes: tuple[str, ...]
    help: str


DIRECTION_KEYS: Mapping[Direction, HeldKeys] = {
    Direction.FORWARD: HeldKeys(("KeyW", "ArrowUp"), "drive forward while held"),
    Direction.BACKWARD: HeldKeys(("KeyS", "ArrowDown"), "back up while held"),
    Direction.LEFT: HeldKeys(("KeyA", "ArrowLeft"), "turn left while held"),
    Direction.RIGHT: HeldKeys(("KeyD", "ArrowRight"), "turn right while held"),
}
SLOW_HELP = (("Shift",), "drive slowly while held")
KEY_LABELS = {
    "ArrowUp": "↑",
    "ArrowDown": "↓",
    "ArrowLeft": "←",
    "ArrowRight": "→",
    "Escape": "Esc",
    "Backspace": "⌫",
    "Period": ".",
    "BracketLeft": "[",
    "BracketRight": "]",
    "Semicolon": ";",
    "Quote": "'",
    "Minus": "-",
    "Equal": "=",
}


def key_label(action: Action) -> str:
    """Return the label of an action's key; empty if it has none."""
    return us_cap(action.wish.key)


def help_rows() -> tuple[tuple[tuple[str, ...], str], ...]:
    """Return (key codes, description) of every binding, in the order of the help."""
    held = [(keys.codes, keys.help) for keys in DIRECTION_KEYS.values()]
    return (*held, SLOW_HELP, *(((row.wish.key,), row.wish.help) for row in Action if row.wish.key))


def us_caps() -> dict[str, str]:
    """Return the label of each bound key on a US keyboard, for pages that do not know the keyboard's layout."""
    codes = [code for row, _ in help_rows() for code in row if row != SLOW_HELP[0]]
    return {code: us_cap(code) for code in codes}


def us_cap(code: str) -> str:
    """Return the label of a key on a US keyboard."""
    return KEY_LABELS.get(code, code.removeprefix("Key"))


def direction_codes() -> dict[str, str]:
    """Return the script's table of held keys: code -> direction."""
    return {code: direction.value for direction, keys in DIRECTION_KEYS.items() for code in keys.codes}


def action_codes() -> dict[str, str]:
    """Return the script's table of pressed keys: code -> action."""
    return {action.wish.key: action.value for action in Action if action.wish.key}
