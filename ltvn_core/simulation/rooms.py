"""The rooms of a scene, the doorways between them, and the parts that a changing world may move or exchange.

These parts are doors, furniture, pictures and rugs. A scene from a mesh has none, because its triangles have no labels.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np


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
    AISLE = "aisle"
    MEETING = "meeting room"


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
        """x and y of the middle of the gap, in metres."""
        along = (self.low + self.high) / 2
        return (self.wall, along) if self.axis == 0 else (along, self.wall)


WIDEST_DOOR_M = 2.05
"""Greatest width of a gap with a door, in metres; a wider gap is an open passage."""


@dataclass(frozen=True, slots=True)
class FurniturePiece:
    """A piece of furniture at its original place; lengths in metres."""

    name: str
    """Name in this scene, such as `sofa-0`."""
    x: float
    y: float
    turn: tuple[float, float]
    """(cos, sin) of the rotation about the vertical axis."""
    width: float
    depth: float
    first_face: int
    """Index of the first face in the scene's surfaces."""
    end_face: int
    """Index after the last face in the scene's surfaces."""

    @property
    def yaw_rad(self) -> float:
        """Heading in radians; y points from the back of the piece to its front."""
        return float(np.arctan2(self.turn[1], self.turn[0]))


@dataclass(frozen=True, slots=True)
class SceneParts:
    """Parts of a scene that can be moved, removed or exchanged."""

    doorways: tuple[Doorway, ...] = ()
    furniture: tuple[FurniturePiece, ...] = ()
    paintings: tuple[int, ...] = ()
    """Indices of textures that show a painting on a wall."""
    rugs: tuple[int, ...] = ()
    """Indices of textures that show a rug."""

    @property
    def doors(self) -> tuple[Doorway, ...]:
        """The doorways that have a door; a door's number is its index here."""
        return tuple(doorway for doorway in self.doorways if doorway.width_m <= WIDEST_DOOR_M)

    def arrays(self) -> dict[str, Any]:
        """Return the parts as named arrays, for the cache of scenes."""
        doors = [[*door.rooms, door.axis, door.wall, door.low, door.high] for door in self.doorways]
        pieces = [
            [piece.x, piece.y, *piece.turn, piece.width, piece.depth, piece.first_face, piece.end_face]
            for piece in self.furniture
        ]
        return {
            "doorways": np.array(doors, np.float64).reshape(-1, 6),
            "furniture": np.array(pieces, np.float64).reshape(-1, 8),
            "furniture_names": np.array([piece.name for piece in self.furniture], "U32"),
            "paintings": np.array(self.paintings, np.int64),
            "rugs": np.array(self.rugs, np.int64),
        }

    @classmethod
    def from_arrays(cls, arrays: Any) -> "SceneParts":
        """Return the parts from the result of `arrays`. Raises KeyError or ValueError if something is missing."""
        names = arrays["furniture_names"].tolist()
        return cls(
            doorways=tuple(_doorway(row) for row in arrays["doorways"].tolist()),
            furniture=tuple(_piece(*each) for each in zip(names, arrays["furniture"].tolist(), strict=True)),
            paintings=tuple(arrays["paintings"].tolist()),
            rugs=tuple(arrays["rugs"].tolist()),
        )


def _doorway(row: list[float]) -> Doorway:
    first, second, axis, wall, low, high = row
    return Doorway(rooms=(int(first), int(second)), axis=int(axis), wall=wall, low=low, high=high)


def _piece(name: str, row: list[float]) -> FurniturePiece:
    x, y, cos, sin, width, depth, first_face, end_face = row
    return FurniturePiece(
        name=name,
        x=x,
        y=y,
        turn=(cos, sin),
        width=width,
        depth=depth,
        first_face=int(first_face),
        end_face=int(end_face),
    )
