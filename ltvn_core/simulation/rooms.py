"""The rooms of a scene, their purposes, and the doorways between them, whoever made the scene."""

from dataclasses import dataclass
from enum import Enum


class RoomKind(Enum):
    """The purpose of a room.

    The scene cache stores a member's position, so members are never reordered or inserted before others.
    """

    HALL = "hall"
    LIVING = "living room"
    KITCHEN = "kitchen"
    DINING = "dining room"
    BEDROOM = "bedroom"
    NURSERY = "nursery"
    STUDY = "study"
    LIBRARY = "library"
    BATH = "bathroom"
    UNNAMED = "part of a mesh scene"


@dataclass(frozen=True, slots=True)
class Room:
    """A rectangular room; its edges are the centre lines of its walls, in metres."""

    kind: RoomKind
    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def area_m2(self) -> float:
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    @property
    def shorter_side_m(self) -> float:
        return min(self.x1 - self.x0, self.y1 - self.y0)


@dataclass(frozen=True, slots=True)
class Doorway:
    """A gap in the wall between two rooms; lengths in metres."""

    rooms: tuple[int, int]
    axis: int
    """0 for a wall along y (x is constant), 1 for a wall along x."""
    wall: float
    """Coordinate of the wall's centre line on that axis."""
    low: float
    """Coordinate along the wall where the gap begins."""
    high: float
    """Coordinate along the wall where the gap ends."""

    @property
    def width_m(self) -> float:
        return self.high - self.low

    @property
    def middle(self) -> tuple[float, float]:
        """x and y of its middle."""
        along = (self.low + self.high) / 2
        return (self.wall, along) if self.axis == 0 else (along, self.wall)
