"""The legend of the scene's colours, which are those of `ltvn_core.palette`."""

from ltvn_core.palette import (
    ACCENT,
    BACKGROUND,
    EDGE_ADDED,
    EDGE_REMOVED,
    GOAL,
    LOCALISED,
    NODE,
    PLAN,
    PREDICTED_POSE,
    PROBABILITY_RAMP,
    SOURCE,
    TARGET,
    TRAJECTORY,
    Rgb8,
    faded,
    probability_colours,
    probability_gradient_css,
    srgb_to_linear,
)

__all__ = [
    "ACCENT",
    "BACKGROUND",
    "EDGE_ADDED",
    "EDGE_REMOVED",
    "GOAL",
    "LOCALISED",
    "NODE",
    "PLAN",
    "PREDICTED_POSE",
    "PROBABILITY_RAMP",
    "SOURCE",
    "TARGET",
    "TRAJECTORY",
    "Rgb8",
    "faded",
    "legend_html",
    "probability_colours",
    "srgb_to_linear",
]


def legend_html() -> str:
    """Return the legend of the scene's colours."""
    keys = [("plan", PLAN), ("goal", GOAL), ("new edge", EDGE_ADDED), ("pruned edge", EDGE_REMOVED)]
    chips = "".join(
        f'<span style="white-space:nowrap"><span style="display:inline-block;width:.8em;height:.8em;border-radius:2px;'
        f'background:{colour.css};margin-right:.35em;vertical-align:-1px"></span>{name}</span>'
        for name, colour in keys
    )
    return (
        '<div style="font-size:.75em;line-height:1.6;padding:.2em .75em">'
        '<div style="display:flex;gap:.5em;align-items:center"><span>edge p&nbsp;0</span>'
        '<span style="flex:1;height:.65em;border-radius:3px;'
        f'background:linear-gradient(90deg,{probability_gradient_css()})"></span>'
        f'<span>1</span></div><div style="display:flex;flex-wrap:wrap;gap:0 .9em">{chips}</div></div>'
    )
