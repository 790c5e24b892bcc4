"""Changes of a world, and its state after some changes: only data, without a simulator.

A change holds from its time on. `WorldState.after` is a pure function, so that a replay knows the world of any
moment. `simulation.changes` carries changes out; recordings store them as events.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self, TypeAlias, assert_never

PlaceRow: TypeAlias = tuple[float, float, float]
"""x and y in metres and yaw in radians, in the world frame."""
SizeRow: TypeAlias = tuple[float, float, float]
"""Width, depth and height in metres: along x, y and z of the thing's own frame."""

OWN_PREFIX = "own/"
"""Names of the furniture that belongs to a scene begin with this, as in `own/sofa-0`; no other thing's name does."""


class ThingKind(StrEnum):
    """Kind of a thing, which decides how it looks."""

    BOX = "box"
    """A cardboard box."""
    BASKET = "basket"
    """A round basket."""
    CHAIR = "chair"
    FURNITURE = "furniture"
    """A piece of the scene's own furniture, which was moved."""


@dataclass(frozen=True, slots=True)
class DoorMoved:
    """A door was closed or opened."""

    door: int
    """Its number among the scene's doors."""
    is_open: bool


@dataclass(frozen=True, slots=True)
class ThingPlaced:
    """A thing was put down; one that stood elsewhere was moved."""

    thing: str
    """Its name."""
    kind: ThingKind
    pose: PlaceRow
    size: SizeRow


@dataclass(frozen=True, slots=True)
class ThingRemoved:
    """A thing, or a piece of the scene's own furniture, was taken away."""

    thing: str


@dataclass(frozen=True, slots=True)
class ThingReturned:
    """A piece of the scene's own furniture stands where it stood at first."""

    thing: str


@dataclass(frozen=True, slots=True)
class LightChanged:
    """The light became brighter or darker, warmer or colder."""

    level: float
    """Brightness as a factor; 1 is the scene as it was made."""
    warmth: float = 0.0
    """Colour of the light from -1, bluish daylight, to 1, reddish lamps; 0 is white."""


@dataclass(frozen=True, slots=True)
class PicturesExchanged:
    """Other pictures hang on the walls and other rugs lie on the floors."""

    seed: int | None
    """Seed of the new pictures and rugs; None restores the original ones."""


@dataclass(frozen=True, slots=True)
class PersonMoved:
    """A person came into the world, or walked on; written down a few times a second."""

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
    """Time went by in which the robot's clock stood still."""

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
    """Where something solid stands: an upright box, in metres and radians."""

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
    """Return what changed in a few words, beginning with a small letter."""
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
    """Return the name of a thing as a person says it: a scene's own furniture is named by what it is."""
    return thing.removeprefix(OWN_PREFIX).replace("-", " ") if thing.startswith(OWN_PREFIX) else thing


def subject(change: WorldChange) -> str:
    """Return what a change is about; a later one about the same replaces it."""
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
    """A world at one moment; equal states look and feel the same. The default is the scene as it was made."""

    closed_doors: frozenset[int] = frozenset()
    things: tuple[ThingPlaced, ...] = ()
    """Things that were put down or moved and not removed, by name."""
    missing: frozenset[str] = frozenset()
    """The scene's own furniture that was taken away."""
    light: LightChanged = PLAIN_LIGHT
    pictures: int | None = None
    """Seed of the pictures and rugs; None for those of the scene as it was made."""
    people: tuple[PersonMoved, ...] = ()
    """People who are there, by name."""

    def after(self, change: WorldChange) -> Self:
        """Return what the world is like after a change."""
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
        """Return what was put down or moved under a name, if it stands there."""
        return next((each for each in self.things if each.thing == name), None)

    def changes_to(self, other: "WorldState") -> tuple[WorldChange, ...]:
        """Return the changes that make this world into another, such as the one before, to undo."""
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
"""The world in which nothing was changed yet."""


def _thing_changes(now: WorldState, then: WorldState) -> list[WorldChange]:
    """Return what must be put back, taken away, or put down."""
    moved_now = {each.thing for each in now.things}
    moved_then = {each.thing for each in then.things}
    changes: list[WorldChange] = []
    for name in sorted((moved_now | now.missing) - moved_then - then.missing):
        changes.append(ThingReturned(name) if name.startswith(OWN_PREFIX) else ThingRemoved(name))
    changes += [ThingRemoved(name) for name in sorted(then.missing - now.missing)]
    changes += [each for each in then.things if each not in now.things]
    return changes
