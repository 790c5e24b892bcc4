"""The colours of the page and what they mean.

One place, so that scene, panels and legend agree. Probabilities run from orange through pale to blue, which stays apart
for every common kind of colour blindness; that an edge came or went is also said by its width and height.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

PROBABILITY_RAMP = np.array(
    [[235, 90, 10], [250, 170, 70], [235, 226, 196], [95, 175, 250], [25, 115, 250]], np.float64
)
"""p = 0 to 1 in equal steps; sRGB."""


class Rgb8(NamedTuple):
    """A colour of the screen."""

    red: int
    green: int
    blue: int

    @property
    def css(self) -> str:
        """The colour as a style sheet writes it."""
        return f"rgb({self.red},{self.green},{self.blue})"


NODE = Rgb8(176, 196, 232)
LOCALISED = Rgb8(250, 215, 60)
GOAL = Rgb8(204, 121, 240)
PLAN = Rgb8(250, 215, 60)
PREDICTED_POSE = Rgb8(250, 215, 60)
TRAJECTORY = Rgb8(255, 252, 240)
EDGE_ADDED = Rgb8(0, 200, 120)
EDGE_REMOVED = Rgb8(230, 40, 60)
SOURCE = Rgb8(70, 150, 255)
TARGET = Rgb8(240, 110, 30)
BACKGROUND = Rgb8(24, 27, 34)
ACCENT = Rgb8(56, 139, 253)


def probability_colours(p: ArrayLike) -> NDArray[np.uint8]:
    """Colour probabilities (N,) in [0, 1] as (N, 3)."""
    steps = np.linspace(0, 1, len(PROBABILITY_RAMP))
    return (
        np.stack([np.interp(np.asarray(p, np.float64), steps, channel) for channel in PROBABILITY_RAMP.T], axis=-1)
        .round()
        .astype(np.uint8)
    )


def srgb_to_linear(colours: ArrayLike) -> NDArray[np.uint8]:
    """Turn colours of the screen (..., 3) into amounts of light, which is what lines and batched meshes are given."""
    return _LIGHT[np.asarray(colours, np.uint8)]


_LIGHT = np.rint(255 * (np.arange(256) / 255) ** 2.2).astype(np.uint8)


def faded(colour: Rgb8, ages_s: NDArray[np.float64], over_s: float) -> NDArray[np.uint8]:
    """Fade a colour into the background over `over_s` seconds; returns (N, 3) for ages (N,)."""
    share = np.clip(1 - ages_s / over_s, 0, 1)[:, None]
    mixed = share * np.array(colour) + (1 - share) * np.array(BACKGROUND)
    return mixed.round().astype(np.uint8)


def legend_html() -> str:
    """Return the legend of the scene's colours."""
    ramp = ", ".join(Rgb8(*(int(c) for c in stop)).css for stop in PROBABILITY_RAMP)
    keys = [("plan", PLAN), ("goal", GOAL), ("new edge", EDGE_ADDED), ("pruned edge", EDGE_REMOVED)]
    chips = "".join(
        f'<span style="white-space:nowrap"><span style="display:inline-block;width:.8em;height:.8em;border-radius:2px;'
        f'background:{colour.css};margin-right:.35em;vertical-align:-1px"></span>{name}</span>'
        for name, colour in keys
    )
    return (
        '<div style="font-size:.75em;line-height:1.6;padding:.2em .75em">'
        '<div style="display:flex;gap:.5em;align-items:center"><span>edge p&nbsp;0</span>'
        f'<span style="flex:1;height:.65em;border-radius:3px;background:linear-gradient(90deg,{ramp})"></span>'
        f'<span>1</span></div><div style="display:flex;flex-wrap:wrap;gap:0 .9em">{chips}</div></div>'
    )
