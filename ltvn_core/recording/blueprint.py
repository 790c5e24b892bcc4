"""The layout in which a recording opens in the Rerun viewer. Owns the arrangement of the views, nothing else."""

import rerun.blueprint as rrb
from rerun.blueprint.archetypes import TextLogColumns

from ltvn_core.recording import schema

_SINCE_THE_BEGINNING = rrb.VisibleTimeRanges(
    timeline=schema.STEP,
    start=rrb.TimeRangeBoundary.infinite(),
    end=rrb.TimeRangeBoundary.cursor_relative(),
)


def blueprint() -> rrb.Blueprint:
    """Return the designed layout: world in the middle, camera on the left, curves, state and log below.

    It opens at the end of the recording, where the map, the trail and the last plan are all drawn.
    """
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(_cameras(), _world(), column_shares=[1, 3]),
            rrb.Horizontal(_curves(), _log(), column_shares=[3, 2]),
            row_shares=[5, 3],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=schema.STEP, play_state="following", state="collapsed"),
        auto_views=False,
    )


def _cameras() -> rrb.Container:
    return rrb.Vertical(
        rrb.Spatial2DView(origin=schema.RGB, name="Camera"),
        rrb.Spatial2DView(origin=schema.DEPTH, name="Depth"),
    )


def _world() -> rrb.View:
    return rrb.Spatial3DView(
        origin=schema.WORLD,
        # The depth has its own view; its cloud of points would hide the map here.
        contents=["$origin/**", f"- {schema.DEPTH}"],
        name="World: map, plan and robot",
        background=[24, 26, 30],
        overrides={schema.TRAIL: _SINCE_THE_BEGINNING},
    )


def _curves() -> rrb.Container:
    return rrb.Vertical(
        rrb.StateTimelineView(origin=schema.STATE, name="Navigator"),
        rrb.Horizontal(
            rrb.TimeSeriesView(
                origin=schema.BELIEFS,
                name="Probability p of driven edges",
                axis_y=rrb.ScalarAxis(range=(0.0, 1.05)),
                # Two dozen names would cover the curves; hovering tells the name of one.
                plot_legend=rrb.PlotLegend(visible=False),
            ),
            rrb.TimeSeriesView(origin=schema.GRAPH_SIZE, name="Size of the map", plot_legend=rrb.Corner2D.RightTop),
            rrb.TimeSeriesView(origin=schema.MARGIN, name="Margin", plot_legend=rrb.PlotLegend(visible=False)),
        ),
        row_shares=[2, 3],
    )


def _log() -> rrb.View:
    columns = TextLogColumns(text_log_columns=["loglevel", "body"])
    return rrb.TextLogView(origin=schema.LOG, name="Events", columns=columns)
