"""Both images of a pair as one picture: colour above, depth below, and the waypoints drawn into the source.

Owns the drawing. Where a place appears is said by `ltvn_core.training_data.camera_projection`.
"""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.palette import Rgb8
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training_data.camera_projection import WaypointOutline, waypoint_outline
from ltvn_core.training_data.pair_table import LabelledPair
from ltvn_core.types import Rgb, Waypoint
from ltvn_viz.panels.camera_panel import depth_colours

SCALE = 5
"""Pixels of the screen for one of the camera."""
GAP, BORDER = 12, 4

_DARK = Rgb8(15, 17, 22)
_OUT_OF_SIGHT_PX = 1e4


def pair_image(pair: LabelledPair, predicted: Waypoint) -> Rgb:
    """Return source and target side by side with the true and the predicted place of the target."""
    source = _enlarged(pair.source_rgb)
    _draw(source, waypoint_outline(pair.waypoint), palette.TARGET)
    _draw(source, waypoint_outline(predicted), palette.PREDICTED_POSE)
    rows = [
        (source, _enlarged(pair.target_rgb)),
        (_depth(pair.source_depth), _depth(pair.target_depth)),
    ]
    edges = (palette.SOURCE, palette.TARGET)
    return _stacked([_stacked([_framed(*each) for each in zip(row, edges, strict=True)], axis=1) for row in rows], 0)


def blank_pair_image() -> Rgb:
    """Return an empty picture of the same size."""
    size = LOCOBOT.camera
    return np.full((2 * size.height * SCALE + GAP, 2 * size.width * SCALE + GAP, 3), palette.BACKGROUND, np.uint8)


def _enlarged(rgb: Rgb) -> Rgb:
    height, width = rgb.shape[:2]
    return np.ascontiguousarray(
        cv2.resize(rgb, (width * SCALE, height * SCALE), interpolation=cv2.INTER_CUBIC), np.uint8
    )


def _depth(depth: NDArray[np.floating]) -> Rgb:
    height, width = depth.shape
    large = cv2.resize(depth, (width * SCALE, height * SCALE), interpolation=cv2.INTER_NEAREST)
    return depth_colours(np.asarray(large, np.float32))


def _framed(image: Rgb, colour: Rgb8) -> Rgb:
    image = image.copy()
    for side in (np.s_[:BORDER], np.s_[-BORDER:], np.s_[:, :BORDER], np.s_[:, -BORDER:]):
        image[side] = colour
    return image


def _stacked(images: list[Rgb], axis: int) -> Rgb:
    shape = list(images[0].shape)
    shape[axis] = GAP
    gap = np.full(shape, palette.BACKGROUND, np.uint8)
    return np.concatenate([images[0], gap, images[1]], axis=axis)


def _draw(image: Rgb, lines: WaypointOutline, colour: Rgb8) -> None:
    """Draw a waypoint's lines, with a dark rim so that they show on any wall."""
    for thickness, ink in ((9, _DARK), (4, colour)):
        for line in lines:
            _polyline(image, line * SCALE, ink, thickness)


def _polyline(image: Rgb, points: NDArray[np.float64], ink: Rgb8, thickness: int) -> None:
    for start, end in pairwise(points):
        if np.isfinite([start, end]).all() and max(np.abs(start).max(), np.abs(end).max()) < _OUT_OF_SIGHT_PX:
            ends = [(round(column), round(row)) for column, row in (start.tolist(), end.tolist())]
            cv2.line(image, ends[0], ends[1], tuple(ink), thickness, cv2.LINE_AA)
