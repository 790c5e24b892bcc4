"""Corrections: what building a map changed or added beyond what was recorded and recognised, each with its own error.

Owns the record, its form as a line, and its form in a map's configuration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import wrap_angle

UNSURE = "images placed less surely than 1 m"
"""Name of the images whose place, seen from the first of their stretch, has a standard deviation above a metre."""
LOOK_ALIKES = "look-alikes left out"
"""Name of the pairs of images that look like one place, and are none by the course."""
_KEY = "corrections"


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
        most_m, most_deg = _sizes(changes).max(axis=0, initial=0.0).tolist()
        error_m, error_deg = np.median(_sizes(errors), axis=0).tolist() if len(errors) else (None, None)
        return cls(what, count, *_rounded(most_m, most_deg), *_rounded(error_m, error_deg))

    def __str__(self) -> str:
        is_known = self.error_m is not None and self.error_deg is not None
        error = f", error {self.error_m:.2f} m and {self.error_deg:.1f} degrees" if is_known else ""
        return f"{self.count:,} {self.what}: up to {self.most_m:.2f} m and {self.most_deg:.1f} degrees{error}"


def to_config(corrections: Sequence[Correction]) -> dict[str, Any]:
    """Return corrections as an entry of a map's configuration; empty without any."""
    return {_KEY: [asdict(each) for each in corrections]} if corrections else {}


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


def _sizes(changes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances in metres and turns in degrees (N, 2)."""
    changes = changes.reshape(-1, 3)
    turns = np.degrees(np.abs(wrap_angle(changes[:, 2])))
    return np.stack([np.hypot(changes[:, 0], changes[:, 1]), turns], axis=-1)


def _rounded(*numbers: float | None) -> list[Any]:
    return [None if number is None else round(number, 3) for number in numbers]
