"""Pictures that hang, lie or stand in rooms: paintings, views from windows, rugs, rows of books, doors, screens.

Owns images that are fitted once onto a plate; repeating materials are in `textures`.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.sim.dice import Dice
from ltvn_core.sim.textures import SIZE, Colour, colour, grid, noise, rgb
from ltvn_core.types import Rgb

Canvas = NDArray[np.float64]


def painting(dice: Dice) -> Rgb:
    """Return a framed picture."""
    image = dice.pick((_shapes, _landscape, _marble, _bands, _rings, _bouquet))(dice, 128)
    frame = dice.uniform(20, 235) * np.array([1.0, dice.uniform(0.8, 1.0), dice.uniform(0.5, 1.0)])
    if dice.chance(0.4):
        _frame(image, 16, np.array([240.0, 238.0, 230.0]))
    _frame(image, 7, frame)
    return rgb(image)


def window_view(dice: Dice) -> Rgb:
    """Return what one sees through a window, with its frame and bars."""
    _, row = grid()
    sky = colour(dice.uniform(0.53, 0.62), dice.uniform(0.15, 0.5), 1.0)
    image = sky + (255 - sky) * (row / SIZE)[..., None] + np.zeros((SIZE, SIZE, 1))
    image = image + (noise(dice, cells=(3, 2)) > 0.6)[..., None] * (250 - image) * 0.7
    dice.pick((_city, _hills, _trees, _sea))(dice, image)
    for i in range(1, dice.index(3) + 1):
        bar = SIZE * i // (dice.index(2) + 2) % SIZE
        image[:, max(bar - 5, 0) : bar + 5] = 238
    if dice.chance(0.4):
        image[SIZE // 3 : SIZE // 3 + 8] = 238
    _frame(image, 13, np.array([240.0, 240.0, 238.0]))
    return rgb(image)


def rug(dice: Dice) -> Rgb:
    """Return a carpet with a border and a figure."""
    column, row = grid()
    across, down = np.abs(column - SIZE / 2 + 0.5), np.abs(row - SIZE / 2 + 0.5)
    square, round_, diamond = np.maximum(across, down), np.sqrt(across**2 + down**2), (across + down) * 0.8
    image = np.broadcast_to(_any_colour(dice), (SIZE, SIZE, 3)).copy()
    for _ in range(5):
        radius, width = dice.uniform(10, 118), dice.uniform(5, 22)
        figure = dice.pick((square, square, round_, diamond))
        image[(figure > radius) & (figure < radius + width)] = _any_colour(dice)
    image[np.broadcast_to((square > 118) & ((column // 4) % 2 == 0), (SIZE, SIZE))] = _any_colour(dice)
    return rgb(image * (0.9 + 0.15 * noise(dice, octaves=6))[..., None])


def books(dice: Dice) -> Rgb:
    """Return the backs of a row of books on a dark shelf."""
    image = np.full((64, 128, 3), 32.0)
    hue, left = dice.uniform(0, 1), 0
    while left < 128:
        width, height = 3 + dice.index(7), 40 + dice.index(22)
        back = colour(hue + dice.uniform(-0.3, 0.3), dice.uniform(0.2, 0.9), dice.uniform(0.25, 0.95))
        if dice.chance(0.92):
            image[64 - height :, left : left + width] = back
            band = 64 - height + 6 + dice.index(12)
            image[band : band + 4, left : left + width] = 255 - back * 0.6
            image[64 - height :, left : left + 1] *= 0.6
        left += width
    return rgb(image)


def clock(dice: Dice) -> Rgb:
    """Return the face of a clock."""
    column, row = grid(64)
    across, down = column - 31.5, row - 31.5
    round_ = np.sqrt(across**2 + down**2)
    image = np.broadcast_to(_any_colour(dice), (64, 64, 3)).copy()
    image[round_ < 27] = (245, 243, 235)
    image[(round_ > 21) & (round_ < 25) & ((np.abs(across) < 2) | (np.abs(down) < 2))] = 30
    image[(np.abs(across) < 2) & (down < 0) & (round_ < 20)] = 30
    image[(np.abs(down) < 2) & (across * dice.pick((1, -1)) > 0) & (round_ < 14)] = 30
    return rgb(image)


def _any_colour(dice: Dice) -> Colour:
    return colour(dice.uniform(0, 1), dice.uniform(0.25, 0.9), dice.uniform(0.3, 0.95))


def _frame(image: Canvas, width: int, paint: Colour) -> None:
    image[:width] = image[-width:] = paint
    image[:, :width] = image[:, -width:] = paint


def _outline(dice: Dice, size: int, *, cells: int = 4) -> NDArray[np.float64]:
    """Return a wavy line (size,) in [0, 1]."""
    return noise(dice, size, octaves=4, cells=(1, cells))[0]


def _shapes(dice: Dice, size: int) -> Canvas:
    column, row = grid(size)
    hue = dice.uniform(0, 1)
    image = np.broadcast_to(colour(hue, dice.uniform(0.05, 0.5), 0.95), (size, size, 3)).copy()
    for _ in range(5 + dice.index(8)):
        x, y, radius = dice.uniform(0, size), dice.uniform(0, size), dice.uniform(0.06, 0.3) * size
        if dice.chance(0.5):
            inside = (column - x) ** 2 + (row - y) ** 2 < radius**2
        else:
            inside = (np.abs(column - x) < radius) & (np.abs(row - y) < radius * dice.uniform(0.3, 1.5))
        image[inside] = colour(hue + dice.pick((0, 0.1, 0.33, 0.5)), dice.uniform(0.3, 1), dice.uniform(0.2, 1))
    return image


def _landscape(dice: Dice, size: int) -> Canvas:
    _, row = grid(size)
    sky = colour(dice.pick((0.08, 0.55, 0.6, 0.95)), dice.uniform(0.3, 0.6), 0.97)
    image = sky + (255 - sky) * (0.8 * row / size)[..., None] + np.zeros((size, size, 1))
    hue = dice.uniform(0.1, 0.5)
    for layer in range(4):
        top = size * (0.3 + 0.15 * layer + 0.25 * _outline(dice, size))
        image[row > top[None]] = colour(hue + 0.04 * layer, 0.55, 0.8 - 0.16 * layer)
    return image


def _marble(dice: Dice, size: int) -> Canvas:
    hue, mix = dice.uniform(0, 1), noise(dice, size)[..., None]
    image = colour(hue, 0.8, 0.9) * mix + colour(hue + 0.4, 0.7, 0.4) * (1 - mix)
    image[noise(dice, size) > 0.62] = colour(hue + 0.2, 0.9, 0.95)
    return image


def _bands(dice: Dice, size: int) -> Canvas:
    image, top = np.zeros((size, size, 3)), 0
    hue = dice.uniform(0, 1)
    while top < size:
        height = 8 + dice.index(28)
        image[top : top + height] = colour(hue + dice.uniform(0, 0.4), dice.uniform(0.2, 0.9), dice.uniform(0.3, 1))
        top += height
    return image if dice.chance(0.5) else image.transpose(1, 0, 2).copy()


def _rings(dice: Dice, size: int) -> Canvas:
    column, row = grid(size)
    x, y, width = dice.uniform(0.2, 0.8) * size, dice.uniform(0.2, 0.8) * size, dice.uniform(6, 16)
    ring = np.sqrt((column - x) ** 2 + (row - y) ** 2) // width
    palette = np.array([_any_colour(dice) for _ in range(3)])
    return palette[ring.astype(np.intp) % 3]


def _bouquet(dice: Dice, size: int) -> Canvas:
    column, row = grid(size)
    image = np.broadcast_to(colour(dice.uniform(0, 1), 0.2, dice.uniform(0.3, 0.95)), (size, size, 3)).copy()
    image[(np.abs(column - size / 2) < size * 0.12) & (row > size * 0.6)] = _any_colour(dice)
    for _ in range(14):
        x, y = dice.uniform(0.2, 0.8) * size, dice.uniform(0.12, 0.62) * size
        distance = (column - x) ** 2 + (row - y) ** 2
        image[distance < (size * 0.09) ** 2] = _any_colour(dice) if dice.chance(0.7) else colour(0.33, 0.6, 0.5)
        image[distance < (size * 0.03) ** 2] = colour(0.13, 0.8, 0.95)
    return image


def _city(dice: Dice, image: Canvas) -> None:
    for _ in range(5 + dice.index(5)):
        left, width, top = dice.index(SIZE - 30), 22 + dice.index(45), 60 + dice.index(130)
        house = colour(dice.uniform(0, 1), dice.uniform(0.05, 0.4), dice.uniform(0.4, 0.85))
        image[top:, left : left + width] = house
        image[top + 8 :: 16, left + 4 : left + width - 4] = house * 0.6


def _hills(dice: Dice, image: Canvas) -> None:
    _, row = grid()
    for layer in range(3):
        top = SIZE * (0.4 + 0.15 * layer + 0.2 * _outline(dice, SIZE))
        image[row > top[None]] = colour(0.25 + 0.05 * dice.index(3), 0.3 + 0.12 * layer, 0.8 - 0.13 * layer)


def _trees(dice: Dice, image: Canvas) -> None:
    column, row = grid()
    image[int(SIZE * 0.72) :] = colour(dice.uniform(0.22, 0.33), 0.5, 0.65)
    for _ in range(3 + dice.index(4)):
        x, y, radius = dice.uniform(0, SIZE), dice.uniform(90, 170), dice.uniform(26, 60)
        image[y.__trunc__() :, max(int(x) - 5, 0) : int(x) + 5] = colour(0.07, 0.5, 0.35)
        leaves = (column - x) ** 2 + (row - y) ** 2 < (radius * (0.7 + 0.6 * noise(dice, octaves=3))) ** 2
        image[leaves] = colour(dice.uniform(0.2, 0.36), 0.6, dice.uniform(0.35, 0.65))


def _sea(dice: Dice, image: Canvas) -> None:
    _, row = grid()
    image[int(SIZE * 0.55) :] = colour(dice.uniform(0.5, 0.6), 0.6, 0.7)
    island = SIZE * (0.55 - 0.2 * np.maximum(_outline(dice, SIZE, cells=3) - 0.4, 0))
    image[(row > island[None]) & (row < SIZE * 0.56)] = colour(0.3, 0.4, 0.45)
    image[int(SIZE * 0.8) :] = colour(0.12, 0.35, 0.9)
