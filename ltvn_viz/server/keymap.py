"""What each key does, for the page's script and its help: directions while held, and the keys of `WISHES`.

Owns no behaviour: the script sends directions and actions, the driver's seat and the session carry them out.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

from ltvn_viz.wishes.wish_table import WISHES, Action


class Direction(StrEnum):
    """Where a held input pushes the robot."""

    FORWARD = "forward"
    BACKWARD = "backward"
    LEFT = "left"
    RIGHT = "right"


class HeldKeys(NamedTuple):
    """Keys that push the robot while they are held."""

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
    """Return what is printed on the keys of an action; empty if it has none."""
    return _caps(WISHES[action].keys)


def help_rows() -> tuple[tuple[tuple[str, ...], str], ...]:
    """Return (codes of the keys, what they do) of every binding, in the order of the help."""
    held = [(keys.codes, keys.help) for keys in DIRECTION_KEYS.values()]
    return (*held, SLOW_HELP, *((wish.keys, wish.help) for wish in WISHES.values() if wish.keys))


def us_caps() -> dict[str, str]:
    """Return what a US keyboard has printed on each key that means something, for a page that knows no better."""
    codes = [code for row, _ in help_rows() for code in row if row != SLOW_HELP[0]]
    return {code: us_cap(code) for code in codes}


def us_cap(code: str) -> str:
    """Return what is printed on a key of a US keyboard."""
    return KEY_LABELS.get(code, code.removeprefix("Key"))


def direction_codes() -> dict[str, str]:
    """Return the script's table of held keys: code -> direction."""
    return {code: direction.value for direction, keys in DIRECTION_KEYS.items() for code in keys.codes}


def action_codes() -> dict[str, str]:
    """Return the script's table of pressed keys: code -> action."""
    return {code: action.value for action, wish in WISHES.items() for code in wish.keys}


def _caps(codes: tuple[str, ...]) -> str:
    """Return what is printed on keys, for instance `W or ↑`."""
    return " or ".join(map(us_cap, codes))
