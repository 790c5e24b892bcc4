"""HTML in the panels; all text from outside is escaped here.

Owns the markup of buttons and cards, and their style sheet.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from ltvn_core import palette
from ltvn_viz.server.keymap import key_label
from ltvn_viz.wishes.modes import Mode
from ltvn_viz.wishes.wish_table import Action

if TYPE_CHECKING:
    import viser

REACHED_BY_TAB = 'role="button" tabindex="0"'
"""Makes an element with an action reachable by keyboard, as a button is; Enter presses it."""

STYLE = f"""<style>
.lt {{ padding: .3em .75em; font-size: .8125rem; line-height: 1.45; }}
.lt-line {{ display: flex; flex-wrap: wrap; gap: .3em .9em; align-items: center; color: var(--ltvn-soft); }}
.lt-line b {{ color: var(--ltvn-strong); font-weight: 600; font-variant-numeric: tabular-nums; }}
.lt-mode {{ padding: .05em .7em; border-radius: 1em; color: #fff; font-weight: 600; background: #495057; }}
.lt-mode[data-mode="navigating"] {{ background: #1864ab; }}
.lt-mode[data-mode="paused"], .lt-mode[data-mode="building"] {{ background: #845d00; }}
.lt-mode[data-mode="replay"] {{ background: #5f3dc4; }}
.lt-rec {{ padding: .05em .6em; border-radius: .3em; background: #c92a2a; color: #fff; font-weight: 700;
  font-variant-numeric: tabular-nums; white-space: nowrap; }}
.lt-rec::before {{ content: "● "; animation: lt-rec 1.4s steps(2, jump-none) infinite; }}
@keyframes lt-rec {{ to {{ opacity: .25; }} }}
@media (prefers-reduced-motion: reduce) {{ .lt-rec::before {{ animation: none; }} }}
.lt-health {{ padding: .1em .7em; border: 1px solid; border-radius: 1em; background: none; font: inherit;
  font-weight: 600; color: var(--ltvn-good); cursor: pointer; }}
.lt-health[data-health="Slow"] {{ color: var(--ltvn-fair); }}
.lt-health[data-health="Trouble"] {{ color: var(--ltvn-bad); }}
.lt-health[data-health="Good"]::before {{ content: "✓ "; }}
.lt-health:not([data-health="Good"])::before {{ content: "! "; }}
.lt-numbers {{ display: none; grid-template-columns: auto 1fr; gap: 0 .8em; margin: .4em 0 0;
  color: var(--ltvn-soft); }}
[data-ltvn-numbers] .lt-numbers {{ display: grid; }}
.lt-numbers dd {{ margin: 0; color: var(--ltvn-strong); }}
.lt-words {{ padding: 0; border: 0; background: none; font: inherit; color: var(--ltvn-link);
  text-decoration: underline; cursor: pointer; }}
.lt-term {{ text-decoration: underline dotted; cursor: help; }}
.lt-wait div {{ width: 30%; animation: lt-wait 1.2s ease-in-out infinite alternate; }}
@keyframes lt-wait {{ from {{ margin-left: 0; }} to {{ margin-left: 70%; }} }}
@media (prefers-reduced-motion: reduce) {{ .lt-wait div {{ animation: none; width: 100%; opacity: .5; }} }}
.lt-card {{ padding: .5em .75em; border-radius: .5em; background: rgba(56,139,253,.13);
  border-left: 3px solid {palette.ACCENT.css}; color: var(--ltvn-text); overflow-wrap: anywhere; }}
.lt-card[data-severity="WARN"] {{ background: rgba(250,176,5,.12); border-color: #fab005; }}
.lt-card[data-severity="ERROR"] {{ background: rgba(250,82,82,.14); border-color: #fa5252; }}
.lt-card[data-severity="INFO"] {{ background: var(--ltvn-tint); border-color: #868e96; }}
.lt-hint .lt-card, .lt-work .lt-card {{ min-height: 3.9em; }}
.lt-card strong {{ color: var(--ltvn-strong); }}
.lt-note {{ color: var(--ltvn-soft); }}
.lt-buttons {{ display: flex; flex-wrap: wrap; gap: .4em; }}
.lt-buttons button {{ flex: 1 1 auto; padding: .5em .8em; border: 0; border-radius: .35em; font: inherit;
  font-weight: 600; background: var(--ltvn-button); color: var(--ltvn-strong); cursor: pointer; white-space: nowrap; }}
.lt-buttons button:hover:enabled {{ background: var(--ltvn-button-more); }}
.lt-buttons button:disabled {{ opacity: .38; cursor: default; }}
.lt-buttons button.lt-main {{ background: #1c6fd6; color: #fff; }}
.lt-buttons button.lt-main:hover:enabled {{ background: #2f81e8; }}
.lt-buttons kbd {{ margin-left: .45em; padding: 0 .4em; border-radius: .25em; background: rgba(0,0,0,var(--ltvn-cap));
  color: inherit; font: .8125rem/1.5 ui-monospace, monospace; font-weight: 400; }}
.lt-bar {{ height: .4em; margin-top: .45em; border-radius: .2em; background: var(--ltvn-tint-more); overflow: hidden; }}
.lt-toggle {{ padding: 0; border: 0; background: none; font: inherit; color: var(--ltvn-text); cursor: pointer; }}
.lt-toggle::before {{ content: ""; display: inline-block; width: 1.8em; height: 1em; margin-right: .6em;
  border-radius: 1em; vertical-align: -.12em;
  background: radial-gradient(circle at .5em, #f1f3f5 .36em, #495057 .4em); }}
.lt-toggle[aria-checked="true"]::before {{
  background: radial-gradient(circle at 1.3em, #fff .36em, #1c6fd6 .4em); }}
.lt-bar div {{ height: 100%; background: #1c6fd6; transition: width .4s; }}
.lt-gallery {{ display: grid; grid-template-columns: repeat(3, 1fr); gap: .4em; }}
.lt-gallery img {{ width: 100%; aspect-ratio: 4/3; display: block; border-radius: .35em;
  border: 2px solid transparent; }}
.lt-gallery img:hover {{ border-color: #4dabf7; }}
.lt-gallery img.lt-chosen {{ border-color: {palette.GOAL.css}; }}
.lt h2 {{ margin: 0 0 .3em; font-size: .8125rem; font-weight: 600; color: var(--ltvn-strong); }}
.lt-upload {{ display: grid; grid-template-columns: 2fr 3fr; gap: .75em; }}
.lt-upload > div > img {{ width: 100%; display: block; border-radius: .35em; }}
.lt-upload .lt-gallery {{ grid-template-columns: repeat(2, 1fr); }}
.lt-gallery figure {{ margin: 0; }}
.lt-gallery .lt-none {{ background: var(--ltvn-tint); }}
.lt-gallery figcaption {{ color: var(--ltvn-soft); font-size: .8125rem; line-height: 1.3; }}
.lt-table {{ display: grid; grid-template-columns: repeat(4, 1fr); gap: .1em .5em; }}
.lt-table div {{ display: flex; flex-direction: column; }}
.lt-table b {{ font-size: 1.15em; color: var(--ltvn-strong); font-weight: 600; font-variant-numeric: tabular-nums; }}
.lt-table span {{ color: var(--ltvn-soft); }}
.lt-asks {{ display: flex; flex-wrap: wrap; gap: .3em; }}
.lt-asks details {{ display: contents; }}
.lt-question, .lt-asks summary {{ padding: .35em .6em; border: 0; border-radius: .35em; background: var(--ltvn-tint);
  color: var(--ltvn-text); font: inherit; text-align: left; list-style: none; cursor: pointer; }}
.lt-question:hover, .lt-asks summary:hover {{ background: var(--ltvn-tint-more); }}
.lt-question[aria-pressed="true"] {{ background: #1c6fd6; color: #fff; }}
.lt-asks details .lt-question {{ width: 100%; margin-top: .3em; }}
.lt-asks details b {{ display: block; }}
.lt-next {{ margin: .3em .3em .3em 0; padding: .5em .8em; border: 0; border-radius: .35em; background: #1c6fd6;
  color: #fff; font: inherit; font-weight: 600; cursor: pointer; }}
.lt-next:hover {{ background: #2f81e8; }}
.lt-why > div {{ margin: .25em 0; color: var(--ltvn-text); }}
.lt-dot {{ padding: 0 .25em; border-radius: .35em; }}
.lt-dot i {{ font-style: normal; }}
.lt-link {{ color: var(--ltvn-link); cursor: pointer; text-decoration: underline; }}
.lt-whole {{ white-space: nowrap; }}
.lt-pair {{ display: flex; gap: .4em; }}
.lt-why figure {{ flex: 1; margin: 0; }}
.lt-why figure img, .lt-none {{ width: 100%; aspect-ratio: 4/3; border-radius: .35em; display: block; }}
.lt-none {{ background: var(--ltvn-button); color: var(--ltvn-soft); text-align: center; }}
.lt-why figcaption {{ color: var(--ltvn-soft); }}
.lt-curve {{ display: block; width: 100%; margin: .25em 0; border-radius: .35em; }}
.lt-rows {{ width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }}
.lt-rows td:first-child {{ white-space: nowrap; }}
.lt code {{ overflow-wrap: anywhere; }}
.lt-rows th {{ text-align: left; color: var(--ltvn-soft); font-weight: 400; }}
.lt-rows td {{ padding: .1em .3em .1em 0; border-top: 1px solid var(--ltvn-edge); vertical-align: top; }}
</style>"""


@dataclass(frozen=True, slots=True)
class ActionButton:
    """A button that requests an action; empty texts are taken from its row."""

    action: Action
    label: str = ""
    caps: str = ""
    """Label of the key with the same action."""
    hint: str = ""
    is_main: bool = False
    """Whether this is the button that a person most likely needs now."""
    is_enabled: bool = True
    target: int | str | None = None
    """Subject of the action, if it needs one."""

    def html(self, mode: Mode | None = None) -> str:
        """Return the button, disabled if its wish is illegal in `mode`."""
        wish = self.action.wish
        is_enabled = self.is_enabled and (mode is None or mode in wish.modes)
        kind = ' class="lt-main"' if self.is_main and is_enabled else ""
        off = "" if is_enabled else " disabled"
        caps = self.caps or key_label(self.action)
        key = f"<kbd>{escape(caps)}</kbd>" if caps else ""
        kind_of_target = "text" if isinstance(self.target, str) else "id"
        about = "" if self.target is None else f' data-{kind_of_target}="{escape(str(self.target))}"'
        return (
            f'<button type="button"{kind}{off} data-ltvn-action="{self.action}"{about} '
            f'title="{escape(self.hint or wish.help)}">{escape(self.label or wish.label)}{key}</button>'
        )


def button_row(*presses: ActionButton, mode: Mode | None = None) -> str:
    """Return a row of buttons; those whose wishes are illegal in `mode` are disabled."""
    return f'<div class="lt lt-buttons">{"".join(press.html(mode) for press in presses)}</div>'


def grey_for_watchers(elements: Iterable[str]) -> str:
    """Return a style that greys out these controls of viser on a page without the seat."""
    selectors = ", ".join(f'[data-ltvn-watching] [id="{escape(element)}"]' for element in elements)
    return f"<style>{selectors} {{ opacity: .38; filter: grayscale(1); cursor: not-allowed; }}</style>"


def toggle(action: Action, *, is_on: bool) -> str:
    """Return a switch that requests an action, with the value 1 to switch on and 0 to switch off."""
    wish = action.wish
    return (
        f'<div class="lt"><button type="button" role="switch" aria-checked="{str(is_on).lower()}" class="lt-toggle" '
        f'data-ltvn-action="{action}" data-id="{int(not is_on)}" title="{escape(wish.help)}">'
        f"{escape(wish.label)}</button></div>"
    )


def note(text: str) -> str:
    """Return a line that explains the content of a panel."""
    return f'<div class="lt lt-note">{escape(text)}</div>'


KEY_PHRASES = (
    ("W A S D or the arrow keys", "an arrow"),
    ("W A S D", "an arrow"),
    ("Space", "Stop"),
    ("press R ", "press Record "),
    (" (N)", ""),
    (" (B)", ""),
    ("Click into the timeline", "Tap the timeline"),
    ("Click ", "Tap "),
    ("click ", "tap "),
)
"""Phrases about keys and the mouse, each with its replacement for touch screens; a longer phrase comes before its
prefix."""
_KEYS = re.compile("|".join(re.escape(keys) for keys, _ in KEY_PHRASES))


def with_keys(text: str) -> str:
    """Return a text as HTML that mentions keys and clicks only on devices that have them."""
    return _KEYS.sub(_by_key_or_touch, escape(text))


def _by_key_or_touch(keys: re.Match[str]) -> str:
    touch = dict(KEY_PHRASES)[keys[0]]
    return f'<span class="ltvn-by-key">{keys[0]}</span><span class="ltvn-by-touch">{touch}</span>'


def copy_button(label: str, text: str) -> str:
    """Return a button that copies a text."""
    return f'<button type="button" class="lt-words" data-ltvn-copy-text="{escape(text)}">{escape(label)}</button>'


def lines(*texts: str) -> str:
    """Return lines of plain text; nothing if there are none."""
    return f'<div class="lt lt-note">{"<br>".join(map(escape, texts))}</div>' if texts else ""


def warning(*texts: str) -> str:
    """Return lines of plain text on a highlighted card."""
    card = f'<div class="lt-card" data-severity="WARN">{"<br>".join(map(escape, texts))}</div>'
    return f'<div class="lt" role="alert">{card}</div>'


def progress_bar(share: float, doing: str) -> str:
    """Return a progress bar that is filled to `share` in [0, 1], below the text `doing`."""
    return f'<div class="lt lt-note">{escape(doing)}… {round(100 * share)} %{filled_bar(share, doing)}</div>'


def filled_bar(share: float, doing: str) -> str:
    """Return a progress bar without text; `doing` is its label for screen readers."""
    percent = round(100 * share)
    return (
        f'<div class="lt-bar" role="progressbar" aria-valuenow="{percent}" aria-label="{escape(doing)}">'
        f'<div style="width:{percent}%"></div></div>'
    )


def number_grid(*rows: tuple[str, str]) -> str:
    """Return a grid of numbers with their labels."""
    cells = "".join(f"<div><b>{escape(number)}</b><span>{escape(name)}</span></div>" for number, name in rows)
    return f'<div class="lt"><div class="lt-table">{cells}</div></div>'


class HtmlBlock:
    """A piece of HTML in a panel that is sent again only when it changed."""

    def __init__(self, gui: "viser.GuiApi", content: str = "") -> None:
        """Add the block to the open container."""
        self._handle = gui.add_html(content)
        self.content = content

    def show(self, content: str) -> None:
        """Show `content`, in which the caller has escaped all text from outside."""
        if content != self.content:
            self._handle.content = self.content = content
