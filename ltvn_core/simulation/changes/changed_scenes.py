"""The scene of each state of a world: its surfaces, light and clearance map, with all changes.

Owns the changes of surfaces (moved furniture, other pictures and rugs, and added objects) and the cells of the floor
that solid objects block. Added objects are things, the leaves of closed doors, and people. Leaves slide out of the wall
and fill the doorway; they are as thick as the wall. A person has two legs, a long wide coat, arms and a head, in
individual clothes.

Parts that several states share are created once: a repeated state gives the same arrays again, and the unchanged scene
is the same object. The changes over time are in `world`.
"""

import zlib
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, Never, TypeVar, assert_never, cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ltvn_core.simulation.apartments.decals import painting, rug
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.tiling_textures import (
    cloth,
    hsv_colour,
    pixel_grid,
    plain,
    tiling_noise,
    to_uint8,
    wood,
)
from ltvn_core.simulation.body import PERSON_HEIGHT_M, PERSON_RADIUS_M
from ltvn_core.simulation.clearance_map import OBSTACLE_HEIGHT_M, ClearanceMap
from ltvn_core.simulation.rooms import Doorway, FurniturePiece, SceneParts
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.surfaces import Light, SurfaceBuilder, Surfaces, TextureIndex, joined, rounded_cos_sin
from ltvn_core.simulation.triangle_rasterization import RasterGrid, clip_to_heights
from ltvn_core.types import Rgb
from ltvn_core.worlds import AS_MADE, OWN_PREFIX, Outline, PersonMoved, PlaceRow, ThingKind, ThingPlaced, WorldState

_LEAF_HEIGHT_M = 2.05
_LEAF_THICKNESS_M = 0.1
_KNOB_HEIGHT_M = 1.05
_HEM_M, _WAIST_M = 0.12, 0.85
"""Lower and upper height of the wide part of the coat, in metres."""
_INSIDE_M = 0.002
"""Distance of the drawn coat inside the collision outline, in metres."""
_SEAT_SHARE = 0.5
"""Height of a chair's seat as a share of the height of its back."""
_LEG_M = 0.05


def leaf_outline(doorway: Doorway) -> Outline:
    """Return the outline of a closed door."""
    x, y = doorway.middle
    yaw = np.pi / 2 if doorway.axis == 0 else 0.0
    return Outline(x=x, y=y, yaw=yaw, width=doorway.width_m, depth=_LEAF_THICKNESS_M, height=_LEAF_HEIGHT_M)


def add_leaf(builder: SurfaceBuilder, door: int, doorway: Doorway) -> None:
    """Add the leaf of door number `door`; every door of a scene looks different."""
    x, y = doorway.middle
    size = (doorway.width_m, _LEAF_THICKNESS_M, _LEAF_HEIGHT_M)
    knob_at = 0.4 * doorway.width_m
    thick = _LEAF_THICKNESS_M + 0.1
    knob = (x + knob_at, y)
    knob_size = (0.12, thick, 0.03)
    if doorway.axis == 0:
        size = (size[1], size[0], size[2])
        knob = (x, y + knob_at)
        knob_size = (thick, 0.12, 0.03)
    builder.box(builder.texture(_leaf_texture(door)), (x, y, _LEAF_HEIGHT_M / 2), size, tile_m=None)
    builder.box(builder.texture(_knob_texture()), (*knob, _KNOB_HEIGHT_M), knob_size)


@lru_cache(maxsize=64)
def _leaf_texture(door: int) -> Rgb:
    """Return a panelled door, (128, 128, 3)."""
    rng = SeededRng(np.random.default_rng((7, door)))
    colour = hsv_colour(rng.uniform(0.02, 0.14), rng.uniform(0.05, 0.7), rng.uniform(0.45, 0.95))
    image = wood(rng, colour, size=128).transpose(1, 0, 2).astype(np.float64)
    panels = 2 + rng.index(3)
    for panel in range(panels):
        top = 10 + panel * 112 // panels
        bottom = panel * 112 // panels + 112 // panels
        image[top:bottom, 16:112] *= 0.72
        image[top + 4 : bottom - 4, 20:108] /= 0.8
    return np.clip(image, 0, 255).astype(np.uint8)


@lru_cache(maxsize=1)
def _knob_texture() -> Rgb:
    return plain(SeededRng(np.random.default_rng(7)), hsv_colour(0.12, 0.2, 0.7), 16)


def person_outline(person: PersonMoved) -> Outline:
    """Return the outline of a person."""
    x, y, yaw = person.pose
    return Outline(x=x, y=y, yaw=yaw, width=2 * PERSON_RADIUS_M, depth=2 * PERSON_RADIUS_M, height=PERSON_HEIGHT_M)


