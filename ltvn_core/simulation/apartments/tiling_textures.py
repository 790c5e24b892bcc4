"""Textures that repeat without a seam: wood, tiles, wallpaper, carpet, cloth and paint.

`materials` decides where they are used; images that do not repeat are in `decals`. The order of the random draws
decides what a seed generates, so it must not change.
"""

import colorsys

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.types import Rgb

TEXTURE_SIZE = 256
"""Side of a detailed texture in pixels; plain materials use less."""

_ROUGHNESS = 0.07
"""Range of the brightness of paint and plaster."""

ColourArray = NDArray[np.float64]
"""(3,) in [0, 255]."""

NoisePattern = NDArray[np.float64]
"""(N, N) in [0, 1]."""


def hsv_colour(hue: float, saturation: float, value: float) -> ColourArray:
    """Return a colour from hue (any number, one turn is 1), saturation and value."""
    return np.array(colorsys.hsv_to_rgb(hue % 1.0, saturation, value)) * 255


def to_uint8(image: NDArray[np.float64]) -> Rgb:
    """Round an image (H, W, 3) to bytes."""
    return np.clip(np.floor(image + 0.5), 0, 255).astype(np.uint8)


def pixel_grid(size: int = TEXTURE_SIZE) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the column (1, N) and row (N, 1) indices of a square image."""
    steps = np.arange(size)
    return steps[None, :], steps[:, None]


def tiling_noise(
    rng: SeededRng, size: int = TEXTURE_SIZE, *, octaves: int = 4, cells: tuple[int, int] = (4, 4)
) -> NoisePattern:
    """Return repeating value noise (size, size) in [0, 1]; `cells` are rows and columns of its coarsest lattice."""
    total = np.zeros((size, size))
    for octave in range(octaves):
        lattice = rng.uniform_array(min(cells[0] << octave, size), min(cells[1] << octave, size))
        total += _stretched(_stretched(lattice, size).T, size).T / (1 << octave)
    return (total - total.min()) / (total.max() - total.min())


def plain(rng: SeededRng, base: ColourArray, size: int = 64) -> Rgb:
    """Return paint or plaster."""
    return to_uint8(base * (1 - _ROUGHNESS / 2 + _ROUGHNESS * tiling_noise(rng, size, cells=(2, 2)))[..., None])


def wood(rng: SeededRng, base: ColourArray, *, planks: int = 1, size: int = TEXTURE_SIZE) -> Rgb:
    """Return wood with its grain along the columns; several planks make a floor."""
    column, row = pixel_grid(size)
    grain = tiling_noise(rng, size, octaves=5, cells=(16, 2))
    width = size // planks
    plank = row // width
    shade = np.array([rng.uniform(0.84, 1.12) for _ in range(planks)])[plank]
    shift = np.array([rng.index(size) for _ in range(planks)])[plank]
    grain = np.take_along_axis(grain, (column + shift) % size, 1)
    brightness = shade * (0.76 + 0.38 * grain)
    if planks > 1:
        brightness = np.where((row % width < 2) | ((column + 3 * shift) % size < 2), brightness * 0.6, brightness)
    return to_uint8(base * brightness[..., None])


def parquet(rng: SeededRng, base: ColourArray) -> Rgb:
    """Return a parquet floor: square blocks of strips, turned alternately by a right angle."""
    column, row = pixel_grid()
    block = 64
    strip = 16
    turned = ((column // block + row // block) % 2).astype(bool)
    along = np.where(turned, row, column)
    across = np.where(turned, column, row)
    tone = rng.uniform_array(16, 16)[across // strip, along // block]
    brightness = (0.82 + 0.3 * tone) * (0.9 + 0.15 * tiling_noise(rng, octaves=5, cells=(8, 8)))
    return to_uint8(base * np.where(across % strip < 1, brightness * 0.6, brightness)[..., None])


def tiles(rng: SeededRng, base: ColourArray, other: ColourArray, *, count: int, joint: float) -> Rgb:
    """Return `count` by `count` tiles in two colours with joints of a grey `joint` in [0, 255]."""
    column, row = pixel_grid()
    side = TEXTURE_SIZE // count
    second = ((column // side + row // side) % 2).astype(bool)[..., None]
    image = np.where(second, other, base) * (0.9 + 0.15 * tiling_noise(rng))[..., None]
    image[(column % side < 3) | (row % side < 3)] = joint
    return to_uint8(image)


def mosaic(rng: SeededRng, base: ColourArray, other: ColourArray) -> Rgb:
    """Return small tiles that mix two colours at random."""
    column, row = pixel_grid()
    side = TEXTURE_SIZE // 16
    mix = rng.uniform_array(16, 16)[row // side, column // side][..., None]
    image = base * mix + other * (1 - mix)
    image[(column % side < 2) | (row % side < 2)] = 215
    return to_uint8(image)


def terrazzo(rng: SeededRng, base: ColourArray) -> Rgb:
    """Return a speckled stone floor."""
    image = np.broadcast_to(base, (TEXTURE_SIZE, TEXTURE_SIZE, 3)).copy()
    for _ in range(3):
        image[tiling_noise(rng, octaves=2, cells=(32, 32)) > 0.72] = hsv_colour(
            rng.uniform(0, 1), rng.uniform(0.1, 0.6), rng.uniform(0.3, 0.9)
        )
    return to_uint8(image)


def carpet(rng: SeededRng, base: ColourArray) -> Rgb:
    """Return a fleecy floor with a faint pattern."""
    column, row = pixel_grid(128)
    weave = 0.82 + 0.1 * tiling_noise(rng, 128, cells=(4, 4)) + 0.16 * rng.uniform_array(128, 128)
    if rng.chance(0.5):
        weave *= np.where((column // 16 + row // 16) % 2 == 0, 1.0, rng.uniform(0.75, 0.9))
    return to_uint8(base * weave[..., None])


def cloth(rng: SeededRng, base: ColourArray) -> Rgb:
    """Return woven cloth: plain, striped or checked."""
    column, row = pixel_grid(128)
    weave = 0.84 + 0.08 * ((column // 2 + row // 2) % 2) + 0.1 * tiling_noise(rng, 128, cells=(4, 4))
    kind = rng.index(4)
    width = 8 << rng.index(2)
    dark = rng.uniform(0.55, 0.8)
    if kind == 1:
        weave = weave * np.where((column // width) % 3 == 0, dark, 1.0)
    if kind == 2:
        weave = weave * np.where((column // width) % 2 == 0, dark, 1.0) * np.where((row // width) % 2 == 0, dark, 1.0)
    return to_uint8(base * weave[..., None])


def wallpaper(rng: SeededRng, base: ColourArray, accent: ColourArray) -> Rgb:
    """Return a wall from floor to ceiling: a pattern, often with a lower panel or a border in the accent colour.

    The height of the image is the height of the room.
    """
    column, _ = pixel_grid()
    image = base * (0.95 + 0.07 * tiling_noise(rng, octaves=5))[..., None]
    pattern = rng.choice((_nothing, _stripes, _dots, _waves, _diamonds, _nothing))(rng)
    image[pattern] = image[pattern] * 0.35 + 0.65 * (0.5 * base + 0.5 * accent)
    lower = rng.index(4)
    height = TEXTURE_SIZE - int(TEXTURE_SIZE * rng.uniform(0.3, 0.42))
    if lower == 0:  # A painted panel with a rail.
        image[height:] = accent * (0.95 + 0.07 * tiling_noise(rng))[height:, :, None]
        image[height - 5 : height] = 235
    elif lower == 1:  # Wooden boards with a rail.
        boards = np.where(column % 32 < 2, 0.7, 1.0) * (0.93 + 0.1 * tiling_noise(rng, cells=(2, 16)))
        image[height:] = (0.4 * accent + 0.6 * 225) * boards[height:, :, None]
        image[height - 5 : height] = accent * 0.7
    elif lower == 2:  # A border under the ceiling.
        image[18:34] = np.where(((column // 16) % 2 == 0)[..., None], accent, 0.5 * accent + 0.5 * base)
    return to_uint8(image)


def brick(rng: SeededRng, base: ColourArray) -> Rgb:
    """Return a brick wall."""
    column, row = pixel_grid()
    course = row // 16
    shifted = column + (course % 2) * 16
    tone = rng.uniform_array(16, 9)[course % 16, (shifted // 32) % 8]
    image = base * ((0.8 + 0.35 * tone) * (0.9 + 0.15 * tiling_noise(rng, octaves=5)))[..., None]
    image[(row % 16 < 2) | (shifted % 32 < 2)] = 195
    return to_uint8(image)


def _nothing(rng: SeededRng) -> NDArray[np.bool_]:
    return np.zeros((TEXTURE_SIZE, TEXTURE_SIZE), bool)


def _stripes(rng: SeededRng) -> NDArray[np.bool_]:
    column, row = pixel_grid()
    width = 8 << rng.index(3)
    return ((column // width) % 2 == 0) & (row >= 0)


def _dots(rng: SeededRng) -> NDArray[np.bool_]:
    column, row = pixel_grid()
    pitch = 32 << rng.index(2)
    across = (column + (row // pitch % 2) * pitch // 2) % pitch - pitch / 2
    down = row % pitch - pitch / 2
    return across**2 + down**2 < (pitch * rng.uniform(0.15, 0.3)) ** 2


def _waves(rng: SeededRng) -> NDArray[np.bool_]:
    column, row = pixel_grid()
    pitch = 32 << rng.index(2)
    triangle = np.abs((column % pitch) - pitch / 2)
    return ((row + triangle) // (pitch // 4)) % 3 == 0


def _diamonds(rng: SeededRng) -> NDArray[np.bool_]:
    column, row = pixel_grid()
    pitch = 32 << rng.index(2)
    spread = np.abs(column % pitch - pitch / 2) + np.abs(row % pitch - pitch / 2)
    return (spread < pitch * 0.35) & (spread > pitch * rng.uniform(0.0, 0.25))


def _stretched(lattice: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Interpolate rows (M, K) linearly and cyclically to (size, K)."""
    count = len(lattice)
    at = np.arange(size) * count / size
    low = at.astype(np.intp)
    part = (at - low)[:, None]
    return lattice[low] * (1 - part) + lattice[(low + 1) % count] * part
