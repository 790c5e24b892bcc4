"""Changes of a world, and its state after some changes: only data, without a simulator.

A change holds from its time on. `WorldState.after` is a pure function, so that a replay can compute the world at any
time. `simulation.changes` applies changes to a simulation; recordings store them as events.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self, TypeAlias, assert_never

PlaceRow: TypeAlias = tuple[float, float, float]
"""x and y in metres and yaw in radians, in the world frame."""
SizeRow: TypeAlias = tuple[float, float, float]
"""Width, depth and height in metres: along x, y and z of the thing's own frame."""

OWN_PREFIX = "own/"
"""Prefix of the names of the furniture that belongs to a scene, as in `own/sofa-0`; no other names have it."""


class ThingKind(StrEnum):
    """Kind of a thing, which determines its appearance."""

    BOX = "box"
    """A cardboard box."""
    BASKET = "basket"
    """A round basket."""
    CHAIR = "chair"
    FURNITURE = "furniture"
    """A piece of the scene's own furniture that was moved."""


@dataclass(frozen=True, slots=True)
class DoorMoved:
    """A door was closed or opened."""

    door: int
    """Number of the door in the scene."""
    is_open: bool


@dataclass(frozen=True, slots=True)
class ThingPlaced:
    """A thing was put down; if it was elsewhere before, it was moved."""

    thing: str
    """Name of the thing."""
    kind: ThingKind
    pose: PlaceRow
    size: SizeRow


@dataclass(frozen=True, slots=True)
class ThingRemoved:
    """A thing, or a piece of the scene's own furniture, was taken away."""

    thing: str


@dataclass(frozen=True, slots=True)
class ThingReturned:
    """A piece of the scene's own furniture is back at its original place."""

    thing: str


@dataclass(frozen=True, slots=True)
class LightChanged:
    """The light became brighter, darker, warmer or colder."""

    level: float
    """Brightness as a factor; 1 is the scene as it was made."""
    warmth: float = 0.0
    """Colour of the light from -1, bluish daylight, to 1, reddish lamps; 0 is white."""


@dataclass(frozen=True, slots=True)
class PicturesExchanged:
    """The pictures on the walls and the rugs on the floors were replaced."""

    seed: int | None
    """Seed of the new pictures and rugs; None restores the original ones."""


@dataclass(frozen=True, slots=True)
class PersonMoved:
    """A person entered the world or walked on; recorded a few times a second."""

    person: str
    pose: PlaceRow
    seed: int = 0
    """Seed of the person's clothes."""


@dataclass(frozen=True, slots=True)
class PersonLeft:
    """A person left the world."""

    person: str


@dataclass(frozen=True, slots=True)
class TimePassed:
    """Time passed while the robot's clock stood still."""

    duration_s: float


WorldChange: TypeAlias = (
    DoorMoved
    | ThingPlaced
    | ThingRemoved
    | ThingReturned
    | LightChanged
    | PicturesExchanged
    | PersonMoved
    | PersonLeft
    | TimePassed
)


@dataclass(frozen=True, slots=True)
class Outline:
    """Position and size of a solid object: an upright box, in metres and radians."""

    x: float
    y: float
    yaw: float
    width: float
    """Size along x of its own frame, in metres."""
    depth: float
    """Size along y of its own frame, in metres."""
    height: float
    """Height above the floor, in metres."""


def change_text(change: WorldChange) -> str:
    """Return a change in a few words, beginning with a small letter."""
    match change:
        case DoorMoved(door, is_open):
            return f"door {door} {'opened' if is_open else 'closed'}"
        case ThingPlaced(thing, kind, (x, y, _)):
            name = _plain_name(thing) if kind is ThingKind.FURNITURE else f"{kind} {thing}"
            return f"{name} put at x {x:.2f} m, y {y:.2f} m"
        case ThingRemoved(thing):
            return f"{_plain_name(thing)} taken away"
        case ThingReturned(thing):
            return f"{_plain_name(thing)} put back"
        case LightChanged(level, warmth):
            tint = "" if abs(warmth) < 0.05 else ", warm" if warmth > 0 else ", cold"
            return f"light at {level:.0%}{tint}"
        case PicturesExchanged(seed):
            return "the original pictures and rugs are back" if seed is None else "pictures and rugs exchanged"
        case PersonMoved(person, (x, y, _)):
            return f"{person} at x {x:.2f} m, y {y:.2f} m"
        case PersonLeft(person):
            return f"{person} left"
        case TimePassed(duration_s):
            return f"{duration_s / 60:.0f} minutes passed"


