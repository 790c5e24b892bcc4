"""Reads a number that a person typed."""

import math

from ltvn_core.errors import OptionError


def parse_number(word: str, text: str, what: str) -> float:
    """Read one word of a typed text as a finite number. Raises OptionError, which says that the text is `what`."""
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise OptionError(f"{text[:60]!r} is {what}: {word[:20]!r} is not a number; write for instance 0.5.")
    return number
