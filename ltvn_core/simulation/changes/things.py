"""What a world adds to its scene: things that are put down, the leaves of closed doors, and people.

Owns what each looks like and where it stands. Leaves slide out of the wall and fill the doorway, as thick as the wall.
A person has two legs, a long wide coat, arms and a head, in clothes of their own.
"""

import zlib
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, Never, assert_never

import numpy as np
from numpy.typing import NDArray

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
from ltvn_core.simulation.rooms import Doorway
from ltvn_core.simulation.surface_builder import SurfaceBuilder, TextureIndex, rounded_cos_sin
from ltvn_core.simulation.surfaces import Surfaces, joined
from ltvn_core.types import Rgb
from ltvn_core.worlds.world_change import Outline, PersonMoved, ThingKind, ThingPlaced

_LEAF_HEIGHT_M = 2.05
_LEAF_THICKNESS_M = 0.1
_KNOB_HEIGHT_M = 1.05
_HEM_M, _WAIST_M = 0.12, 0.85
"""From how high to how high the wide part of the coat reaches,"""
_INSIDE_M = 0.002
"""and how far inside of what can be touched it stays."""
_SEAT_SHARE = 0.5
"""Height of a chair's seat as a share of the height of its back."""
_LEG_M = 0.05


def leaf_outline(doorway: Doorway) -> Outline:
    """Return where a closed door stands."""
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
    """Return where a person stands."""
    x, y, yaw = person.pose
    return Outline(x=x, y=y, yaw=yaw, width=2 * PERSON_RADIUS_M, depth=2 * PERSON_RADIUS_M, height=PERSON_HEIGHT_M)


def people_surfaces(people: tuple[PersonMoved, ...]) -> Surfaces | None:
    """Return people where they stand; None if there are none.

    The same people give the same textures wherever they walk, so that a renderer prepares these once.
    """
    if not people:
        return None
    crowd = _crowd(tuple(person.seed for person in people))
    poses = np.array([person.pose for person in people], np.float64)[crowd.owner]
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, z = crowd.surfaces.vertices.T.astype(np.float64)
    at = np.stack([poses[:, 0] + cos * x - sin * y, poses[:, 1] + sin * x + cos * y, z], axis=-1)
    return replace(crowd.surfaces, vertices=at.astype(np.float32))


class _Crowd(NamedTuple):
    """Several people, each in a frame of its own: x ahead, y to the left, the origin on the floor."""

    surfaces: Surfaces
    owner: NDArray[np.intp]
    """(V,) to which of the people each vertex belongs."""


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
    # As wide as what a robot can touch: the camera must not see thin legs where the bumper meets a wide body.
    builder.cylinder(coat, (0.0, 0.0, _HEM_M), PERSON_RADIUS_M - _INSIDE_M, _WAIST_M - _HEM_M, sides=24)
    builder.cylinder(coat, (0.0, 0.0, _WAIST_M), 0.22, 1.42 - _WAIST_M, top_radius=0.17, sides=16)
    builder.cylinder(skin, (0.0, 0.0, 1.42), 0.09, 0.2)
    builder.cylinder(hair, (0.0, 0.0, 1.62), 0.1, 0.08, top_radius=0.06)
    return builder.build()


def add_thing(builder: SurfaceBuilder, placed: ThingPlaced) -> None:
    """Add a thing; its name decides its colours, so that it looks the same wherever it is put."""
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
    raise ValueError(f"{placed.thing} has surfaces of its own; see changed_scenes.")


def _add_box(builder: SurfaceBuilder, placed: ThingPlaced, rng: SeededRng) -> None:
    width, depth, height = placed.size
    _part(builder, placed, builder.texture(_cardboard(rng)), (0, 0, 0), (width, depth, height), whole=True)


def _add_basket(builder: SurfaceBuilder, placed: ThingPlaced, rng: SeededRng) -> None:
    x, y, _ = placed.pose
    radius, height = min(placed.size[:2]) / 2, placed.size[2]
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
    left, top = 12 + rng.index(30), 50 + rng.index(40)
    image[top : top + 26, left : left + 36] = 245
    ink = plain(rng, hsv_colour(rng.uniform(0, 1), 0.8, 0.5), 16)[0, 0]
    for line in range(3):
        image[top + 5 + 7 * line : top + 8 + 7 * line, left + 4 : left + 12 + rng.index(22)] = ink
    return to_uint8(image)
