"""Other pictures on the walls and other rugs on the floors."""

import numpy as np

from ltvn_core.simulation.apartments.decals import painting, rug
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.scene_parts import SceneParts
from ltvn_core.types import Rgb


def exchanged_textures(textures: tuple[Rgb, ...], parts: SceneParts, seed: int) -> tuple[Rgb, ...]:
    """Return the textures of a scene with other paintings and rugs, drawn with a seed."""
    rng = SeededRng(np.random.default_rng((11, seed)))
    changed = list(textures)
    for texture in parts.paintings:
        changed[texture] = painting(rng.spawn())
    for texture in parts.rugs:
        changed[texture] = rug(rng.spawn())
    return tuple(changed)
