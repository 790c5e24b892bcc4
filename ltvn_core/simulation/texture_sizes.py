"""Resizes textures to sides that are powers of two, and to a budget of texels."""

import cv2
import numpy as np

from ltvn_core.types import Rgb

MAX_SIDE = 4096


def resize_to_power_of_two(image: Rgb) -> Rgb:
    """Scale an image (H, W, 3) to the nearest powers of two, at most `MAX_SIDE`."""
    height, width = (min(MAX_SIDE, 1 << max(0, round(float(np.log2(side))))) for side in image.shape[:2])
    return resized(image, width, height)


def shrink_to_budget(images: list[Rgb], most_texels: int) -> list[Rgb]:
    """Halve the largest images until all together have at most `most_texels` texels."""
    images = list(images)
    while sum(image.size // 3 for image in images) > most_texels:
        largest = max(range(len(images)), key=lambda k: images[k].size)
        height, width = images[largest].shape[:2]
        images[largest] = resized(images[largest], max(width // 2, 1), max(height // 2, 1))
    return images


def resized(image: Rgb, width: int, height: int) -> Rgb:
    """Scale an image (H, W, 3); shrinking averages, enlarging interpolates."""
    if image.shape[:2] == (height, width):
        return np.ascontiguousarray(image)
    shrinks = width * height < image.shape[0] * image.shape[1]
    interpolation = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return cv2.resize(image, (width, height), interpolation=interpolation).astype(np.uint8, copy=False)
