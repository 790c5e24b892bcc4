"""The top of the page: status of the app, its health, a hint about the next step, and messages.

A message is first shown as a notification; a problem remains in the panel. Owns the thresholds between the states of
the app's health.
"""

import math
import re
import time
from collections.abc import Callable, Iterable
from enum import StrEnum
from html import escape

import viser

from ltvn_core.navigation.events import Severity
from ltvn_core.robots.link_report import LinkQuality, LinkReport
from ltvn_core.terminal_text import count_text
from ltvn_viz.panels.html_widgets import STYLE, ActionButton, HtmlBlock, button_row, filled_bar, with_keys
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import JobProgress, Message, Snapshot
from ltvn_viz.wishes.modes import Mode
from ltvn_viz.wishes.wish_table import Action

TITLES = {Severity.INFO: "Note", Severity.WARN: "Not now", Severity.ERROR: "Problem"}
COLOURS = {Severity.INFO: (34, 139, 230), Severity.WARN: (250, 176, 5), Severity.ERROR: (250, 82, 82)}
SECONDS = {Severity.INFO: 8.0, Severity.WARN: 12.0, Severity.ERROR: 20.0}
"""Duration of a notification in seconds, long enough to read it; a problem is shown in the panel afterwards."""


class Notifications:
    """Shows each message once, as soon as a page is open."""

    def __init__(self, clients: Callable[[], Iterable[viser.ClientHandle]]) -> None:
        """Notify the pages that `clients` returns when a message is shown."""
        self._clients = clients
        self._shown_number = 0

    def show(self, snapshot: Snapshot) -> None:
        """Show the message of the snapshot if it is new."""
        message = snapshot.message
        if message is None or message.number == self._shown_number:
            return
        clients = [*self._clients()]
        if not clients:
            return  # The next page that opens shows it.
        self._shown_number = message.number
        for client in clients:
            client.add_notification(
                message.title or TITLES[message.severity],
                message.text,
                auto_close_seconds=SECONDS[message.severity],
                color=COLOURS[message.severity],
            )


AFTERWARDS_S = 20.0
"""Time in seconds for which the last caption stays after the end of a story."""


class StoryBar:
    """The caption of the running story, in a bar at the foot of the map."""

    def __init__(self, gui: viser.GuiApi, clock: Callable[[], float] = time.monotonic) -> None:
        """Add the caption; the page's script copies it to the bar."""
        self.caption = HtmlBlock(gui)
        self._clock = clock
        self._told_at = float("-inf")
        self._told: tuple[str, ...] = ()

    def show(self, snapshot: Snapshot) -> None:
        """Show the story's latest caption, also for a while after the story's end."""
        if snapshot.story != self._told:
            self._told = snapshot.story
            self._told_at = self._clock()
        is_on = bool(snapshot.story) and (snapshot.story_goes_on or self._clock() < self._told_at + AFTERWARDS_S)
        text = escape(snapshot.story[-1]) if is_on else ""
        self.caption.show(f'<div class="ltvn-elsewhere" data-ltvn-copy="story">{text}</div>')


REFRESH_S = 0.5
"""Interval between updates of the numbers, in seconds, so that they can be read."""

PANEL_MARK = "<i data-ltvn-panel></i>"
"""Element by which the page's script and style find viser's panel."""

_WATCHING = (
    '<div class="lt ltvn-watching-only"><div class="lt-card" data-severity="WARN">'
    "Another page drives; this one only watches. You can look around and stop the robot."
    f"{button_row(ActionButton(Action.TAKE_OVER))}</div></div>"
)
"""Card that a page shows while it does not have the seat."""

_GO_ON = button_row(
    ActionButton(Action.PAUSE, "Go on", hint="let the robot drive on to its goal", is_main=True),
    ActionButton(Action.CANCEL, "Cancel the query"),
)
_END_ACTION = button_row(
    ActionButton(Action.END_ACTION, "Done", hint="the robot stands where the action ends", is_main=True, target=1),
    ActionButton(Action.END_ACTION, "It failed", hint="let the robot plan another way", target=0),
    ActionButton(Action.CANCEL, "Cancel the query"),
)
SLOW_HZ, TROUBLE_HZ = 20.0, 5.0
"""Loop rates in Hz below which the app counts as slow, or as in trouble; the normal rate is 30 Hz."""
OLD_MS, TOO_OLD_MS = 400.0, 2000.0
"""Ages of the picture on show in milliseconds above which it counts as old, or as too old."""


