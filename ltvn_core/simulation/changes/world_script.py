"""What happens in a world over time: changes and their moments. Carries nothing out."""

from dataclasses import dataclass

from ltvn_core.worlds.world_change import WorldChange

HOUR_S = 3600.0
DAY_S = 24 * HOUR_S
MORNING_S = 9 * HOUR_S
"""A world begins at nine o'clock of its first day."""


@dataclass(frozen=True, slots=True)
class TimedChange:
    """A change and when it happens."""

    at_s: float
    """Seconds from midnight of the first day."""
    change: WorldChange


@dataclass(frozen=True, slots=True)
class WorldScript:
    """The changes of a world over time."""

    name: str
    seed: int = 0
    changes: tuple[TimedChange, ...] = ()
    """In the order of their times."""
    people: int = 0
    """So many people walk about by day."""

    @property
    def is_static(self) -> bool:
        """Whether nothing ever changes by itself."""
        return not self.changes and not self.people


STATIC = WorldScript("static")
"""Nothing ever changes by itself."""
