"""Chooses the materials of an apartment and its rooms: woods, cloths, wall and floor coverings.

Walls and floors differ strongly between rooms; woods and cloths of furniture repeat throughout an apartment, as they do
in real ones.
"""

from dataclasses import dataclass

from ltvn_core.simulation.apartments import decals, tiling_textures
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.tiling_textures import ColourArray, hsv_colour
from ltvn_core.simulation.rooms import RoomKind
from ltvn_core.simulation.surfaces import SurfaceBuilder, TextureIndex

_WET = {RoomKind.BATH, RoomKind.KITCHEN}


@dataclass(frozen=True, slots=True)
class ApartmentMaterials:
    """Materials that all rooms of an apartment share."""

    woods: tuple[TextureIndex, ...]
    cloths: tuple[TextureIndex, ...]
    paints: tuple[TextureIndex, ...]
    books: tuple[TextureIndex, ...]
    white: TextureIndex
    metal: TextureIndex
    dark: TextureIndex
    green: TextureIndex
    ceiling: TextureIndex
    trim: TextureIndex


@dataclass(frozen=True, slots=True)
class RoomMaterials:
    """The coverings of one room."""

    wall: TextureIndex
    accent: TextureIndex
    """Covering of one of the four walls."""
    floor: TextureIndex
    floor_tile_m: float
    """Metres per repeat of the floor's texture."""


def choose_apartment_materials(builder: SurfaceBuilder, rng: SeededRng) -> ApartmentMaterials:
    """Choose the materials of an apartment and add their textures to the builder."""

    def paint(hue: float, saturation: float, value: float) -> TextureIndex:
        return builder.texture(tiling_textures.plain(rng, hsv_colour(hue, saturation, value)))

    return ApartmentMaterials(
        woods=tuple(builder.texture(tiling_textures.wood(rng, _wood(rng), size=128)) for _ in range(3)),
        cloths=tuple(builder.texture(tiling_textures.cloth(rng, _vivid(rng))) for _ in range(6)),
        paints=tuple(paint(rng.uniform(0, 1), rng.uniform(0.3, 0.8), rng.uniform(0.4, 0.9)) for _ in range(5)),
        books=tuple(builder.texture(decals.books(rng)) for _ in range(4)),
        white=paint(0.1, 0.02, 0.9),
        metal=paint(0.58, 0.05, 0.6),
        dark=paint(0.6, 0.1, 0.16),
        green=paint(rng.uniform(0.25, 0.38), 0.65, 0.5),
        ceiling=paint(0.12, 0.03, 0.94),
        trim=paint(0.1, rng.uniform(0, 0.15), rng.uniform(0.35, 0.98)),
    )


def choose_room_materials(builder: SurfaceBuilder, rng: SeededRng, kind: RoomKind, hue: float) -> RoomMaterials:
    """Choose the coverings of a room, with walls near a hue (one full turn is 1)."""
    base = hsv_colour(hue, rng.uniform(0.06, 0.38), rng.uniform(0.72, 0.97))
    contrast = hsv_colour(hue + rng.uniform(0.25, 0.75), rng.uniform(0.2, 0.6), rng.uniform(0.4, 0.88))
    wall = builder.texture(_wall(rng, kind, base, contrast))
    accent = builder.texture(_wall(rng, kind, contrast, base)) if rng.chance(0.55) else wall
    return RoomMaterials(
        wall=wall, accent=accent, floor=builder.texture(_floor(rng, kind, contrast)), floor_tile_m=rng.uniform(1.2, 2.0)
    )


def _wall(rng: SeededRng, kind: RoomKind, base: ColourArray, contrast: ColourArray) -> tiling_textures.Rgb:
    if kind is RoomKind.BATH:
        return tiling_textures.tiles(rng, base, contrast, count=8, joint=rng.uniform(150, 230))
    if rng.chance(0.1):
        return tiling_textures.brick(
            rng, hsv_colour(rng.uniform(0, 0.07), rng.uniform(0.3, 0.6), rng.uniform(0.5, 0.85))
        )
    return tiling_textures.wallpaper(rng, base, contrast)


def _floor(rng: SeededRng, kind: RoomKind, contrast: ColourArray) -> tiling_textures.Rgb:
    pale = hsv_colour(rng.uniform(0, 1), rng.uniform(0, 0.3), rng.uniform(0.6, 0.95))
    if kind in _WET:
        laid = rng.index(3)
        if laid == 0:
            return tiling_textures.tiles(rng, pale, contrast, count=rng.choice((2, 4)), joint=rng.uniform(90, 210))
        return tiling_textures.mosaic(rng, pale, contrast) if laid == 1 else tiling_textures.terrazzo(rng, pale)
    laid = rng.index(6)
    if laid < 3:
        return tiling_textures.wood(rng, _wood(rng), planks=rng.choice((4, 8)))
    if laid == 3:
        return tiling_textures.parquet(rng, _wood(rng))
    return tiling_textures.carpet(rng, _vivid(rng)) if laid == 4 else tiling_textures.terrazzo(rng, pale)


def _wood(rng: SeededRng) -> ColourArray:
    return hsv_colour(rng.uniform(0.04, 0.11), rng.uniform(0.3, 0.75), rng.uniform(0.3, 0.85))


def _vivid(rng: SeededRng) -> ColourArray:
    return hsv_colour(rng.uniform(0, 1), rng.uniform(0.15, 0.65), rng.uniform(0.3, 0.88))
