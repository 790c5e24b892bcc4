"""Corrections: what building a map changed or added beyond what was recorded and recognised, each with its own error,
and where it stayed unsure.

Owns these records, their form as a line, and their form in a map's configuration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import wrap_angle
from ltvn_core.terminal_text import count_text
from ltvn_core.types import FrameId

UNSURE = "images placed less surely than 1 m"
"""Name of the images whose place, seen from the first of their stretch, has a standard deviation above a metre."""
LOOK_ALIKES = "look-alikes left out"
"""Name of the pairs of images that look like one place, and are none by the course."""
_KEY, _UNSURE_KEY = "corrections", "unsure"
_NAMED = 3


@dataclass(frozen=True, slots=True)
class Correction:
    """What one step of building corrected or added by itself."""

    what: str
    """What was corrected or added, in the plural."""
    count: int
    most_m: float
    """Greatest displacement of an image, or length of an edge, in metres."""
    most_deg: float
    """Greatest change of the heading of an image, or turn of an edge, in degrees."""
    error_m: float | None
    """Median error of the result by the images that were recognised across it, in metres; None if there are none."""
    error_deg: float | None

    @classmethod
    def of(cls, what: str, changes: NDArray[np.float64], errors: NDArray[np.float64], *, count: int) -> "Correction":
        """Return a correction from changes (N, 3) of poses and the errors (M, 3) that are left, in m, m and rad."""
        most_m, most_deg = _sizes(changes).max(axis=0, initial=0.0).round(3).tolist()
        error_m, error_deg = np.median(_sizes(errors), axis=0).round(3).tolist() if len(errors) else (None, None)
        return cls(what, count, most_m, most_deg, error_m, error_deg)

    def __str__(self) -> str:
        is_known = self.error_m is not None and self.error_deg is not None
        error = f", error {self.error_m:.2f} m and {self.error_deg:.1f} degrees" if is_known else ""
        return f"{self.count:,} {self.what}: up to {self.most_m:.2f} m and {self.most_deg:.1f} degrees{error}"


@dataclass(frozen=True, slots=True)
class UnsurePlaces:
    """Where the search for loop closures left the course of a drive unsure."""

    unconfirmed: float
    """Share of the way that is far from all closures."""
    longest: tuple[FrameId, FrameId]
    """The first and the last image of the longest such stretch."""
    look_alikes: tuple[tuple[FrameId, FrameId, int], ...]
    """An image of each of two places that look alike, and the number of such pairs of images; the 20 with the most."""

    def __str__(self) -> str:
        longest = ", longest stretch from image {:,} to {:,}".format(*self.longest) if self.unconfirmed else ""
        named = [f"{one:,} and {other:,} ({count_text(count, 'pair')})" for one, other, count in self.look_alikes]
        named[_NAMED:] = [f"{len(named) - _NAMED} more"] if len(named) > _NAMED else []
        alike = f"; {count_text(len(self.look_alikes), 'group')} of look-alikes: {', '.join(named)}" if named else ""
        return f"{self.unconfirmed:.0%} of the drive unconfirmed{longest}{alike}"

    @classmethod
    def recorded(cls, config: Mapping[str, Any]) -> Self | None:
        """Return those in a map's configuration, without look-alikes of another form; None if there are none."""
        match config.get(_UNSURE_KEY):
            case {"unconfirmed": float(share), "longest": [*ends], "look_alikes": [*rows]} if _are_numbers(ends, 2):
                return cls(min(share, 1.0), (ends[0], ends[1]), tuple((*row,) for row in rows if _are_numbers(row, 3)))
            case _:
                return None


def to_config(corrections: Sequence[Correction], unsure: UnsurePlaces | None) -> dict[str, Any]:
    """Return both as entries of a map's configuration; empty without any."""
    told = {_KEY: [asdict(each) for each in corrections], _UNSURE_KEY: unsure and asdict(unsure)}
    return {key: value for key, value in told.items() if value}


def from_config(config: Mapping[str, Any]) -> tuple[Correction, ...]:
    """Return the corrections in a map's configuration; rows of another form are left out."""
    rows = config.get(_KEY)
    return tuple(Correction(**row) for row in (rows if isinstance(rows, list) else ()) if _is_whole(row))


def _is_whole(row: object) -> bool:
    """Tell whether a value from a file has the fields of a correction."""
    if not isinstance(row, dict) or row.keys() != {field.name for field in fields(Correction)}:
        return False
    numbers = (row[name] for name in ("count", "most_m", "most_deg", "error_m", "error_deg"))
    are_numbers = all(isinstance(each, int | float) or each is None for each in numbers)
    return isinstance(row["what"], str) and are_numbers and None not in (row["count"], row["most_m"], row["most_deg"])


def _are_numbers(row: object, count: int) -> bool:
    """Tell whether a value from a file is a list of so many frames or counts."""
    return isinstance(row, list) and len(row) == count and all(type(x) is int and 0 <= x < 2**62 for x in row)


def _sizes(changes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances in metres and turns in degrees (N, 2)."""
    changes = changes.reshape(-1, 3)
    turns = np.degrees(np.abs(wrap_angle(changes[:, 2])))
    return np.stack([np.hypot(changes[:, 0], changes[:, 1]), turns], axis=-1)