class StatusPanel:
    """Status line, hint, progress of jobs, and problems."""

    def __init__(self, gui: viser.GuiApi, clock: Callable[[], float] = time.monotonic) -> None:
        """Add the lines at the top of the main panel."""
        gui.add_html(STYLE + PANEL_MARK)
        gui.add_html(_WATCHING)
        self.line = HtmlBlock(gui)
        self.hint = HtmlBlock(gui)
        self.reply = HtmlBlock(gui)
        self.message = HtmlBlock(gui)
        self._clock = clock
        self._shown: tuple[object, ...] = ()
        self._due = float("-inf")
        self._latest: Message | None = None
        self._since = 0.0

    def show(self, snapshot: Snapshot) -> None:
        """Show mode and hint at once, numbers twice a second."""
        state = (snapshot.mode, snapshot.recording.name)
        if state != self._shown or self._clock() >= self._due:
            self._shown = state
            self._due = self._clock() + REFRESH_S
            self.line.show(_line(snapshot))
        self.hint.show(_hint(snapshot) if snapshot.work is None else _work(snapshot.work, snapshot.hint))
        self.reply.show(_GO_ON if snapshot.pause_notice else _END_ACTION if snapshot.waiting is not None else "")
        self.message.show(self._unread(snapshot.message))

    def _unread(self, message: Message | None) -> str:
        if message != self._latest:
            self._latest = message
            self._since = self._clock()
        # The notification comes first; afterwards it is listed as an open problem.
        if message is None or message.severity is not Severity.ERROR:
            return ""
        if self._clock() <= self._since + SECONDS[Severity.ERROR]:
            return ""
        card = f'<div class="lt-card" data-severity="{message.severity}">{escape(message.text)}</div>'
        return f'<div class="lt" role="alert">{card}</div>'


_NAMED_TAB = re.compile("“(Drive|Go|World|Replay|Why)”")


def first_tab(snapshot: Snapshot) -> str:
    """Return the initial tab of a page, as an attribute; nothing while the view is still about to change."""
    if not snapshot.hint or snapshot.work is not None:
        return ""
    named = _NAMED_TAB.search(snapshot.hint)
    tab = "Drive" if named is None else named[1]
    if snapshot.mode is Mode.REPLAY and snapshot.inspection.question != QuestionName.FIRST:
        tab = "Why"  # A recording opened with a question should show the answer.
    return f' data-ltvn-tab="{tab}"'


def _line(snapshot: Snapshot) -> str:
    recording = snapshot.recording
    mode = f'<span class="lt-mode" data-mode="{snapshot.mode}">{snapshot.mode}</span>'
    parts = [f'<span data-ltvn-copy="mode">{mode}</span>']
    parts.append(health_button(snapshot))
    if snapshot.link is not None:
        parts.append(link_line(snapshot.link))
    if recording.name is not None:
        badge = f'<span data-ltvn-copy="rec">{rec_badge(recording.seconds)}</span>'
        parts.append(f"{badge}<span>{count_text(recording.frames, 'image')}</span>")
    else:
        parts.append('<span data-ltvn-copy="rec"></span>')
    return f'<div class="lt" role="status"><div class="lt-line">{"".join(parts)}</div>{health_numbers(snapshot)}</div>'


def rec_badge(seconds: float) -> str:
    """Return the red badge of a running recording, with its length."""
    minutes, rest = divmod(int(seconds), 60)
    return f'<span class="lt-rec">REC {minutes}:{rest:02d}</span>'


def _hint(snapshot: Snapshot) -> str:
    # On a phone an open tab hides the map, which the next step may be a click on.
    on_map = " data-ltvn-scene" if snapshot.hint.startswith("Click ") else ""
    return (
        f'<div class="lt lt-hint"{first_tab(snapshot)}{on_map}>'
        '<div class="lt-card"><strong>Next:</strong> '
        f'<span data-ltvn-copy="hint">{with_keys(snapshot.hint)}</span></div></div>'
    )


