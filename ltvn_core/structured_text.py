"""Parsing of untrusted JSON and TOML; the whole package parses such texts here.

The parsers of the standard library are recursive, and so is most code that processes their results. A text of a few
kilobytes can be nested more deeply than the stack allows, so the nesting depth is limited here.
"""

import json
import re
import tomllib
from collections.abc import Callable, Iterable
from typing import Any

from ltvn_core.readable_text import readable

MOST_LEVELS = 100
"""Largest nesting depth; no file that the toolkit reads has more than a dozen levels."""
_MOST_TOML = 1_000_000
"""Largest number of characters of a TOML text; these files are written by hand, and the parser is slow."""


_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def parse_json(text: str | bytes, parse_constant: Callable[[str], Any] | None = None) -> Any:
    """Return the value of a JSON text, in which all texts are readable.

    Args:
        text: The JSON text.
        parse_constant: Function that returns the value of `NaN` or `Infinity`; a float if not given.

    Raises:
        ValueError: It is no JSON, is not in UTF-8, or lists and objects are nested too deeply.
    """
    try:
        value = json.loads(text, parse_constant=parse_constant)
    except RecursionError:
        raise _too_deep() from None
    # A recording has hundreds of thousands of short texts, and counting brackets takes a tenth of the time.
    if _brackets(text) > MOST_LEVELS:
        _require_levels(value)
    if _SURROGATE.search(text if isinstance(text, str) else text.decode("utf-8", "replace")):
        return readable_value(value)
    return value


def readable_value(value: Any) -> Any:
    """Return a value of JSON or MessagePack in which all texts are readable."""
    match value:
        case str():
            return readable(value)
        case list() | tuple():
            return [readable_value(each) for each in value]
        case dict():
            return {readable_value(name): readable_value(each) for name, each in value.items()}
        case _:
            return value


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables in a TOML text.

    Raises:
        ValueError: It is no TOML, is too long, or tables and arrays are nested too deeply.
    """
    if len(text) > _MOST_TOML:
        raise ValueError(f"it has more than {_MOST_TOML:,} characters")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise _too_deep() from None
    _require_levels(tables)
    return tables


def _brackets(text: str | bytes) -> int:
    """Return an upper limit for the number of lists and objects in a text; no other UTF-8 character contains these
    bytes."""
    if isinstance(text, bytes):
        return text.count(b"[") + text.count(b"{")
    return text.count("[") + text.count("{")


def _require_levels(value: Any) -> None:
    """Raise ValueError if a value is nested too deeply; iterates over the levels, because recursion would overflow the
    stack."""
    level = _within([value])
    for _ in range(MOST_LEVELS):
        if not level:
            return
        level = [part for each in level for part in _within(each.values() if isinstance(each, dict) else each)]
    raise _too_deep()


def _within(values: Iterable[Any]) -> list[dict[str, Any] | list[Any]]:
    return [each for each in values if isinstance(each, dict | list)]


def _too_deep() -> ValueError:
    return ValueError(f"lists and tables are nested more than {MOST_LEVELS} levels deep")