def people_surfaces(people: tuple[PersonMoved, ...]) -> Surfaces | None:
    """Return the surfaces of people at their poses; None if there are none.

    The same people have the same textures at all poses, so that a renderer prepares the textures once.
    """
    if not people:
        return None
    crowd = _crowd(tuple(person.seed for person in people))
    poses = np.array([person.pose for person in people], np.float64)[crowd.owner]
    cos = np.cos(poses[:, 2])
    sin = np.sin(poses[:, 2])
    x, y, z = crowd.surfaces.vertices.T.astype(np.float64)
    at = np.stack([poses[:, 0] + cos * x - sin * y, poses[:, 1] + sin * x + cos * y, z], axis=-1)
    return replace(crowd.surfaces, vertices=at.astype(np.float32))


class _Crowd(NamedTuple):
    """Several people, each in a frame of its own: x ahead, y to the left, the origin on the floor."""

    surfaces: Surfaces
    owner: NDArray[np.intp]
    """(V,) index of the person of each vertex."""


@lru_cache(maxsize=8)
def _crowd(seeds: tuple[int, ...]) -> _Crowd:
    bodies = [_body(seed) for seed in seeds]
    return _Crowd(joined(bodies), np.repeat(np.arange(len(bodies)), [len(body.vertices) for body in bodies]))


@lru_cache(maxsize=32)
def _body(seed: int) -> Surfaces:
    rng = SeededRng(np.random.default_rng((13, seed)))
    builder = SurfaceBuilder()
    trousers = builder.texture(cloth(rng, hsv_colour(rng.uniform(0.5, 0.75), rng.uniform(0.1, 0.6), 0.4)))
    coat = builder.texture(cloth(rng, hsv_colour(rng.uniform(0, 1), rng.uniform(0.3, 0.8), rng.uniform(0.4, 0.9))))
    skin = builder.texture(plain(rng, hsv_colour(0.07, rng.uniform(0.25, 0.6), rng.uniform(0.4, 0.95)), 32))
    hair = builder.texture(plain(rng, hsv_colour(0.08, 0.5, rng.uniform(0.1, 0.6)), 32))
    for side in (-1, 1):
        builder.cylinder(trousers, (0.0, 0.11 * side, 0.0), 0.1, 0.85, top_radius=0.13)
        builder.cylinder(coat, (0.0, 0.2 * side, 0.75), 0.05, 0.65, sides=8)
    # As wide as the collision outline: the camera must not see thin legs if the bumper touches a wide body.
    builder.cylinder(coat, (0.0, 0.0, _HEM_M), PERSON_RADIUS_M - _INSIDE_M, _WAIST_M - _HEM_M, sides=24)
    builder.cylinder(coat, (0.0, 0.0, _WAIST_M), 0.22, 1.42 - _WAIST_M, top_radius=0.17, sides=16)
    builder.cylinder(skin, (0.0, 0.0, 1.42), 0.09, 0.2)
    builder.cylinder(hair, (0.0, 0.0, 1.62), 0.1, 0.08, top_radius=0.06)
    return builder.build()


def add_thing(builder: SurfaceBuilder, placed: ThingPlaced) -> None:
    """Add a thing; its name determines its colours, so that it looks the same at every place."""
    rng = SeededRng(np.random.default_rng(zlib.crc32(placed.thing.encode())))
    match placed.kind:
        case ThingKind.BOX:
            _add_box(builder, placed, rng)
        case ThingKind.BASKET:
            _add_basket(builder, placed, rng)
        case ThingKind.CHAIR:
            _add_chair(builder, placed, rng)
        case ThingKind.FURNITURE:
            _refuse_furniture(placed)
        case _:
            assert_never(placed.kind)


def _refuse_furniture(placed: ThingPlaced) -> Never:
    raise ValueError(f"{placed.thing} has unknown surfaces; see changed_scenes.")


def _add_box(builder: SurfaceBuilder, placed: ThingPlaced, rng: SeededRng) -> None:
    width, depth, height = placed.size
    _part(builder, placed, builder.texture(_cardboard(rng)), (0, 0, 0), (width, depth, height), whole=True)


def _add_basket(builder: SurfaceBuilder, placed: ThingPlaced, rng: SeededRng) -> None:
    x, y, _ = placed.pose
    radius = min(placed.size[:2]) / 2
    height = placed.size[2]
    woven = builder.texture(cloth(rng, hsv_colour(rng.uniform(0, 1), 0.5, 0.7)))
    builder.cylinder(woven, (x, y, 0.0), 0.85 * radius, height, top_radius=radius, sides=16)


