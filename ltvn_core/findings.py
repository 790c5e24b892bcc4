"""Findings: doubts about a drive, a map, a robot, a goal or a judgement, in one record type.

Owns the record and its form as sentences. The checks are in the packages of their subjects.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum


class Severity(StrEnum):
    """Severity of a note or a finding."""

    INFO = "INFO"
    WARN = "WARN"
    ERROR = "ERROR"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that the user should know; a finding does not reject or change anything."""

    text: str
    """The finding and its likely cause, in whole sentences."""
    severity: Severity = Severity.WARN
    remedy: str = ""
    """The remedy, in whole sentences; empty if `text` asks a question or if there is no remedy."""
    where: str = ""
    """Name of the drive, file, topic or goal that the finding is about; empty if it is about everything that was
    checked."""

    def __str__(self) -> str:
        """Write text and remedy as one paragraph."""
        return f"{self.text} {self.remedy}".rstrip()

    def of(self, name: str) -> "Finding":
        """Return this finding about `name`, with `name` at the beginning of its text."""
        return replace(self, text=f"{name}: {self.text}", where=name)


def findings_of(texts: Iterable[str]) -> tuple[Finding, ...]:
    """Return findings from sentences without a separate remedy, such as those of a plug-in's reader."""
    return tuple(Finding(text) for text in texts)


class WithDoubts:
    """Adds `doubts`, the findings as texts, to a class with `findings`; JSON summaries keep both."""

    __slots__ = ()
    findings: tuple[Finding, ...]

    @property
    def doubts(self) -> tuple[str, ...]:
        """The findings, one paragraph each."""
        return tuple(map(str, self.findings))