def _plain_name(thing: str) -> str:
    """Return the everyday name of a thing; for a scene's own furniture, this is its type and number."""
    return thing.removeprefix(OWN_PREFIX).replace("-", " ") if thing.startswith(OWN_PREFIX) else thing


def subject(change: WorldChange) -> str:
    """Return the subject of a change; a later change with the same subject replaces it."""
    match change:
        case DoorMoved(door):
            return f"door {door}"
        case ThingPlaced(thing) | ThingRemoved(thing) | ThingReturned(thing):
            return f"thing {thing}"
        case PersonMoved(person) | PersonLeft(person):
            return f"person {person}"
        case LightChanged() | PicturesExchanged() | TimePassed():
            return type(change).__name__


PLAIN_LIGHT = LightChanged(level=1.0)


@dataclass(frozen=True, slots=True)
class WorldState:
    """A world at one moment; equal states look the same and have the same obstacles. The default is the original
    scene."""

    closed_doors: frozenset[int] = frozenset()
    things: tuple[ThingPlaced, ...] = ()
    """Things that were put down or moved, and not removed, sorted by name."""
    missing: frozenset[str] = frozenset()
    """The scene's own furniture that was taken away."""
    light: LightChanged = PLAIN_LIGHT
    pictures: int | None = None
    """Seed of the pictures and rugs; None for those of the original scene."""
    people: tuple[PersonMoved, ...] = ()
    """People who are present, sorted by name."""

    def after(self, change: WorldChange) -> Self:
        """Return the state of the world after a change."""
        match change:
            case DoorMoved(door, is_open):
                doors = self.closed_doors - {door} if is_open else self.closed_doors | {door}
                return replace(self, closed_doors=doors)
            case ThingPlaced(thing):
                things = sorted((*self._things_without(thing), change), key=lambda each: each.thing)
                return replace(self, things=tuple(things), missing=self.missing - {thing})
            case ThingRemoved(thing):
                own = {thing} if thing.startswith(OWN_PREFIX) else set[str]()
                return replace(self, things=self._things_without(thing), missing=self.missing | own)
            case ThingReturned(thing):
                return replace(self, things=self._things_without(thing), missing=self.missing - {thing})
            case LightChanged():
                return replace(self, light=change)
            case PicturesExchanged(seed):
                return replace(self, pictures=seed)
            case PersonMoved(person):
                people = sorted((*self._people_without(person), change), key=lambda each: each.person)
                return replace(self, people=tuple(people))
            case PersonLeft(person):
                return replace(self, people=self._people_without(person))
            case TimePassed():
                return self
        assert_never(change)

    def thing(self, name: str) -> ThingPlaced | None:
        """Return the thing of this name that was put down or moved; None if there is none."""
        return next((each for each in self.things if each.thing == name), None)

    def changes_to(self, other: "WorldState") -> tuple[WorldChange, ...]:
        """Return the changes that convert this world to another, for instance to undo changes."""
        changes: list[WorldChange] = [
            *(DoorMoved(door, is_open=True) for door in sorted(self.closed_doors - other.closed_doors)),
            *(DoorMoved(door, is_open=False) for door in sorted(other.closed_doors - self.closed_doors)),
        ]
        changes += _thing_changes(self, other)
        if self.light != other.light:
            changes.append(other.light)
        if self.pictures != other.pictures:
            changes.append(PicturesExchanged(other.pictures))
        present = {each.person for each in other.people}
        changes += [PersonLeft(each.person) for each in self.people if each.person not in present]
        changes += [each for each in other.people if each not in self.people]
        return tuple(changes)

    def _things_without(self, name: str) -> tuple[ThingPlaced, ...]:
        return tuple(each for each in self.things if each.thing != name)

    def _people_without(self, name: str) -> tuple[PersonMoved, ...]:
        return tuple(each for each in self.people if each.person != name)


AS_MADE = WorldState()
"""The world before any change."""


def _thing_changes(now: WorldState, then: WorldState) -> list[WorldChange]:
    """Return the changes of things: those to restore, to remove, and to put down."""
    moved_now = {each.thing for each in now.things}
    moved_then = {each.thing for each in then.things}
    changes: list[WorldChange] = []
    for name in sorted((moved_now | now.missing) - moved_then - then.missing):
        changes.append(ThingReturned(name) if name.startswith(OWN_PREFIX) else ThingRemoved(name))
    changes += [ThingRemoved(name) for name in sorted(then.missing - now.missing)]
    changes += [each for each in then.things if each not in now.things]
    return changes
