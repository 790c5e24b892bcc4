"""The scene of each state of a world: its surfaces, light and clearance map, with what was changed.

Owns which cells of the floor something solid blocks, the scene's own furniture in another place, and other pictures and
rugs; what is new in a scene is made in `things`. What two states share is made once: a state that was there before
gives the same arrays again, and the scene as it was made is the very same object. Carries nothing out over time; that
is `world`.
"""

from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ltvn_core.simulation.apartments.decals import painting, rug
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.changes.things import add_leaf, add_thing, people_surfaces
from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_parts import FurniturePiece, SceneParts
from ltvn_core.simulation.surface_builder import SurfaceBuilder, rounded_cos_sin
from ltvn_core.simulation.surfaces import Light, Surfaces, joined
from ltvn_core.simulation.triangle_rasterization import RasterGrid, clip_to_heights
from ltvn_core.types import Rgb
from ltvn_core.worlds.world_change import OWN_PREFIX, PlaceRow, ThingKind, ThingPlaced
from ltvn_core.worlds.world_state import AS_MADE, WorldState

_FLAT_M = 0.03
"""The robot drives over anything lower than this."""
_FINE = 5
"""Subdivisions of a cell's side when its covered share is measured."""
_COVERED_SHARE = 0.5
"""A cell is blocked if at least this share of it is covered."""
_KEPT = 32
"""So many surfaces and clearance maps are kept."""
Made = TypeVar("Made")


class Cells(NamedTuple):
    """Cells of a grid."""

    rows: NDArray[np.intp]
    """(N,)."""
    columns: NDArray[np.intp]
    """(N,)."""


def blocked_cells(surfaces: Surfaces, clearance: ClearanceMap) -> Cells:
    """Return the cells of a clearance map that something blocks; what it encloses is blocked, too."""
    triangles = clip_to_heights(surfaces.vertices[surfaces.faces].astype(np.float64), _FLAT_M, OBSTACLE_HEIGHT_M)
    if not len(triangles):
        return Cells(np.empty(0, np.intp), np.empty(0, np.intp))
    size_m = clearance.resolution_m
    corners = (triangles[:, :, :2].reshape(-1, 2) - clearance.origin) / size_m
    limits = np.array(clearance.blocked.shape[::-1])
    low = np.clip(np.floor(corners.min(0)).astype(np.intp) - 1, 0, limits)
    high = np.clip(np.ceil(corners.max(0)).astype(np.intp) + 1, 0, limits)
    columns, rows = (high - low).tolist()
    if columns <= 0 or rows <= 0:
        return Cells(np.empty(0, np.intp), np.empty(0, np.intp))
    raster = RasterGrid(clearance.origin + low * size_m, (rows * _FINE, columns * _FINE), size_m / _FINE)
    covered = np.asarray(ndimage.binary_fill_holes(raster.cover(triangles)))
    share = covered.reshape(rows, _FINE, columns, _FINE).mean(axis=(1, 3))
    found_rows, found_columns = np.nonzero(share >= _COVERED_SHARE)
    return Cells(found_rows + low[1], found_columns + low[0])


def exchanged_textures(textures: tuple[Rgb, ...], parts: SceneParts, seed: int) -> tuple[Rgb, ...]:
    """Return the textures of a scene with other paintings and rugs, drawn with a seed."""
    rng = SeededRng(np.random.default_rng((11, seed)))
    changed = list(textures)
    for texture in parts.paintings:
        changed[texture] = painting(rng.spawn())
    for texture in parts.rugs:
        changed[texture] = rug(rng.spawn())
    return tuple(changed)


def moved_piece(surfaces: Surfaces, piece: FurniturePiece, pose: PlaceRow) -> Surfaces:
    """Return the surfaces of a piece as it looks at a pose, with its own textures alone."""
    faces = slice(piece.first_face, piece.end_face)
    corners = surfaces.vertices[surfaces.faces[faces]].reshape(-1, 3).astype(np.float64)
    used, texture = np.unique(surfaces.face_texture[faces], return_inverse=True)
    x, y, yaw = pose
    back = _turn(piece.turn[0], -piece.turn[1])
    turn = _turn(*rounded_cos_sin(yaw))
    corners[:, :2] = (corners[:, :2] - (piece.x, piece.y)) @ back.T @ turn.T + (x, y)
    return Surfaces(
        vertices=corners.astype(np.float32),
        faces=np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
        corner_uv=surfaces.corner_uv[faces],
        face_texture=texture.astype(np.int32),
        overhead=surfaces.overhead[faces],
        textures=tuple(surfaces.textures[number] for number in used),
    )


def piece_cells(piece: FurniturePiece, clearance: ClearanceMap) -> tuple[slice, slice]:
    """Return the rows and columns of the rectangle that a piece had to itself where it stood at first."""
    upright = abs(piece.turn[0]) > 0.5
    across, along = (piece.width, piece.depth) if upright else (piece.depth, piece.width)
    low = (np.array([piece.x - across / 2, piece.y - along / 2]) - clearance.origin) / clearance.resolution_m
    high = (np.array([piece.x + across / 2, piece.y + along / 2]) - clearance.origin) / clearance.resolution_m
    columns, rows = zip(np.rint(low).astype(int).tolist(), np.rint(high).astype(int).tolist(), strict=True)
    return slice(*rows), slice(*columns)


def _turn(cos: float, sin: float) -> np.ndarray:
    return np.array([[cos, -sin], [sin, cos]])


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
