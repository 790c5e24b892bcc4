"""Watches the link to a real robot, and reports in plain words when it breaks and is restored.

Owns these words. Does not stop the robot: the robot stops itself.
"""

from collections.abc import Callable
from enum import Enum, auto
from typing import NamedTuple

from ltvn_core.navigation.events import Severity
from ltvn_core.robots.link_report import LinkQuality, LinkReport


class LinkNews(NamedTuple):
    """A message about the link that a person must read."""

    text: str
    severity: Severity
    is_lost: bool


class _Phase(Enum):
    FINE = auto()
    LOST = auto()
    HELD = auto()
    """The link is restored, but the driver's input is still held down."""
    RESTRAINED = auto()
    """The guard on the robot refuses to drive forwards."""


class RobotLink:
    """The link of one robot."""

    def __init__(self, name: str, ask: Callable[[], LinkReport]) -> None:
        """Watch the robot called `name`; `ask` returns the present state of its link."""
        self._name = name
        self._ask = ask
        self._phase = _Phase.FINE
        self.report = ask()
        """The state of the link at the last look."""
        self.news: LinkNews | None = None
        """The message to show while the robot is not driven; None while the link works."""

    def look(self) -> LinkNews | None:
        """Check the link, and return news."""
        self.report = self._ask()
        before, self._phase = self._phase, self._phase_of(self.report)
        if self._phase is before:
            return None
        self.news = self._words()
        if self._phase is _Phase.FINE and before is _Phase.RESTRAINED:
            return None
        again = f"{self._name} answers again. Without a query it stands still: drive it, or choose a goal."
        return self.news or LinkNews(again, Severity.INFO, is_lost=False)

    def _phase_of(self, report: LinkReport) -> _Phase:
        if report.quality is LinkQuality.LOST:
            return _Phase.LOST
        if report.stopped_because is not None:
            return _Phase.HELD
        return _Phase.FINE if report.restrained_because is None else _Phase.RESTRAINED

    def _words(self) -> LinkNews | None:
        match self._phase:
            case _Phase.FINE:
                return None
            case _Phase.LOST:
                what = "sends no pictures" if self.report.is_connected else "does not answer: the link broke"
                text = (
                    f"{self._name} {what}. It is stopped, and the recording is kept. The link reconnects "
                    "automatically, but driving does not continue."
                )
                return LinkNews(text, Severity.ERROR, is_lost=True)
            case _Phase.HELD:
                text = f"{self._name} was stopped: {self.report.stopped_because}. Release the keys, then drive again."
                return LinkNews(text, Severity.WARN, is_lost=False)
            case _Phase.RESTRAINED:
                text = (
                    f"The guard of {self._name} refuses to drive forwards: {self.report.restrained_because}. Turn, or "
                    "drive backwards."
                )
                return LinkNews(text, Severity.WARN, is_lost=False)
