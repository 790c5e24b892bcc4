"""The leaves of closed doors. They slide out of the wall and fill the doorway, as thick as the wall."""

from functools import lru_cache

import numpy as np

from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.tiling_textures import hsv_colour, plain, wood
from ltvn_core.simulation.rooms import Doorway
from ltvn_core.simulation.surface_builder import SurfaceBuilder
from ltvn_core.types import Rgb
from ltvn_core.worlds.world_change import Outline

_LEAF_HEIGHT_M = 2.05
_LEAF_THICKNESS_M = 0.1
_KNOB_HEIGHT_M = 1.05


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
    knob, knob_size = (x + knob_at, y), (0.12, thick, 0.03)
    if doorway.axis == 0:
        size = (size[1], size[0], size[2])
        knob, knob_size = (x, y + knob_at), (thick, 0.12, 0.03)
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
        top, bottom = 10 + panel * 112 // panels, panel * 112 // panels + 112 // panels
        image[top:bottom, 16:112] *= 0.72
        image[top + 4 : bottom - 4, 20:108] /= 0.8
    return np.clip(image, 0, 255).astype(np.uint8)


@lru_cache(maxsize=1)
def _knob_texture() -> Rgb:
    return plain(SeededRng(np.random.default_rng(7)), hsv_colour(0.12, 0.2, 0.7), 16)
