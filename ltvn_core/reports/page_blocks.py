"""Blocks of a Markdown page that a program writes, each between two comments that name it.

Owns the comments. What stands between them comes from others.
"""

from collections.abc import Mapping
from pathlib import Path

from ltvn_core.errors import OptionError


def fill_blocks(page: Path, content: Mapping[str, str]) -> None:
    """Put each block between its two comments in a page. Raises OptionError if page or comments are missing."""
    try:
        text = page.read_text(encoding="utf-8")
        for name, block in content.items():
            text = _filled(text, name, block, page)
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OptionError(f"{page}: cannot be filled in ({error}); name another --page.") from error


def _filled(text: str, name: str, block: str, page: Path) -> str:
    begin = f"<!-- {name}: begin -->"
    end = f"<!-- {name}: end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise OptionError(f"{page}: needs the lines {begin} and {end}, once and in this order.")
    return f"{text[: text.index(begin)]}{begin}\n{block}\n{text[text.index(end) :]}"
