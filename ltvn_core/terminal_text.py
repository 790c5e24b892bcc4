"""Text from and for people: unknown names, numbers, counts, and printed text without control characters.

Texts of recordings and names of files may contain control characters. An escape sequence can rename the window, write
to the clipboard, or hide the text before it.
"""

import logging
import math
import re
from collections.abc import Iterable
from difflib import get_close_matches

from ltvn_core.errors import OptionError
from ltvn_core.readable_text import readable


def which_name(typed: str, names: Iterable[str]) -> str:
    """Return `Did you mean demo? Choose one of: …`; without a similar name, only the second sentence."""
    known = [*names]
    close = get_close_matches(typed.lower(), known, n=1)
    guess = f"Did you mean {close[0]}? " if close else ""
    return f"{guess}Choose one of: {', '.join(known)}"


def count_text(count: int, thing: str, things: str = "") -> str:
    """Return a number of things as text, such as "3 edges"; `things` is the plural if it does not only add an s."""
    return f"{count:,} {thing if count == 1 else things or f'{thing}s'}"


def parse_number(word: str, text: str, what: str) -> float:
    """Read one word of a typed text as a finite number. Raises OptionError, which says that the text is `what`."""
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise OptionError(f"{text[:60]!r} is {what}: {word[:20]!r} is not a number; write for instance 0.5.")
    return number


_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # Control characters except tabs and line ends.
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # Characters that change the direction of writing.
    "\u2028\u2029]"
)


def shown_plainly(text: str) -> str:
    r"""Return a readable text in which each control character is written as a Python escape, such as \x1b."""
    return _UNSAFE.sub(lambda found: found.group().encode("unicode_escape").decode("ascii"), readable(text))


class PlainFormatter(logging.Formatter):
    """Formats log records as lines without control characters."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a log record."""
        return shown_plainly(super().format(record))
