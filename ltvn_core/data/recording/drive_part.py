"""A part of a drive, for instance the first half of its images, so that one part trains and another validates."""

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
        """Whether this part is the whole drive."""
        return self.parts == 1

    def take(self, frames: Sequence[T]) -> Sequence[T]:
        """Return the frames in this part, from all frames of a drive in order."""
        begin, end = ((self.number - back) * len(frames) // self.parts for back in (1, 0))
        return frames[begin:end]


WHOLE_DRIVE = DrivePart()


def parse_part(text: str) -> DrivePart:
    """Parse a part such as 1/2, the first half. Raises OptionError."""
    written = re.fullmatch(r"(\d{1,4})/(\d{1,4})", text)
    part = WHOLE_DRIVE if written is None else DrivePart(int(written[1]), int(written[2]))
    if written is None or not 1 <= part.number <= part.parts:
        raise OptionError(f"--part is a stretch of the drive such as 1/2, the first half, or 3/4; got {text!r:.40}.")
    return part
