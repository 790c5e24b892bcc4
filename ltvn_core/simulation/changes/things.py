"""What things look like: boxes, baskets and chairs that somebody puts down."""

import zlib
from typing import Never, assert_never

import numpy as np

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
from ltvn_core.simulation.surface_builder import SurfaceBuilder, TextureIndex, rounded_cos_sin
from ltvn_core.types import Rgb
from ltvn_core.worlds.world_change import Outline, ThingKind, ThingPlaced

_SEAT_SHARE = 0.5
"""Height of a chair's seat as a share of the height of its back."""
_LEG_M = 0.05


def thing_outline(placed: ThingPlaced) -> Outline:
    """Return where a thing stands."""
    (x, y, yaw), (width, depth, height) = placed.pose, placed.size
    return Outline(x=x, y=y, yaw=yaw, width=width, depth=depth, height=height)


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
