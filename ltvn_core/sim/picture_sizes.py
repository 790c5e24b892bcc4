"""Sizes of textures: sides that are powers of two, and few enough texels altogether."""

import cv2
import numpy as np

from ltvn_core.types import Rgb

MAX_SIDE = 4096


def power_of_two(picture: Rgb) -> Rgb:
    """Scale a picture (H, W, 3) to the nearest powers of two."""
    height, width = (min(MAX_SIDE, 1 << max(0, round(float(np.log2(side))))) for side in picture.shape[:2])
    return resized(picture, width, height)


def fitted(pictures: list[Rgb], most_texels: int) -> list[Rgb]:
    """Halve the largest pictures until all together have at most so many texels."""
    pictures = list(pictures)
    while sum(picture.size // 3 for picture in pictures) > most_texels:
        largest = max(range(len(pictures)), key=lambda k: pictures[k].size)
        height, width = pictures[largest].shape[:2]
        pictures[largest] = resized(pictures[largest], max(width // 2, 1), max(height // 2, 1))
    return pictures


def resized(picture: Rgb, width: int, height: int) -> Rgb:
    """Scale a picture (H, W, 3), averaging where it shrinks."""
    if picture.shape[:2] == (height, width):
        return np.ascontiguousarray(picture)
    shrinks = width * height < picture.shape[0] * picture.shape[1]
    way = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return cv2.resize(picture, (width, height), interpolation=way).astype(np.uint8, copy=False)
