"""A share of some work, so that N commands on any machines do all of it together, with no engine between them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from ltvn_core.errors import OptionError

Work = TypeVar("Work")


@dataclass(frozen=True, slots=True)
class Part:
    """One of several shares of nearly the same size; together they are everything, and no two have anything in common.

    What follows on another in the list of work is mostly in the same share, because it needs the same maps.
    """

    number: int = 1
    """From 1 to `count`."""
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise OptionError(f"--part is I/N with I from 1 to N, got {self}.")

    def __str__(self) -> str:
        """Return it as the option has it."""
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> "Part":
        """Read `I/N`; nothing is the whole. Raises OptionError."""
        if not text:
            return WHOLE
        if not (found := re.fullmatch(r"(\d{1,6})/(\d{1,6})", text.strip())):
            raise OptionError(f"--part is I/N, as in 3/16 for the third of sixteen, got {text!r:.40}.")
        return cls(int(found[1]), int(found[2]))

    def of(self, work: Sequence[Work]) -> list[Work]:
        """Return the share of a list, in its order."""
        first, until = ((number * len(work)) // self.count for number in (self.number - 1, self.number))
        return list(work[first:until])


WHOLE = Part()
"""Everything."""
