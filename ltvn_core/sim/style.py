"""What an apartment and its rooms are made of: woods, cloths, wall and floor coverings.

Owns the choice of materials. Rooms differ strongly from each other, furniture woods and cloths repeat throughout an
apartment, as they do in real ones.
"""

from dataclasses import dataclass

from ltvn_core.sim import pictures, textures
from ltvn_core.sim.builder import SurfaceBuilder, Texture
from ltvn_core.sim.dice import Dice
from ltvn_core.sim.floorplan import RoomKind
from ltvn_core.sim.textures import Colour, colour

_WET = {RoomKind.BATH, RoomKind.KITCHEN}


@dataclass(frozen=True, slots=True)
class Household:
    """Materials that all rooms of an apartment share."""

    woods: tuple[Texture, ...]
    cloths: tuple[Texture, ...]
    paints: tuple[Texture, ...]
    books: tuple[Texture, ...]
    white: Texture
    metal: Texture
    dark: Texture
    green: Texture
    ceiling: Texture
    trim: Texture


@dataclass(frozen=True, slots=True)
class RoomStyle:
    """The coverings of one room."""

    wall: Texture
    accent: Texture
    """Of one wall."""
    floor: Texture
    floor_tile_m: float


def equip(builder: SurfaceBuilder, dice: Dice) -> Household:
    """Choose the materials of an apartment."""

    def paint(hue: float, saturation: float, value: float) -> Texture:
        return builder.texture(textures.plain(dice, colour(hue, saturation, value)))

    return Household(
        woods=tuple(builder.texture(textures.wood(dice, _wood(dice), size=128)) for _ in range(3)),
        cloths=tuple(builder.texture(textures.cloth(dice, _vivid(dice))) for _ in range(6)),
        paints=tuple(paint(dice.uniform(0, 1), dice.uniform(0.3, 0.8), dice.uniform(0.4, 0.9)) for _ in range(5)),
        books=tuple(builder.texture(pictures.books(dice)) for _ in range(4)),
        white=paint(0.1, 0.02, 0.9),
        metal=paint(0.58, 0.05, 0.6),
        dark=paint(0.6, 0.1, 0.16),
        green=paint(dice.uniform(0.25, 0.38), 0.65, 0.5),
        ceiling=paint(0.12, 0.03, 0.94),
        trim=paint(0.1, dice.uniform(0, 0.15), dice.uniform(0.35, 0.98)),
    )


def decorate(builder: SurfaceBuilder, dice: Dice, kind: RoomKind, hue: float) -> RoomStyle:
    """Choose the coverings of a room around a hue."""
    base = colour(hue, dice.uniform(0.06, 0.38), dice.uniform(0.72, 0.97))
    contrast = colour(hue + dice.uniform(0.25, 0.75), dice.uniform(0.2, 0.6), dice.uniform(0.4, 0.88))
    wall = builder.texture(_wall(dice, kind, base, contrast))
    accent = builder.texture(_wall(dice, kind, contrast, base)) if dice.chance(0.55) else wall
    return RoomStyle(wall, accent, builder.texture(_floor(dice, kind, contrast)), dice.uniform(1.2, 2.0))


def _wall(dice: Dice, kind: RoomKind, base: Colour, contrast: Colour) -> textures.Rgb:
    if kind is RoomKind.BATH:
        return textures.tiles(dice, base, contrast, count=8, joint=dice.uniform(150, 230))
    if dice.chance(0.1):
        return textures.brick(dice, colour(dice.uniform(0, 0.07), dice.uniform(0.3, 0.6), dice.uniform(0.5, 0.85)))
    return textures.wallpaper(dice, base, contrast)


def _floor(dice: Dice, kind: RoomKind, contrast: Colour) -> textures.Rgb:
    pale = colour(dice.uniform(0, 1), dice.uniform(0, 0.3), dice.uniform(0.6, 0.95))
    if kind in _WET:
        laid = dice.index(3)
        if laid == 0:
            return textures.tiles(dice, pale, contrast, count=dice.pick((2, 4)), joint=dice.uniform(90, 210))
        return textures.mosaic(dice, pale, contrast) if laid == 1 else textures.terrazzo(dice, pale)
    laid = dice.index(6)
    if laid < 3:
        return textures.wood(dice, _wood(dice), planks=dice.pick((4, 8)))
    if laid == 3:
        return textures.parquet(dice, _wood(dice))
    return textures.carpet(dice, _vivid(dice)) if laid == 4 else textures.terrazzo(dice, pale)


def _wood(dice: Dice) -> Colour:
    return colour(dice.uniform(0.04, 0.11), dice.uniform(0.3, 0.75), dice.uniform(0.3, 0.85))


def _vivid(dice: Dice) -> Colour:
    return colour(dice.uniform(0, 1), dice.uniform(0.15, 0.65), dice.uniform(0.3, 0.88))
