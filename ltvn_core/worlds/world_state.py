"""What a world is like after some changes, as a value: which doors are closed, what stands where, how light it is.

`after` is a pure function, so that a replay knows the world of any moment. Owns no geometry.
"""

from dataclasses import dataclass, replace
from typing import Self, assert_never

from ltvn_core.worlds import world_change as w

PLAIN_LIGHT = w.LightChanged(level=1.0)


@dataclass(frozen=True, slots=True)
class WorldState:
    """A world at one moment; equal states look and feel the same. The default is the scene as it was made."""

    closed_doors: frozenset[int] = frozenset()
    things: tuple[w.ThingPlaced, ...] = ()
    """What was put down or moved and stands there still, by name."""
    missing: frozenset[str] = frozenset()
    """The scene's own furniture that was taken away."""
    light: w.LightChanged = PLAIN_LIGHT
    pictures: int | None = None
    """Seed of the pictures and rugs; None for those of the scene as it was made."""
    people: tuple[w.PersonMoved, ...] = ()
    """Who is there, by name."""

    def after(self, change: w.WorldChange) -> Self:
        """Return what the world is like after a change."""
        match change:
            case w.DoorMoved(door, is_open):
                doors = self.closed_doors - {door} if is_open else self.closed_doors | {door}
                return replace(self, closed_doors=doors)
            case w.ThingPlaced(thing):
                things = sorted((*self._things_without(thing), change), key=lambda each: each.thing)
                return replace(self, things=tuple(things), missing=self.missing - {thing})
            case w.ThingRemoved(thing):
                own = {thing} if thing.startswith(w.OWN_PREFIX) else set[str]()
                return replace(self, things=self._things_without(thing), missing=self.missing | own)
            case w.ThingReturned(thing):
                return replace(self, things=self._things_without(thing), missing=self.missing - {thing})
            case w.LightChanged():
                return replace(self, light=change)
            case w.PicturesExchanged(seed):
                return replace(self, pictures=seed)
            case w.PersonMoved(person):
                people = sorted((*self._people_without(person), change), key=lambda each: each.person)
                return replace(self, people=tuple(people))
            case w.PersonLeft(person):
                return replace(self, people=self._people_without(person))
            case w.TimePassed():
                return self
        assert_never(change)

    def thing(self, name: str) -> w.ThingPlaced | None:
        """Return what was put down or moved under a name, if it stands there."""
        return next((each for each in self.things if each.thing == name), None)

    def changes_to(self, other: "WorldState") -> tuple[w.WorldChange, ...]:
        """Return the changes that make this world into another, such as the one before, to undo."""
        changes: list[w.WorldChange] = [
            *(w.DoorMoved(door, is_open=True) for door in sorted(self.closed_doors - other.closed_doors)),
            *(w.DoorMoved(door, is_open=False) for door in sorted(other.closed_doors - self.closed_doors)),
        ]
        changes += _thing_changes(self, other)
        if self.light != other.light:
            changes.append(other.light)
        if self.pictures != other.pictures:
            changes.append(w.PicturesExchanged(other.pictures))
        present = {each.person for each in other.people}
        changes += [w.PersonLeft(each.person) for each in self.people if each.person not in present]
        changes += [each for each in other.people if each not in self.people]
        return tuple(changes)

    def _things_without(self, name: str) -> tuple[w.ThingPlaced, ...]:
        return tuple(each for each in self.things if each.thing != name)

    def _people_without(self, name: str) -> tuple[w.PersonMoved, ...]:
        return tuple(each for each in self.people if each.person != name)


AS_MADE = WorldState()
"""The world in which nothing was changed yet."""


def _thing_changes(now: WorldState, then: WorldState) -> list[w.WorldChange]:
    """Return what must be put back, taken away, or put down."""
    moved_now = {each.thing for each in now.things}
    moved_then = {each.thing for each in then.things}
    changes: list[w.WorldChange] = []
    for name in sorted((moved_now | now.missing) - moved_then - then.missing):
        changes.append(w.ThingReturned(name) if name.startswith(w.OWN_PREFIX) else w.ThingRemoved(name))
    changes += [w.ThingRemoved(name) for name in sorted(then.missing - now.missing)]
    changes += [each for each in then.things if each not in now.things]
    return changes
