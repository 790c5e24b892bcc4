"""Images that fill one plate and do not repeat: paintings, views from windows, rugs, rows of books, goods, clocks.

Repeating materials are in `tiling_textures`. The order of the random draws decides what a seed generates, so it must
not change.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.tiling_textures import (
    TEXTURE_SIZE,
    ColourArray,
    hsv_colour,
    pixel_grid,
    tiling_noise,
    to_uint8,
)
from ltvn_core.types import Rgb

ImageArray = NDArray[np.float64]
"""(H, W, 3) in [0, 255], before rounding."""


def painting(rng: SeededRng) -> Rgb:
    """Return a painting in a frame, (128, 128, 3)."""
    image = rng.choice((_shapes, _landscape, _marble, _bands, _rings, _bouquet))(rng, 128)
    frame = rng.uniform(20, 235) * np.array([1.0, rng.uniform(0.8, 1.0), rng.uniform(0.5, 1.0)])
    if rng.chance(0.4):
        _frame(image, 16, np.array([240.0, 238.0, 230.0]))
    _frame(image, 7, frame)
    return to_uint8(image)


def window_view(rng: SeededRng) -> Rgb:
    """Return the view through a window with its frame and bars, (256, 256, 3)."""
    _, row = pixel_grid()
    sky = hsv_colour(rng.uniform(0.53, 0.62), rng.uniform(0.15, 0.5), 1.0)
    image = sky + (255 - sky) * (row / TEXTURE_SIZE)[..., None] + np.zeros((TEXTURE_SIZE, TEXTURE_SIZE, 1))
    image = image + (tiling_noise(rng, cells=(3, 2)) > 0.6)[..., None] * (250 - image) * 0.7
    rng.choice((_city, _hills, _trees, _sea))(rng, image)
    for i in range(1, rng.index(3) + 1):
        bar = TEXTURE_SIZE * i // (rng.index(2) + 2) % TEXTURE_SIZE
        image[:, max(bar - 5, 0) : bar + 5] = 238
    if rng.chance(0.4):
        image[TEXTURE_SIZE // 3 : TEXTURE_SIZE // 3 + 8] = 238
    _frame(image, 13, np.array([240.0, 240.0, 238.0]))
    return to_uint8(image)


def rug(rng: SeededRng) -> Rgb:
    """Return a rug with a border and figures, (256, 256, 3)."""
    column, row = pixel_grid()
    across = np.abs(column - TEXTURE_SIZE / 2 + 0.5)
    down = np.abs(row - TEXTURE_SIZE / 2 + 0.5)
    square = np.maximum(across, down)
    round_ = np.sqrt(across**2 + down**2)
    diamond = (across + down) * 0.8
    image = np.broadcast_to(_any_colour(rng), (TEXTURE_SIZE, TEXTURE_SIZE, 3)).copy()
    for _ in range(5):
        radius = rng.uniform(10, 118)
        width = rng.uniform(5, 22)
        figure = rng.choice((square, square, round_, diamond))
        image[(figure > radius) & (figure < radius + width)] = _any_colour(rng)
    image[np.broadcast_to((square > 118) & ((column // 4) % 2 == 0), (TEXTURE_SIZE, TEXTURE_SIZE))] = _any_colour(rng)
    return to_uint8(image * (0.9 + 0.15 * tiling_noise(rng, octaves=6))[..., None])


def books(rng: SeededRng) -> Rgb:
    """Return the backs of a row of books on a dark shelf, (64, 128, 3)."""
    image = np.full((64, 128, 3), 32.0)
    hue = rng.uniform(0, 1)
    left = 0
    while left < 128:
        width = 3 + rng.index(7)
        height = 40 + rng.index(22)
        back = hsv_colour(hue + rng.uniform(-0.3, 0.3), rng.uniform(0.2, 0.9), rng.uniform(0.25, 0.95))
        if rng.chance(0.92):
            image[64 - height :, left : left + width] = back
            band = 64 - height + 6 + rng.index(12)
            image[band : band + 4, left : left + width] = 255 - back * 0.6
            image[64 - height :, left : left + 1] *= 0.6
        left += width
    return to_uint8(image)


def goods(rng: SeededRng) -> Rgb:
    """Return packets on a shop's shelf, a few of each kind side by side, (64, 256, 3)."""
    image = np.full((64, 256, 3), 40.0)
    left = 1
    while left < 256:
        width = 8 + rng.index(20)
        top = 2 + rng.index(28)
        label = top + 4 + rng.index(20)
        packet = _any_colour(rng)
        print_ = _any_colour(rng)
        for _ in range(1 + rng.index(4)):
            image[top:, left : left + width] = packet
            image[label : label + 14, left + 2 : left + width - 2] = print_
            image[top:, left + width - 1 : left + width] *= 0.5
            left += width + 1
    return to_uint8(image)


