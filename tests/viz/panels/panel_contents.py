"""What panels hold, for tests: which buttons can be pressed, how many controls there are."""

import viser

from ltvn_viz.panels.html_widgets import HtmlBlock
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Action


def nothing(_: c.Command | bytes) -> None:
    """Take a command and forget it."""


def is_enabled(html: str, action: Action) -> bool:
    """Tell whether the first button of an action can be pressed."""
    button = next(part for part in html.split("<button") if f'data-ltvn-action="{action}"' in part)
    return " disabled" not in button.split(">")[0]


def controls(*panels: object) -> int:
    """Count the buttons and boxes that panels of one tab show."""
    parts = [part for panel in panels for part in vars(panel).values()]
    shown = [part for part in parts if isinstance(part, viser.GuiInputHandle) and part.visible]
    return len(shown) + sum(part.content.count("<button") for part in parts if isinstance(part, HtmlBlock))
