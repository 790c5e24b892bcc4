"""The scene of each state of a world: its surfaces, light and clearance map, with what was changed.

What two states share is made once: a state that was there before gives the same arrays again, and the scene as it was
made is the very same object. Carries nothing out over time; that is `world`.
"""

from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from ltvn_core.simulation.changes.door_leaves import add_leaf
from ltvn_core.simulation.changes.footprints import blocked_cells
from ltvn_core.simulation.changes.moved_furniture import moved_piece, piece_cells
from ltvn_core.simulation.changes.people_shapes import people_surfaces
from ltvn_core.simulation.changes.pictures import exchanged_textures
from ltvn_core.simulation.changes.things import add_thing
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.light import Light
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.surface_builder import SurfaceBuilder
from ltvn_core.simulation.surfaces import Surfaces, joined
from ltvn_core.worlds.world_change import OWN_PREFIX, ThingKind, ThingPlaced
from ltvn_core.worlds.world_state import AS_MADE, WorldState

_KEPT = 32
"""So many surfaces and clearance maps are kept."""

Made = TypeVar("Made")


class ChangedScenes:
    """Makes the scenes of all states of one scene."""

    def __init__(self, base: Scene) -> None:
        """Start from a scene as it was made."""
        self.base = base
        self._pieces = {OWN_PREFIX + piece.name: piece for piece in base.parts.furniture}
        self._cache: dict[Hashable, object] = {}
        self._newest = AS_MADE, base

    def at(self, state: WorldState) -> Scene:
        """Return the scene in a state; `world_check` says which states there are."""
        if state == AS_MADE:
            return self.base
        if state is not self._newest[0]:
            self._newest = state, self._made(state)
        return self._newest[1]

    def _made(self, state: WorldState) -> Scene:
        away = state.missing | {each.thing for each in state.things if each.kind is ThingKind.FURNITURE}
        solid = state.closed_doors, state.things
        people = people_surfaces(state.people)
        standing = self._once(("standing", *solid), lambda: self._standing(*solid))
        return replace(
            self.base,
            surfaces=self._once(("surfaces", away, state.pictures), lambda: self._surfaces(away, state.pictures)),
            clearance=self._once(("clearance", away, *solid), lambda: self._clearance(away, standing)),
            added=tuple(each for each in (standing, people) if each is not None),
            light=Light.of(state.light.level, state.light.warmth),
        )

    def _surfaces(self, away: frozenset[str], pictures: int | None) -> Surfaces:
        """Return the scene's own surfaces without the furniture that is elsewhere, with these pictures."""
        whole = self.base.surfaces
        if pictures is not None and (self.base.parts.paintings or self.base.parts.rugs):
            make = lambda: exchanged_textures(whole.textures, self.base.parts, pictures)  # noqa: E731
            whole = replace(whole, textures=self._once(("textures", pictures), make))
        if not away:
            return whole
        keep = np.ones(len(whole.faces), bool)
        for piece in (self._pieces[name] for name in away):
            keep[piece.first_face : piece.end_face] = False
        return whole.only(keep)

    def _standing(self, closed_doors: frozenset[int], things: tuple[ThingPlaced, ...]) -> Surfaces | None:
        """Return the leaves of closed doors and all things; None if there are none."""
        builder = SurfaceBuilder()
        for door in sorted(closed_doors):
            add_leaf(builder, door, self.base.parts.doors[door])
        for placed in things:
            if placed.kind is not ThingKind.FURNITURE:
                add_thing(builder, placed)
        parts = [builder.build()] if builder.face_count else []
        parts += [self._moved(placed) for placed in things if placed.kind is ThingKind.FURNITURE]
        return joined(parts) if parts else None

    def _moved(self, placed: ThingPlaced) -> Surfaces:
        return moved_piece(self.base.surfaces, self._pieces[placed.thing], placed.pose)

    def _clearance(self, away: frozenset[str], standing: Surfaces | None) -> ClearanceMap:
        clearance = self.base.clearance
        blocked = clearance.blocked.copy()
        for name in away:
            blocked[piece_cells(self._pieces[name], clearance)] = False
        if standing is not None:
            blocked[blocked_cells(standing, clearance)] = True
        return replace(clearance, blocked=blocked, floor=clearance.navigable)

    def _once(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what was made for a key before, or make it; the oldest is forgotten."""
        if key in self._cache:
            self._cache[key] = self._cache.pop(key)
        else:
            self._cache[key] = make()
            while len(self._cache) > _KEPT:
                self._cache.pop(next(iter(self._cache)))
        return cast(Made, self._cache[key])
