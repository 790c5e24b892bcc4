"""The page's colours for figures that leave it."""

from ltvn_core.reports.map_svg import MapColours
from ltvn_viz import palette


def scene_colours() -> MapColours:
    """Return the colours of a map over its scene."""
    ramp = tuple(palette.Rgb8(*map(int, stop)).css for stop in palette.PROBABILITY_RAMP)
    return MapColours(ramp, palette.NODE.css, palette.EDGE_REMOVED.css, palette.BACKGROUND.css)
