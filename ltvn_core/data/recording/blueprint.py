"""The layout in which a recording opens in the Rerun viewer. Owns only the arrangement of the views."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.archetypes import TextLogColumns

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.drawn_poses import FloorExtent
from ltvn_core.data.recording.event_drawing import length_entity, probability_entity
from ltvn_core.data.recording.stream_lock import STREAM_LOCK
from ltvn_core.graph.topological_graph import EdgeKey

_SINCE_THE_BEGINNING = rrb.VisibleTimeRanges(
    timeline=schema.STEP,
    start=rrb.TimeRangeBoundary.infinite(),
    end=rrb.TimeRangeBoundary.cursor_relative(),
)
_STEPS = rr.SeriesLines(widths=2, interpolation_mode="StepAfter")
"""Draws beliefs as steps, because a belief holds until the next attempt changes it."""
_HALF_FIELD_OF_VIEW_RAD = math.radians(55 / 2)
"""Half the vertical field of view of Rerun's 3D view."""
_ASPECT = 1.4
"""Least aspect ratio, width over height, of the 3D view on common screens."""
_MARGIN_M = 0.5


@dataclass(frozen=True, kw_only=True, slots=True)
class Layout:
    """The content of a recording on which its layout depends."""

    floor: FloorExtent | None = None
    """The floor to look at from above; None leaves the first view to the viewer."""
    edges: Sequence[EdgeKey] | None = None
    """The edges whose beliefs are plotted; None plots all of them."""
    user_scalars: Sequence[str] = ()
    """Entities that the user logged, whose scalars are plotted."""


class _Blueprint(rrb.Blueprint):
    """A blueprint that remembers Rerun's temporary stream.

    The stream and its memory refer to each other, so their two threads end only if the stream is disconnected
    explicitly.
    """

    stream: rr.RecordingStream | None = None

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self.stream = stream
        super()._log_to_stream(stream)


def send_layout(stream: rr.RecordingStream, layout: Layout) -> None:
    """Set the layout in which a recording opens."""
    sent = _blueprint(layout)
    with STREAM_LOCK:  # Rerun logs a blueprint to a stream of its own first.
        stream.send_blueprint(sent)
    if sent.stream is not None:
        sent.stream.disconnect()


def _blueprint(layout: Layout) -> _Blueprint:
    """Return the layout: the floor from above in the middle, images on the left, beliefs, state and log below.

    It opens at the end of the recording, where the map, the trail and the last plan are all drawn.
    """
    return _Blueprint(
        rrb.Vertical(
            rrb.Horizontal(_images(), _world(layout.floor), _belief_table(), column_shares=[4, 11, 4]),
            rrb.Horizontal(_curves(layout), _log(), column_shares=[3, 2]),
            row_shares=[5, 3],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=schema.STEP, play_state="following", state="collapsed"),
        auto_views=False,
    )


def _images() -> rrb.Container:
    return rrb.Vertical(
        rrb.Spatial2DView(origin=schema.RGB, name="Camera"),
        rrb.Spatial2DView(origin=schema.DEPTH, name="Depth"),
        rrb.Horizontal(
            rrb.Spatial2DView(origin=schema.NODE_IMAGE, name="At node"),
            rrb.Spatial2DView(origin=schema.SUBGOAL_IMAGE, name="Subgoal"),
            rrb.Spatial2DView(origin=schema.GOAL_IMAGE, name="Goal"),
        ),
        row_shares=[3, 3, 2],
    )


def _world(floor: FloorExtent | None) -> rrb.View:
    return rrb.Spatial3DView(
        origin=schema.WORLD,
        # Depth has a view of its own; its point cloud would hide the map here.
        contents=["$origin/**", f"- {schema.DEPTH}"],
        name="World: map, plan and robot",
        background=[24, 26, 30],
        line_grid=floor is None,
        eye_controls=None if floor is None else _from_above(floor),
        overrides={schema.TRAIL: _SINCE_THE_BEGINNING},
    )


def _from_above(floor: FloorExtent) -> rrb.EyeControls3D:
    x_m, y_m = floor.centre
    half_m = max(floor.height_m / 2, floor.width_m / 2 / _ASPECT) + _MARGIN_M
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=(x_m, y_m, half_m / math.tan(_HALF_FIELD_OF_VIEW_RAD) + floor.top_m),
        look_target=(x_m, y_m, 0.0),
        eye_up=(0.0, 1.0, 0.0),
    )


def _belief_table() -> rrb.View:
    return rrb.TextDocumentView(origin=schema.BELIEF_TABLE, name="Edges now")


def _curves(layout: Layout) -> rrb.Container:
    plots: list[rrb.View | rrb.Container] = [
        rrb.Tabs(_probabilities(layout.edges), _lengths(layout.edges), active_tab=0),
        rrb.TimeSeriesView(origin=schema.GRAPH_SIZE, name="Size of the map", plot_legend=rrb.Corner2D.RightTop),
        rrb.TimeSeriesView(origin=schema.MARGIN, name="Margin", plot_legend=rrb.PlotLegend(visible=False)),
    ]
    if layout.user_scalars:
        plots.append(rrb.TimeSeriesView(origin="/", contents=list(layout.user_scalars), name="Own scalars"))
    return rrb.Vertical(
        rrb.StateTimelineView(origin=schema.STATE, name="Navigator"),
        rrb.Horizontal(*plots, column_shares=[2] + [1] * (len(plots) - 1)),
        row_shares=[2, 3],
    )


def _probabilities(edges: Sequence[EdgeKey] | None) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=schema.PROBABILITIES,
        contents="$origin/**" if edges is None else [f"/{probability_entity(edge)}" for edge in edges],
        name="p of all edges" if edges is None else "p of edges planned or changed last",
        defaults=[_STEPS],
        axis_y=rrb.ScalarAxis(range=(0.0, 1.05)),
        # Hundreds of names would cover the curves; hovering over a curve shows its name.
        plot_legend=rrb.PlotLegend(visible=edges is not None),
    )


def _lengths(edges: Sequence[EdgeKey] | None) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=schema.LENGTHS,
        contents="$origin/**" if edges is None else [f"/{length_entity(edge)}" for edge in edges],
        name="Length μ, σ",
        defaults=[_STEPS],
        plot_legend=rrb.PlotLegend(visible=edges is not None),
    )


def _log() -> rrb.View:
    columns = TextLogColumns(text_log_columns=["loglevel", "body"])
    return rrb.TextLogView(origin=schema.LOG, name="Events", columns=columns)
