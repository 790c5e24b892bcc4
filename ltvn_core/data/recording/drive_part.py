"""A part of a drive by its images, for instance the first half, so that one part trains and another validates."""

import re
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

from ltvn_core.errors import OptionError

T = TypeVar("T")


class DrivePart(NamedTuple):
    """One of several equal stretches of a drive, counted from 1."""

    number: int = 1
    parts: int = 1

    def __str__(self) -> str:
        return f"{self.number}/{self.parts}"

    @property
    def is_whole(self) -> bool:
        """Tell whether it is all of the drive."""
        return self.parts == 1

    def take(self, frames: Sequence[T]) -> Sequence[T]:
        """Return those of the frames of a drive, in order, that lie in this part."""
        begin, end = ((self.number - back) * len(frames) // self.parts for back in (1, 0))
        return frames[begin:end]


WHOLE_DRIVE = DrivePart()


def parse_part(text: str) -> DrivePart:
    """Read a part such as 1/2, the first half. Raises OptionError."""
    written = re.fullmatch(r"(\d{1,4})/(\d{1,4})", text)
    part = WHOLE_DRIVE if written is None else DrivePart(int(written[1]), int(written[2]))
    if written is None or not 1 <= part.number <= part.parts:
        raise OptionError(f"--part is a stretch of the drive such as 1/2, the first half, or 3/4; got {text!r:.40}.")
    return part
