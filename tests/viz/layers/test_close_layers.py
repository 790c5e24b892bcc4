"""What each page draws by where its camera is, and what a question marks: against a viser server without a browser."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import viser

from ltvn_core import palette
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_viz.layers.close_layers import LEAST_MARKER_M, MARKER_Z, RobotMarker
from ltvn_viz.layers.debugger_layer import DebuggerLayer
from ltvn_viz.layers.world_layers import DOOR_HANDLE_Z
from ltvn_viz.session.inspection import Inspection, Overlay, QuestionAnswer, QuestionName, Selection, Stroke, stroke
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.timeline.run_moment import RunMoment

GRAPH = GraphArrays(
    ids=np.array([7, 8, 9]),
    poses=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [2.0, 1.0, 1.0]]),
    edges=np.array([[0, 1], [1, 2]]),
    p=np.array([0.95, 0.1]),
    attempts=np.zeros(2, np.int64),
    acts=np.zeros(2, np.bool_),
    exits=np.zeros(3, np.bool_),
)


def page_at(server: viser.ViserServer, distance_m: float) -> viser.ClientHandle:
    """Return a page whose camera looks down at the origin from so far."""
    camera = SimpleNamespace(position=np.array([0.0, 0.0, distance_m]), look_at=np.zeros(3))
    return cast(Any, SimpleNamespace(scene=server.scene, camera=camera))


@pytest.mark.parametrize("distance_m", [2.0, 12.0, 60.0])
def test_the_robot_is_found_at_every_zoom(server: viser.ViserServer, distance_m: float) -> None:
    marker = RobotMarker(page_at(server, distance_m))
    marker.show(Snapshot(moment=replace(RunMoment(), robot=np.array([0.0, 0.0, np.pi / 2]))))
    assert marker.place.visible
    assert marker.size_m >= max(LEAST_MARKER_M, 0.04 * (distance_m - MARKER_Z))
    assert MARKER_Z > DOOR_HANDLE_Z
    np.testing.assert_allclose(marker.place.wxyz, [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-6)


def test_no_marker_without_a_pose(server: viser.ViserServer) -> None:
    marker = RobotMarker(page_at(server, 10.0))
    marker.show(Snapshot())
    assert not marker.place.visible


def test_a_selected_edge_that_is_only_pointed_at_keeps_the_colour_of_its_p_within_a_white_halo(
    server: viser.ViserServer,
) -> None:
    other = Stroke((5.0, 5.0), (6.0, 6.0), palette.PLAN)
    layer = _selecting_layer(server, stroke(GRAPH.poses[0], GRAPH.poses[1], palette.TARGET), other)
    first, second = layer.strokes.handle.colors[:, 0]
    np.testing.assert_array_equal(first, palette.srgb_to_linear(palette.probability_colours([0.95]))[0])
    np.testing.assert_array_equal(second, palette.srgb_to_linear(np.array(palette.PLAN)))
    assert len(layer.halo.handle.points) == 1
    assert layer.halo.handle.colors.min() == 255
    assert layer.halo.handle.thickness > layer.strokes.handle.thickness


def test_a_selected_edge_keeps_the_colour_of_what_the_answer_says_about_it(server: viser.ViserServer) -> None:
    layer = _selecting_layer(server, stroke(GRAPH.poses[0], GRAPH.poses[1], palette.EDGE_REMOVED))
    np.testing.assert_array_equal(
        layer.strokes.handle.colors[0, 0], palette.srgb_to_linear(np.array(palette.EDGE_REMOVED))
    )
    assert len(layer.halo.handle.points) == 1


def test_a_selected_edge_is_seen_although_the_answer_does_not_draw_it(server: viser.ViserServer) -> None:
    layer = _selecting_layer(server)
    assert len(layer.strokes.handle.points) == len(layer.halo.handle.points) == 1
    layer.show(Snapshot(moment=RunMoment(graph=GRAPH), inspection=Inspection(selection=Selection(edge=(7, 8)))))
    assert not layer.halo.handle.visible


def _selecting_layer(server: viser.ViserServer, *strokes: Stroke) -> DebuggerLayer:
    """Return a layer that shows an answer with these strokes while the edge from 7 to 8 is selected."""
    layer = DebuggerLayer(server.scene)
    answer = QuestionAnswer(overlay=Overlay(strokes))
    shown = Inspection(question=QuestionName.FAILURES, answer=answer, selection=Selection(edge=(7, 8)))
    layer.show(Snapshot(moment=RunMoment(graph=GRAPH), inspection=shown))
    return layer
