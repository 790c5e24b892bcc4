"""Arguments of a tool: names, types and bounds, as a JSON schema and as a check of each request.

Owns the check. Each value that a program sends is either valid or raises an error that says what is valid.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ltvn_core.errors import OptionError
from ltvn_core.terminal_text import which_name

LARGEST_NODE = 2**53
"""Largest number of a node; not every JSON reader represents larger integers exactly."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One argument of a tool."""

    name: str
    schema: Mapping[str, Any]
    """JSON Schema of the value, with its description."""
    read: Callable[[object], Any]
    """Function that returns the checked value; it raises ValueError with a description of valid values."""
    required: bool = False


def text(name: str, about: str, *, longest: int, required: bool = False) -> Parameter:
    """Return a parameter that takes a text."""

    def read(given: object) -> str:
        if not isinstance(given, str) or len(given) > longest:
            raise ValueError(f"a text of at most {longest} letters")
        return given

    schema = {"type": "string", "maxLength": longest, "description": about}
    return Parameter(name=name, schema=schema, read=read, required=required)


def number(name: str, about: str) -> Parameter:
    """Return a parameter that takes a number of 0 or more."""

    def read(given: object) -> float:
        if isinstance(given, bool) or not isinstance(given, int | float) or not 0 <= given <= LARGEST_NODE:
            raise ValueError("a number, 0 or more")
        return float(given)

    return Parameter(name=name, schema={"type": "number", "minimum": 0, "description": about}, read=read)


def whole(name: str, about: str, *, least: int = 0, most: int = LARGEST_NODE, required: bool = False) -> Parameter:
    """Return a parameter that takes an integer from `least` to `most`."""
    schema = {"type": "integer", "minimum": least, "maximum": most, "description": about}
    return Parameter(name=name, schema=schema, read=lambda given: _whole(given, least, most), required=required)


def edge(name: str, about: str) -> Parameter:
    """Return a parameter that takes the two nodes of an edge."""

    def read(given: object) -> tuple[int, int]:
        if not isinstance(given, list) or len(given) != 2:
            raise ValueError("two nodes, from and to, such as [12, 40]")
        return _whole(given[0], 0, LARGEST_NODE), _whole(given[1], 0, LARGEST_NODE)

    items = {"type": "integer", "minimum": 0}
    schema = {"type": "array", "items": items, "minItems": 2, "maxItems": 2, "description": about}
    return Parameter(name=name, schema=schema, read=read)


def choices(name: str, about: str, known: Sequence[str]) -> Parameter:
    """Return a parameter that takes a list of words, each of them from `known`."""

    def read(given: object) -> tuple[str, ...]:
        if not isinstance(given, list) or len(given) > len(known) or not all(each in known for each in given):
            raise ValueError(f"a list with any of these: {', '.join(known)}")
        return tuple(given)

    items = {"type": "string", "enum": list(known)}
    schema = {"type": "array", "items": items, "maxItems": len(known), "description": about}
    return Parameter(name=name, schema=schema, read=read)


def object_schema(parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Return the JSON schema of a tool's arguments."""
    return {
        "type": "object",
        "properties": {each.name: dict(each.schema) for each in parameters},
        "required": [each.name for each in parameters if each.required],
        "additionalProperties": False,
    }


def read_arguments(parameters: Sequence[Parameter], given: Mapping[str, object]) -> dict[str, Any]:
    """Return the values of the given arguments; an argument that is null counts as missing. Raises OptionError."""
    known = {each.name: each for each in parameters}
    for name in given:
        if name not in known:
            offered = f"{which_name(name[:60], known)}." if known else "This tool takes no arguments."
            raise OptionError(f"There is no argument {name[:60]!r}. {offered}")
    found = {name: _read(known[name], value) for name, value in given.items() if value is not None}
    for each in parameters:
        if each.required and each.name not in found:
            raise OptionError(f"{each.name} is missing: {each.schema['description']}")
    return found


def _read(parameter: Parameter, given: object) -> Any:
    try:
        return parameter.read(given)
    except ValueError as error:
        raise OptionError(f"{parameter.name} takes {error}; got {given!r:.60}.") from None


def _whole(given: object, least: int, most: int) -> int:
    is_whole = isinstance(given, int) or (isinstance(given, float) and math.isfinite(given) and given.is_integer())
    if isinstance(given, bool) or not is_whole or not least <= int(given) <= most:  # type: ignore[arg-type]
        raise ValueError(f"a whole number from {least} to {most}")
    return int(given)  # type: ignore[arg-type]
