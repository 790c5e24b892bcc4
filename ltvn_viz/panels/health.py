"""How well the app keeps up, as one word with its reason; the numbers behind it are for whoever asks.

Owns the limits between the words.
"""

import math
from enum import StrEnum
from html import escape
from typing import NamedTuple

from ltvn_core.navigation.events import Severity
from ltvn_core.robots.link_report import LinkQuality, LinkReport
from ltvn_viz.session.snapshot import Snapshot

SLOW_HZ, TROUBLE_HZ = 20.0, 5.0
"""The loop runs at 30 Hz where the machine keeps up."""
OLD_MS, TOO_OLD_MS = 400.0, 2000.0
"""Age of the picture on show."""


class Health(StrEnum):
    """How well it goes."""

    GOOD = "Good"
    SLOW = "Slow"
    TROUBLE = "Trouble"


class HealthReport(NamedTuple):
    """A word and why."""

    health: Health
    reason: str


def health_of(snapshot: Snapshot) -> HealthReport:
    """Return how well the app keeps up."""
    rates, message = snapshot.rates, snapshot.message
    if message is not None and message.severity is Severity.ERROR:
        return HealthReport(Health.TROUBLE, f"The last message is an error: {message.text}")
    if snapshot.link is not None and snapshot.link.quality is LinkQuality.LOST:
        return HealthReport(Health.TROUBLE, "The robot is not heard, so it stands.")
    is_measured = rates.loop_hz > 0
    if is_measured and rates.loop_hz < TROUBLE_HZ:
        return HealthReport(Health.TROUBLE, "The computer is far too busy: the app looks at the robot too seldom.")
    if rates.frame_age_ms > TOO_OLD_MS:
        return HealthReport(Health.TROUBLE, f"The camera picture is {rates.frame_age_ms / 1000:.0f} s old.")
    if is_measured and rates.loop_hz < SLOW_HZ:
        return HealthReport(Health.SLOW, "The computer is busy; the page shows less often what happens.")
    if rates.frame_age_ms > OLD_MS:
        return HealthReport(Health.SLOW, f"The camera picture is {rates.frame_age_ms / 1000:.1f} s old.")
    if snapshot.link is not None and snapshot.link.quality is LinkQuality.WEAK:
        return HealthReport(Health.SLOW, "The link to the robot is weak: pictures are few, late or get lost.")
    return HealthReport(Health.GOOD, "Everything keeps up.")


def health_button(snapshot: Snapshot) -> str:
    """Return the word as a button that shows and hides the numbers."""
    report = health_of(snapshot)
    return (
        f'<button type="button" class="lt-health" data-health="{report.health}" data-ltvn-toggle="numbers" '
        f'title="{escape(report.reason)} Click for the numbers.">{report.health}</button>'
    )


def link_line(link: LinkReport) -> str:
    """Return the link in a few quiet words."""
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
        ("pictures from the robot", f"{link.pictures_hz:.0f} a second, {link.lost_share:.0%} got lost"),
        ("not driven because", link.stopped_because or "–"),
    )


def health_numbers(snapshot: Snapshot) -> str:
    """Return the numbers, which the page hides until somebody asks for them."""
    rates = snapshot.rates
    rows = (
        ("looks at the robot", f"{rates.loop_hz:.0f} times a second"),
        ("age of the camera picture", f"{rates.frame_age_ms:.0f} ms"),
        ("pictures left out for newer ones", f"{rates.dropped:,}"),
        ("images are compared by", snapshot.weights or "–"),
        *_link_rows(snapshot.link),
    )
    cells = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows)
    return f'<dl class="lt-numbers">{cells}</dl>'