def _add_chair(builder: SurfaceBuilder, placed: ThingPlaced, rng: SeededRng) -> None:
    width, depth, height = placed.size
    frame = builder.texture(wood(rng, hsv_colour(rng.uniform(0.04, 0.1), 0.6, rng.uniform(0.3, 0.8)), size=64))
    cushion = builder.texture(cloth(rng, hsv_colour(rng.uniform(0, 1), 0.6, 0.7)))
    seat = _SEAT_SHARE * height
    for side in (-1, 1):
        for end in (-1, 1):
            at = (side * (width - _LEG_M) / 2, end * (depth - _LEG_M) / 2, 0.0)
            _part(builder, placed, frame, at, (_LEG_M, _LEG_M, seat))
    _part(builder, placed, cushion, (0, 0, seat), (width, depth, 0.06))
    _part(builder, placed, frame, (0, -(depth - _LEG_M) / 2, seat), (width, _LEG_M, height - seat))


def _part(
    builder: SurfaceBuilder,
    placed: ThingPlaced,
    texture: TextureIndex,
    at: tuple[float, float, float],
    size: tuple[float, float, float],
    *,
    whole: bool = False,
) -> None:
    """Add a box whose bottom centre is `at` in the thing's frame; `whole` fits the texture onto each side once."""
    x, y, yaw = placed.pose
    cos, sin = rounded_cos_sin(yaw)
    centre = (x + cos * at[0] - sin * at[1], y + sin * at[0] + cos * at[1], at[2] + size[2] / 2)
    builder.box(texture, centre, size, turn=(cos, sin), tile_m=None if whole else 0.5)


def _cardboard(rng: SeededRng) -> Rgb:
    """Return a cardboard box with tape and a printed label, (128, 128, 3)."""
    column, row = pixel_grid(128)
    brown = hsv_colour(rng.uniform(0.06, 0.1), rng.uniform(0.35, 0.55), rng.uniform(0.5, 0.8))
    image = brown * (0.9 + 0.12 * tiling_noise(rng, 128, cells=(4, 8)))[..., None]
    image[(np.abs(column - 64) < 7) & (row >= 0)] = hsv_colour(0.1, 0.25, 0.9)
    left = 12 + rng.index(30)
    top = 50 + rng.index(40)
    image[top : top + 26, left : left + 36] = 245
    ink = plain(rng, hsv_colour(rng.uniform(0, 1), 0.8, 0.5), 16)[0, 0]
    for line in range(3):
        image[top + 5 + 7 * line : top + 8 + 7 * line, left + 4 : left + 12 + rng.index(22)] = ink
    return to_uint8(image)


_FLAT_M = 0.03
"""Height of things that the robot drives over, in metres."""
_FINE = 5
"""Subdivisions of a cell's side when its covered share is measured."""
_COVERED_SHARE = 0.5
"""Least covered share of a cell that counts as blocked."""
_KEPT = 32
"""Number of surfaces and clearance maps in the cache."""
Made = TypeVar("Made")


class Cells(NamedTuple):
    """Cells of a grid."""

    rows: NDArray[np.intp]
    """(N,)."""
    columns: NDArray[np.intp]
    """(N,)."""


def blocked_cells(surfaces: Surfaces, clearance: ClearanceMap) -> Cells:
    """Return the cells of a clearance map that surfaces block, including the cells that they enclose."""
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
    """Return the surfaces of a piece at a pose, with only its own textures."""
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
    """Return the rows and columns of the rectangle of a piece at its original place."""
    upright = abs(piece.turn[0]) > 0.5
    across, along = (piece.width, piece.depth) if upright else (piece.depth, piece.width)
    low = (np.array([piece.x - across / 2, piece.y - along / 2]) - clearance.origin) / clearance.resolution_m
    high = (np.array([piece.x + across / 2, piece.y + along / 2]) - clearance.origin) / clearance.resolution_m
    columns, rows = zip(np.rint(low).astype(int).tolist(), np.rint(high).astype(int).tolist(), strict=True)
    return slice(*rows), slice(*columns)


def _turn(cos: float, sin: float) -> np.ndarray:
    return np.array([[cos, -sin], [sin, cos]])


class ChangedScenes:
    """Creates the scenes of all states of one scene."""

    def __init__(self, base: Scene) -> None:
        """Start from an unchanged scene."""
        self.base = base
        self._pieces = {OWN_PREFIX + piece.name: piece for piece in base.parts.furniture}
        self._cache: dict[Hashable, object] = {}
        self._newest = AS_MADE, base

    def at(self, state: WorldState) -> Scene:
        """Return the scene in a state; the valid states are defined in `world_script`."""
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
        """Return the scene's own surfaces without moved furniture, with these pictures."""
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
        """Return the cached value of a key, or create it; the oldest value is dropped."""
        if key in self._cache:
            self._cache[key] = self._cache.pop(key)
        else:
            self._cache[key] = make()
            while len(self._cache) > _KEPT:
                self._cache.pop(next(iter(self._cache)))
        return cast(Made, self._cache[key])