def _work(work: JobProgress, hint: str) -> str:
    """Return the progress of a job; it takes the place of the hint, so that nothing below moves."""
    bar = "" if work.share is None else filled_bar(work.share, work.label)
    card = f'<div class="lt-card" data-severity="INFO">{escape(work.label)}…{_how_far(work)}{bar}</div>'
    return (
        f'<div class="lt lt-work" role="status">{card}'
        f'<span class="ltvn-elsewhere" data-ltvn-copy="hint">{with_keys(hint)}</span></div>'
    )


def _how_far(work: JobProgress) -> str:
    if work.share is not None:
        return f" {work.images:,} of {work.of_images:,} images, {100 * work.share:.0f} %"
    return f" {count_text(work.images, 'image')} so far" if work.images else ""


class Health(StrEnum):
    """State of the app's health."""

    GOOD = "Good"
    SLOW = "Slow"
    TROUBLE = "Trouble"


def health_of(snapshot: Snapshot) -> tuple[Health, str]:
    """Return the health of the app and the reason, judged by its own failures, its delays and the link to the robot."""
    rates = snapshot.rates
    message = snapshot.message
    if message is not None and message.is_trouble:
        return Health.TROUBLE, message.text
    if snapshot.link is not None and snapshot.link.quality is LinkQuality.LOST:
        return Health.TROUBLE, "The robot does not answer, so it is stopped."
    age_ms = 0 if snapshot.drive_is_over else rates.frame_age_ms
    is_measured = rates.loop_hz > 0
    if is_measured and rates.loop_hz < TROUBLE_HZ:
        return Health.TROUBLE, "The computer is far too busy: the app reads the robot's state too seldom."
    if age_ms > TOO_OLD_MS:
        return Health.TROUBLE, f"The camera image is {age_ms / 1000:.0f} s old."
    if is_measured and rates.loop_hz < SLOW_HZ:
        return Health.SLOW, "The computer is busy; the page is updated less often."
    if age_ms > OLD_MS:
        return Health.SLOW, f"The camera image is {age_ms / 1000:.1f} s old."
    if snapshot.link is not None and snapshot.link.quality is LinkQuality.WEAK:
        return Health.SLOW, "The link to the robot is weak: images are few, late or lost."
    return Health.GOOD, "Everything keeps up."


def health_button(snapshot: Snapshot) -> str:
    """Return the app's health as a button that shows and hides the numbers."""
    health, reason = health_of(snapshot)
    return (
        f'<button type="button" class="lt-health" data-health="{health}" data-ltvn-toggle="numbers" '
        f'title="{escape(reason)} Click for the numbers.">{health}</button>'
    )


def link_line(link: LinkReport) -> str:
    """Return a short description of the link."""
    parts = [f"link <b>{link.quality}</b>", f"picture {_age(link.picture_age_s)}"]
    parts.append(f"odometry {_age(link.odometry_age_s)}")
    if link.battery is not None:
        parts.append(f"battery <b>{link.battery:.0%}</b>")
    return f'<span class="lt-link">{" · ".join(parts)}</span>'


def _age(seconds: float) -> str:
    return f"<b>{seconds:.1f}</b> s" if math.isfinite(seconds) else "<b>none</b>"


def _link_rows(link: LinkReport | None) -> tuple[tuple[str, str], ...]:
    if link is None:
        return ()
    return (
        ("link to the robot", str(link.quality) if link.is_connected else "broken"),
        ("images from the robot", f"{link.pictures_hz:.0f} a second, {link.lost_share:.0%} got lost"),
        ("not driven because", link.stopped_because or link.restrained_because or "–"),
    )


def health_numbers(snapshot: Snapshot) -> str:
    """Return the numbers, which the page hides until a person opens them."""
    rates = snapshot.rates
    rows = (
        ("reads of the robot's state", f"{rates.loop_hz:.0f} times a second"),
        ("age of the camera image", f"{rates.frame_age_ms:.0f} ms"),
        ("images skipped for newer ones", f"{rates.dropped:,}"),
        ("images are compared by", snapshot.weights or "–"),
        *_link_rows(snapshot.link),
    )
    cells = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows)
    return f'<dl class="lt-numbers">{cells}</dl>'
