"""All textures of a scene and their mip-maps in one flat table, so that one gather colours all pixels."""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Rgb


class MipmapTable:
    """Textures, each with its mip-maps down to one pixel. Sides are powers of two."""

    def __init__(self, textures: tuple[Rgb, ...]) -> None:
        """Store textures (H, W, 3) and compute their mip-maps.

        Raises:
            ValueError: A side is not a power of two.
        """
        chains = [_halvings(texture) for texture in textures]
        self.levels = max(len(chain) for chain in chains)
        """Number of mip-map levels; a small texture repeats its last."""
        self._entries = np.zeros((len(textures) * self.levels, 4), np.int32)
        images: list[NDArray[np.float32]] = []
        end = 0
        for texture, chain in enumerate(chains):
            for level in range(self.levels):
                image = chain[min(level, len(chain) - 1)]
                height, width = image.shape[:2]
                if level < len(chain):
                    images.append(image.reshape(-1, 3))
                    end += height * width
                self._entries[texture * self.levels + level] = (
                    end - height * width,
                    width - 1,
                    height - 1,
                    width.bit_length() - 1,
                )
        self._texels = np.concatenate(images)

    def sizes(self) -> NDArray[np.float32]:
        """Return (T, 2): width and height of each texture in pixels."""
        return (self._entries[:: self.levels, 1:3] + 1).astype(np.float32)

    def sample(
        self,
        texture: NDArray[np.int32],
        level: NDArray[np.int32],
        column: NDArray[np.floating],
        row: NDArray[np.floating],
    ) -> NDArray[np.float32]:
        """Return the colours (N, 3) at columns and rows (N,) of the full-size texture; both wrap around."""
        entry = self._entries[texture * np.int32(self.levels) + level]
        # Columns are never negative, so cutting the fraction off and shifting is a division rounded down.
        column_at = (column.astype(np.int32) >> level) & entry[:, 1]
        row_at = (row.astype(np.int32) >> level) & entry[:, 2]
        return self._texels[entry[:, 0] + (row_at << entry[:, 3]) + column_at]


def _halvings(texture: Rgb) -> list[NDArray[np.float32]]:
    """Return a texture and its mip-maps, each half as wide and high as the one before, down to one pixel."""
    height, width = texture.shape[:2]
    if height & (height - 1) or width & (width - 1):
        raise ValueError(f"A texture's sides must be powers of two, got {width} x {height}.")
    chain = [texture.astype(np.float32)]
    while max(chain[-1].shape[:2]) > 1:
        image = chain[-1]
        if image.shape[0] > 1:
            image = (image[0::2] + image[1::2]) / 2
        if image.shape[1] > 1:
            image = (image[:, 0::2] + image[:, 1::2]) / 2
        chain.append(image.astype(np.float32, copy=False))
    return chain
