"""What all verbs share: the options of every verb and the shape of a summary. Owns no job."""

import json
from dataclasses import asdict, dataclass, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar, Protocol


class Summary(Protocol):
    """The result of a verb: a frozen dataclass of plain values, readable by a person and by a program."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Verb:
    """Base of all verbs: the options every one of them takes."""

    json: Path | None = None
    """Write a machine-readable summary to this file; - is standard output."""
    debug: bool = False
    """Show the traceback of a failure before its one line; the variable LTVN_DEBUG does it for every verb."""

    def run(self) -> Summary:
        """Do the job and return its summary."""
        raise NotImplementedError


def to_json(summary: Summary) -> str:
    """Write a summary as JSON; paths and enums become text."""
    return json.dumps(asdict(summary), default=_plain, indent=2)


def to_text(summary: Summary) -> str:
    """Write a summary as aligned lines for a person."""
    names = [field.name for field in fields(summary)]
    width = max(map(len, names), default=0)
    return "\n".join(f"{name.replace('_', ' '):<{width}}  {_shown(getattr(summary, name))}" for name in names)


def _plain(value: object) -> object:
    if isinstance(value, Path | Enum):
        return str(value)
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        return value.tolist()  # type: ignore[attr-defined]
    raise TypeError(f"a summary cannot hold {type(value).__name__}")


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3f}".rstrip("0").rstrip(".")
    if isinstance(value, dict):
        return ", ".join(f"{key} {_shown(part)}" for key, part in value.items()) or "-"
    if isinstance(value, list | tuple):
        if any(map(is_dataclass, value)):
            return "".join(f"\n  {_shown(part)}" for part in value)
        return ", ".join(map(_shown, value)) or "-"
    if is_dataclass(value) and not isinstance(value, type):
        parts = ((field.name.replace("_", " "), getattr(value, field.name)) for field in fields(value))
        return "(" + ", ".join(f"{name} {_shown(part)}" for name, part in parts) + ")"
    return "-" if value is None else str(value)
