"""The page's colours for figures that leave it."""

from ltvn_core.report.scene_svg import SceneColours
from ltvn_viz import palette


def scene_colours() -> SceneColours:
    """Return the colours of a map over its scene."""
    ramp = tuple(palette.Rgb8(*map(int, stop)).css for stop in palette.RAMP)
    return SceneColours(ramp, palette.NODE.css, palette.WENT.css, palette.BACKGROUND.css)
