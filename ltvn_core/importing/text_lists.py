"""Lists that somebody else wrote, a row a line: trajectories, images with their times, tables of odometry.

Owns how such a text is decoded, which of its lines say something, and how many there may be.
"""

import codecs
from collections.abc import Iterator
from pathlib import Path

from ltvn_core.errors import DriveError
from ltvn_core.importing.foreign_files import read_foreign

MOST_LINES = 1_000_000
"""Nine hours at 30 images a second; a drive is imported in parts where it is longer."""
_MOST_BYTES = 100_000_000
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""With these a text begins that Windows' PowerShell wrote."""


def read_list(path: Path, what: str) -> str:
    """Return the text of a list.

    Args:
        path: The file, in UTF-8 or UTF-16.
        what: What messages call it, as "list of poses".

    Raises:
        DriveError: It cannot be read as text, or is longer than any such list.
    """
    try:
        blob = read_foreign(path, most_bytes=_MOST_BYTES, what=what)
        text = blob.decode("utf-16" if blob.startswith(_UTF_16) else "utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise DriveError(f"{path} cannot be read as text ({error!s:.120}).") from error
    if max(text.count("\n"), text.count("\r")) > MOST_LINES:
        raise DriveError(f"{path} has more than {MOST_LINES:,} lines, which no {what} has; import the drive in parts.")
    return text


def list_lines(path: Path, what: str) -> Iterator[tuple[int, str, list[str]]]:
    """Yield number, text and words of each line that is neither empty nor a comment (#); numbers begin at 1.

    White space or commas separate words. Raises DriveError as `read_list` does.
    """
    for number, line in enumerate(read_list(path, what).splitlines(), start=1):
        words = line.replace(",", " ").split()
        if words and not words[0].startswith("#"):
            yield number, line, words
