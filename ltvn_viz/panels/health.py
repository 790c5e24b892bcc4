"""How well the app keeps up, as one word with its reason; the numbers behind it are for whoever asks.

Owns the limits between the words.
"""

from enum import StrEnum
from html import escape
from typing import NamedTuple

from ltvn_core.navigation.events import Severity
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
    is_measured = rates.loop_hz > 0
    if is_measured and rates.loop_hz < TROUBLE_HZ:
        return HealthReport(Health.TROUBLE, "The computer is far too busy: the app looks at the robot too seldom.")
    if rates.frame_age_ms > TOO_OLD_MS:
        return HealthReport(Health.TROUBLE, f"The camera picture is {rates.frame_age_ms / 1000:.0f} s old.")
    if is_measured and rates.loop_hz < SLOW_HZ:
        return HealthReport(Health.SLOW, "The computer is busy; the page shows less often what happens.")
    if rates.frame_age_ms > OLD_MS:
        return HealthReport(Health.SLOW, f"The camera picture is {rates.frame_age_ms / 1000:.1f} s old.")
    return HealthReport(Health.GOOD, "Everything keeps up.")


def health_button(snapshot: Snapshot) -> str:
    """Return the word as a button that shows and hides the numbers."""
    report = health_of(snapshot)
    return (
        f'<button type="button" class="lt-health" data-health="{report.health}" data-ltvn-toggle="numbers" '
        f'title="{escape(report.reason)} Click for the numbers.">{report.health}</button>'
    )


def health_numbers(snapshot: Snapshot) -> str:
    """Return the numbers, which the page hides until somebody asks for them."""
    rates = snapshot.rates
    rows = (
        ("looks at the robot", f"{rates.loop_hz:.0f} times a second"),
        ("age of the camera picture", f"{rates.frame_age_ms:.0f} ms"),
        ("pictures left out for newer ones", f"{rates.dropped:,}"),
        ("images are compared by", snapshot.weights or "–"),
    )
    cells = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows)
    return f'<dl class="lt-numbers">{cells}</dl>'