def clock(rng: SeededRng) -> Rgb:
    """Return the face of a clock, (64, 64, 3)."""
    column, row = pixel_grid(64)
    across = column - 31.5
    down = row - 31.5
    round_ = np.sqrt(across**2 + down**2)
    image = np.broadcast_to(_any_colour(rng), (64, 64, 3)).copy()
    image[round_ < 27] = (245, 243, 235)
    image[(round_ > 21) & (round_ < 25) & ((np.abs(across) < 2) | (np.abs(down) < 2))] = 30
    image[(np.abs(across) < 2) & (down < 0) & (round_ < 20)] = 30
    image[(np.abs(down) < 2) & (across * rng.choice((1, -1)) > 0) & (round_ < 14)] = 30
    return to_uint8(image)


def _any_colour(rng: SeededRng) -> ColourArray:
    return hsv_colour(rng.uniform(0, 1), rng.uniform(0.25, 0.9), rng.uniform(0.3, 0.95))


def _frame(image: ImageArray, width: int, paint: ColourArray) -> None:
    image[:width] = image[-width:] = paint
    image[:, :width] = image[:, -width:] = paint


def _outline(rng: SeededRng, size: int, *, cells: int = 4) -> NDArray[np.float64]:
    """Return a wavy line (size,) in [0, 1]."""
    return tiling_noise(rng, size, octaves=4, cells=(1, cells))[0]


def _shapes(rng: SeededRng, size: int) -> ImageArray:
    column, row = pixel_grid(size)
    hue = rng.uniform(0, 1)
    image = np.broadcast_to(hsv_colour(hue, rng.uniform(0.05, 0.5), 0.95), (size, size, 3)).copy()
    for _ in range(5 + rng.index(8)):
        x = rng.uniform(0, size)
        y = rng.uniform(0, size)
        radius = rng.uniform(0.06, 0.3) * size
        if rng.chance(0.5):
            inside = (column - x) ** 2 + (row - y) ** 2 < radius**2
        else:
            inside = (np.abs(column - x) < radius) & (np.abs(row - y) < radius * rng.uniform(0.3, 1.5))
        image[inside] = hsv_colour(hue + rng.choice((0, 0.1, 0.33, 0.5)), rng.uniform(0.3, 1), rng.uniform(0.2, 1))
    return image


def _landscape(rng: SeededRng, size: int) -> ImageArray:
    _, row = pixel_grid(size)
    sky = hsv_colour(rng.choice((0.08, 0.55, 0.6, 0.95)), rng.uniform(0.3, 0.6), 0.97)
    image = sky + (255 - sky) * (0.8 * row / size)[..., None] + np.zeros((size, size, 1))
    hue = rng.uniform(0.1, 0.5)
    for layer in range(4):
        top = size * (0.3 + 0.15 * layer + 0.25 * _outline(rng, size))
        image[row > top[None]] = hsv_colour(hue + 0.04 * layer, 0.55, 0.8 - 0.16 * layer)
    return image


def _marble(rng: SeededRng, size: int) -> ImageArray:
    hue = rng.uniform(0, 1)
    mix = tiling_noise(rng, size)[..., None]
    image = hsv_colour(hue, 0.8, 0.9) * mix + hsv_colour(hue + 0.4, 0.7, 0.4) * (1 - mix)
    image[tiling_noise(rng, size) > 0.62] = hsv_colour(hue + 0.2, 0.9, 0.95)
    return image


