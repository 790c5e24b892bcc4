"""The summary of a verb that did only its part, while others are not all done."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class PartSummary:
    """What a part of a test did; the other parts are not all done."""

    part: str
    done: int
    """Episodes, queries or scenes that this part has."""
    tests: int
    """Of all parts: one for each scene, seed and maintenance,"""
    finished: int
    """and those of them of which nothing is missing any more."""
    folder: Path
    """Where all parts belong."""
    wall_s: float
