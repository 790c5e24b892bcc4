"""The colours of map and run, and their meanings: one set for the page, the Rerun viewer, reports and exported maps.

Owns every colour with a meaning. The probability of an edge runs from orange through pale yellow to blue; green means
new or open, magenta means removed, blocked or wrong. These colours differ for all common kinds of colour blindness. In
addition, the width or height of an edge shows whether it was added or removed, and nodes and edges have a dark outline,
which separates them from any floor. Uses only numpy, so that any package can import it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

PROBABILITY_RAMP = np.array(
    [[235, 90, 10], [250, 170, 70], [235, 226, 196], [95, 175, 250], [25, 115, 250]], np.float64
)
"""Colours (5, 3) of p from 0 to 1 in equal steps, as sRGB in [0, 255], for a dark background."""

PROBABILITY_RAMP_ON_WHITE = np.stack([PROBABILITY_RAMP[0], np.array([153, 153, 158.0]), PROBABILITY_RAMP[-1]])
"""Colours (3, 3) of p = 0, 0.5 and 1 on paper: the same ends with grey between them, because pale colours are invisible
on white."""

SCORE_RAMP = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], np.float64)
"""Colours (5, 3) of scores from far to near in equal steps (viridis), which differ from those of probabilities."""

_INK = 0.82
"""Factor for the brightness of a colour on white, because the colours are made for a dark page."""


class Rgb8(NamedTuple):
    """A colour in sRGB, each channel in [0, 255]."""

    red: int
    green: int
    blue: int

    @property
    def css(self) -> str:
        """The colour in CSS."""
        return f"rgb({self.red},{self.green},{self.blue})"

    @property
    def on_white(self) -> tuple[float, float, float]:
        """The colour for white paper, darkened, each channel in [0, 1]."""
        return _INK * self.red / 255, _INK * self.green / 255, _INK * self.blue / 255


NODE = Rgb8(176, 196, 232)
ROBOT = Rgb8(0, 240, 255)
LOCALISED = Rgb8(250, 215, 60)
GOAL = Rgb8(204, 121, 240)
PLAN = Rgb8(250, 215, 60)
PREDICTED_POSE = Rgb8(250, 215, 60)
TRAJECTORY = Rgb8(255, 252, 240)
COURSE = Rgb8(150, 160, 176)
ACTION = Rgb8(255, 150, 160)
EDGE_ADDED = Rgb8(0, 200, 120)
EDGE_REMOVED = Rgb8(180, 20, 150)
SOURCE = Rgb8(70, 150, 255)
TARGET = Rgb8(240, 110, 30)
BACKGROUND = Rgb8(24, 27, 34)
WALL = Rgb8(74, 80, 94)
FLOOR_PLAN_FREE = Rgb8(46, 51, 62)
FLOOR_PLAN_WALL = Rgb8(118, 126, 142)
TEXT = Rgb8(230, 233, 240)
ACCENT = Rgb8(56, 139, 253)


def probability_colours(p: ArrayLike) -> NDArray[np.uint8]:
    """Return the colours (N, 3) of probabilities (N,) in [0, 1]."""
    return _along(PROBABILITY_RAMP, p)


def score_colours(nearness: ArrayLike) -> NDArray[np.uint8]:
    """Return the colours (N, 3) of similarities (N,), from 0 for different images to 1 for the same image."""
    return _along(SCORE_RAMP, nearness)


def _along(ramp: NDArray[np.float64], shares: ArrayLike) -> NDArray[np.uint8]:
    steps = np.linspace(0, 1, len(ramp))
    return (
        np.stack([np.interp(np.asarray(shares, np.float64), steps, channel) for channel in ramp.T], axis=-1)
        .round()
        .astype(np.uint8)
    )


def gradient_css(ramp: NDArray[np.float64]) -> str:
    """Return the colours of a ramp (N, 3) as the stops of a CSS gradient."""
    return ", ".join(Rgb8(*(int(part) for part in stop)).css for stop in ramp)


def srgb_to_linear(colours: ArrayLike) -> NDArray[np.uint8]:
    """Convert sRGB colours (..., 3) to linear light, which viewers expect for lines and batched meshes."""
    return _LIGHT[np.asarray(colours, np.uint8)]


_LIGHT = np.rint(255 * (np.arange(256) / 255) ** 2.2).astype(np.uint8)


def faded(colour: Rgb8, ages_s: NDArray[np.float64], over_s: float) -> NDArray[np.uint8]:
    """Return colours (N, 3) that fade into the background with the ages (N,), over `over_s` seconds."""
    share = np.clip(1 - ages_s / over_s, 0, 1)[:, None]
    mixed = share * np.array(colour) + (1 - share) * np.array(BACKGROUND)
    return mixed.round().astype(np.uint8)