def _bands(rng: SeededRng, size: int) -> ImageArray:
    image = np.zeros((size, size, 3))
    top = 0
    hue = rng.uniform(0, 1)
    while top < size:
        height = 8 + rng.index(28)
        image[top : top + height] = hsv_colour(hue + rng.uniform(0, 0.4), rng.uniform(0.2, 0.9), rng.uniform(0.3, 1))
        top += height
    return image if rng.chance(0.5) else image.transpose(1, 0, 2).copy()


def _rings(rng: SeededRng, size: int) -> ImageArray:
    column, row = pixel_grid(size)
    x = rng.uniform(0.2, 0.8) * size
    y = rng.uniform(0.2, 0.8) * size
    width = rng.uniform(6, 16)
    ring = np.sqrt((column - x) ** 2 + (row - y) ** 2) // width
    palette = np.array([_any_colour(rng) for _ in range(3)])
    return palette[ring.astype(np.intp) % 3]


def _bouquet(rng: SeededRng, size: int) -> ImageArray:
    column, row = pixel_grid(size)
    image = np.broadcast_to(hsv_colour(rng.uniform(0, 1), 0.2, rng.uniform(0.3, 0.95)), (size, size, 3)).copy()
    image[(np.abs(column - size / 2) < size * 0.12) & (row > size * 0.6)] = _any_colour(rng)
    for _ in range(14):
        x = rng.uniform(0.2, 0.8) * size
        y = rng.uniform(0.12, 0.62) * size
        distance = (column - x) ** 2 + (row - y) ** 2
        image[distance < (size * 0.09) ** 2] = _any_colour(rng) if rng.chance(0.7) else hsv_colour(0.33, 0.6, 0.5)
        image[distance < (size * 0.03) ** 2] = hsv_colour(0.13, 0.8, 0.95)
    return image


def _city(rng: SeededRng, image: ImageArray) -> None:
    for _ in range(5 + rng.index(5)):
        left = rng.index(TEXTURE_SIZE - 30)
        width = 22 + rng.index(45)
        top = 60 + rng.index(130)
        house = hsv_colour(rng.uniform(0, 1), rng.uniform(0.05, 0.4), rng.uniform(0.4, 0.85))
        image[top:, left : left + width] = house
        image[top + 8 :: 16, left + 4 : left + width - 4] = house * 0.6


def _hills(rng: SeededRng, image: ImageArray) -> None:
    _, row = pixel_grid()
    for layer in range(3):
        top = TEXTURE_SIZE * (0.4 + 0.15 * layer + 0.2 * _outline(rng, TEXTURE_SIZE))
        image[row > top[None]] = hsv_colour(0.25 + 0.05 * rng.index(3), 0.3 + 0.12 * layer, 0.8 - 0.13 * layer)


def _trees(rng: SeededRng, image: ImageArray) -> None:
    column, row = pixel_grid()
    image[int(TEXTURE_SIZE * 0.72) :] = hsv_colour(rng.uniform(0.22, 0.33), 0.5, 0.65)
    for _ in range(3 + rng.index(4)):
        x = rng.uniform(0, TEXTURE_SIZE)
        y = rng.uniform(90, 170)
        radius = rng.uniform(26, 60)
        image[y.__trunc__() :, max(int(x) - 5, 0) : int(x) + 5] = hsv_colour(0.07, 0.5, 0.35)
        leaves = (column - x) ** 2 + (row - y) ** 2 < (radius * (0.7 + 0.6 * tiling_noise(rng, octaves=3))) ** 2
        image[leaves] = hsv_colour(rng.uniform(0.2, 0.36), 0.6, rng.uniform(0.35, 0.65))


def _sea(rng: SeededRng, image: ImageArray) -> None:
    _, row = pixel_grid()
    image[int(TEXTURE_SIZE * 0.55) :] = hsv_colour(rng.uniform(0.5, 0.6), 0.6, 0.7)
    island = TEXTURE_SIZE * (0.55 - 0.2 * np.maximum(_outline(rng, TEXTURE_SIZE, cells=3) - 0.4, 0))
    image[(row > island[None]) & (row < TEXTURE_SIZE * 0.56)] = hsv_colour(0.3, 0.4, 0.45)
    image[int(TEXTURE_SIZE * 0.8) :] = hsv_colour(0.12, 0.35, 0.9)
