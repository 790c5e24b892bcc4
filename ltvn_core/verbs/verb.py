"""Common parts of all verbs: the options of every verb and the format of a summary. Contains no job."""

import json
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, fields, is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Protocol

from ltvn_core.errors import OptionError, PluginError
from ltvn_core.verbs.outputs import SummaryFile, require_outputs

FLAT = {"flat": True}
"""Metadata of a summary's field whose own fields are shown in its place, such as the metrics of a test."""
_SENTENCE = 60
"""Length above which the texts of a list are sentences, each on a line of its own."""
_LABELS = {"findings": "doubts"}
"""Labels that differ from the name of the field: findings are shown as "doubts", like their sentences in JSON."""
_LARGEST = 2**62
"""Greatest integer; larger ones overflow in some libraries."""
_MOST = {"queries": 1_000_000, "episodes": 1_000_000, "goals": 100_000, "loops": 10_000, "processes": 10_000}
"""Greatest value of each option, about ten years of driving; more would only fill the memory before the run begins."""
_LAST_PORT = 65535


class Summary(Protocol):
    """The result of a verb: a frozen dataclass of plain values, for people and for programs."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


class OwnWords(ABC):
    """A summary with its own text and JSON format, such as an answer, instead of a list of fields."""

    @abstractmethod
    def as_text(self) -> str:
        """Return the text for a person; empty if there is nothing to print."""

    @abstractmethod
    def as_json(self) -> dict[str, Any]:
        """Return the JSON object for a program."""


@dataclass(frozen=True)
class Unreadable:
    """A file about which there is nothing but an error."""

    recording: Path
    failure: str


@dataclass(frozen=True)
class Summaries:
    """Summaries of several files: a block of text each, and in JSON a list."""

    parts: tuple[Summary, ...]

    @property
    def failed(self) -> bool:
        """Whether one of the files cannot be read."""
        return any(isinstance(part, Unreadable) for part in self.parts)


@dataclass(frozen=True, kw_only=True)
class Verb:
    """Base class of all verbs, with the common options.

    It imports no large library, so that help is shown at once.
    """

    job: ClassVar[str] = ""
    """Function that runs the job with the options, as `package.module:function`, if a class does not override `run`."""

    json: SummaryFile | None = None
    """Write a machine-readable summary to this file; - is standard output."""
    debug: bool = False
    """Show the traceback of an error before its message; the environment variable LTVN_DEBUG does the same for every
    verb."""

    def check_options(self) -> None:
        """Raise LtvnError for impossible numbers and outputs; the command line calls this before `run`."""
        for field in fields(self):
            value = getattr(self, field.name)
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, int) and not isinstance(number, bool):
                    _check_number(field.name, number)
        require_outputs(self)

    def run(self) -> Summary:
        """Run the job and return its summary. Raises LtvnError."""
        module, _, function = self.job.partition(":")
        return getattr(import_module(module), function)(self)

    def exit_code(self, summary: Summary) -> int:
        """Return the exit code for a summary: 0, unless the verb checks something that can fail."""
        return 0


def _check_number(name: str, number: int) -> None:
    if name == "port" and not 0 <= number <= _LAST_PORT:
        raise OptionError(f"--port must be from 1 to {_LAST_PORT}, or 0 for any free one, got {number!s:.40}.")
    most = _MOST.get(name, _LARGEST)
    option = "--" + name.replace("_", "-")
    if name == "seed" and number < 0:
        raise OptionError(f"{option} must be 0 or more, got {number}.")
    if abs(number) > most:
        raise OptionError(f"{option} must be at most {most:,}, got {number!s:.40}.")


def require_summary(verb: Verb, found: object) -> Summary:
    """Return what a verb returned. Raises PluginError if it is neither a dataclass object nor has its own words."""
    if isinstance(found, OwnWords) or (is_dataclass(found) and not isinstance(found, type)):
        return found  # type: ignore[return-value]
    source = verb.job or f"{type(verb).__module__}:{type(verb).__qualname__}.run"
    raise PluginError(
        f"{source} returned {found!r:.60} ({type(found).__name__}); a verb returns an object of a dataclass, whose "
        "fields are its result, or of a class below ltvn_core.verbs.verb.OwnWords."
    )


def to_json(summary: Summary) -> str:
    """Return a summary as JSON; paths and enums become text, and findings also appear as complete sentences in
    `doubts`."""
    return json.dumps(_json_value(summary), default=_plain, indent=2)


def _json_value(summary: Summary) -> object:
    if isinstance(summary, Summaries):
        return [_json_value(part) for part in summary.parts]
    if isinstance(summary, OwnWords):
        return summary.as_json()
    doubts = getattr(summary, "doubts", None)
    told = {} if doubts is None else {"doubts": doubts}
    return _rows(summary) | told


def _rows(summary: Summary) -> dict[str, Any]:
    """Return the values of a summary by name; those of a flat field stand in its place."""
    rows: dict[str, Any] = {}
    for field in fields(summary):
        value = getattr(summary, field.name)
        rows |= _rows(value) if field.metadata == FLAT else {field.name: value}
    return rows


def to_text(summary: Summary) -> str:
    """Return a summary as aligned lines of text."""
    if isinstance(summary, Summaries):
        return "\n\n".join(map(to_text, summary.parts))
    if isinstance(summary, OwnWords):
        return summary.as_text()
    rows = {_LABELS.get(name, name): value for name, value in _rows(summary).items()}
    width = max(map(len, rows), default=0)
    return "\n".join(f"{label.replace('_', ' '):<{width}}  {_shown(value)}" for label, value in rows.items())


def _plain(value: object) -> object:
    if isinstance(value, Path | Enum):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        return value.tolist()  # type: ignore[attr-defined]
    raise PluginError(
        f"A verb's result holds {value!r:.60} ({type(value).__name__}), which JSON cannot; hold texts, numbers, lists "
        "and dataclasses instead."
    )


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3f}".rstrip("0").rstrip(".")
    if isinstance(value, dict):
        return ", ".join(f"{key} {_shown(part)}" for key, part in value.items()) or "-"
    if isinstance(value, list | tuple):
        if any(is_dataclass(part) or (isinstance(part, str) and len(part) > _SENTENCE) for part in value):
            return "".join(f"\n  {_shown(part)}" for part in value)
        return ", ".join(map(_shown, value)) or "-"
    if is_dataclass(value) and type(value).__str__ is not object.__str__:
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        parts = ((field.name.replace("_", " "), getattr(value, field.name)) for field in fields(value))
        return "(" + ", ".join(f"{name} {_shown(part)}" for name, part in parts) + ")"
    return "-" if value is None else str(value)
