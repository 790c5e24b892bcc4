"""What is printed never steers the terminal: texts of recordings and names of files may hold control characters.

An escape sequence can rename the window, write to the clipboard, or hide what stands before it.
"""

import logging
import re

_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f"  # Control characters but tabs and line ends.
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # What turns the direction of writing.
    "\u2028\u2029]"
)


def shown_plainly(text: str) -> str:
    r"""Return a text with each character that steers a terminal written as Python writes it, such as \x1b."""
    return _UNSAFE.sub(lambda found: found.group().encode("unicode_escape").decode("ascii"), text)


class PlainFormatter(logging.Formatter):
    """Formats records of a log as lines that do not steer a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        return shown_plainly(super().format(record))
