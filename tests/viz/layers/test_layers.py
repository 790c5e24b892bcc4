"""Layers against a real viser server without a browser: what is sent, and that nothing else is."""

import itertools
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import viser

from ltvn_core import palette
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_viz.layers.graph_layers import REDRAW_EVERY_S, EdgesLayer, NodesLayer, offset_right
from ltvn_viz.layers.navigation_layers import GoalLayer, PlanLayer
from ltvn_viz.layers.robot_layers import RobotLayer, TrajectoryLayer
from ltvn_viz.layers.scene_layer import SceneLayer
from ltvn_viz.layers.shapes import marker_mesh
from ltvn_viz.session.snapshot import Snapshot, WayNodes
from ltvn_viz.timeline.run_moment import RunMoment


class Wire:
    """Counts what a server sends."""

    def __init__(self, server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch) -> None:
        self.sent: list[Any] = []
        interface = server.scene._websock_interface
        send = interface.queue_message

        def count(message: Any) -> None:
            self.sent.append(message)
            send(message)

        monkeypatch.setattr(interface, "queue_message", count)

    def taken(self) -> list[Any]:
        """Return what was sent since the last call."""
        sent, self.sent = self.sent, []
        return sent


@pytest.fixture
def wire(server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch) -> Wire:
    return Wire(server, monkeypatch)


class Clock:
    """Time that the test moves."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def big_graph(nodes: int, edges: int, seed: int = 0) -> GraphArrays:
    rng = np.random.default_rng(seed)
    return GraphArrays(
        np.arange(nodes),
        rng.uniform(0, 20, (nodes, 3)),
        rng.integers(0, nodes, (edges, 2)),
        rng.random(edges),
        np.zeros(edges, np.int64),
        acts=np.zeros(edges, np.bool_),
        exits=np.zeros(nodes, np.bool_),
    )


def test_layers_send_nothing_while_nothing_changes(server: viser.ViserServer, wire: Wire, snapshot: Snapshot) -> None:
    clock = Clock()
    layers = [
        RobotLayer(server.scene, LOCOBOT, b"glTF"),
        SceneLayer(server.scene, lambda _name, _state: b"glTF"),
        NodesLayer(server.scene),
        EdgesLayer(server.scene, clock),
        TrajectoryLayer(server.scene, clock),
        PlanLayer(server.scene),
        GoalLayer(server.scene),
    ]
    still = replace(snapshot, moment=replace(snapshot.moment, added_edges=RunMoment().added_edges))
    for layer in layers:
        layer.show(still)
    wire.taken()
    for _ in range(100):
        clock.now += 0.1
        for layer in layers:
            layer.show(still)
    assert wire.taken() == []


def test_a_moving_robot_costs_two_small_messages(server: viser.ViserServer, wire: Wire, snapshot: Snapshot) -> None:
    layer = RobotLayer(server.scene, LOCOBOT, b"glTF")
    layer.show(snapshot)
    wire.taken()
    layer.show(replace(snapshot, moment=replace(snapshot.moment, robot=np.array([2.0, 1.0, 0.3]))))
    assert len(wire.taken()) == 2


def test_a_camera_that_nobody_knows_the_carrier_of_is_drawn_alone(
    server: viser.ViserServer, wire: Wire, snapshot: Snapshot
) -> None:
    layer = RobotLayer(server.scene, LOCOBOT, b"glTF")
    layer.show(snapshot)
    wire.taken()
    layer.show(replace(snapshot, lone_camera=replace(LOCOBOT.camera, height_m=1.4)))
    updates = [vars(message) for message in wire.taken()]
    assert any(each.get("name") == "/robot/body" and each.get("visible") is False for each in updates)
    assert any(each.get("name") == "/robot/view" and each.get("position") == (0.0, 0.0, 1.4) for each in updates)


def test_a_big_map_is_redrawn_at_most_every_so_often(server: viser.ViserServer, wire: Wire) -> None:
    clock = Clock()
    layer = EdgesLayer(server.scene, clock)
    wire.taken()
    for seed in range(60):
        clock.now += 0.1
        layer.show(Snapshot(moment=RunMoment(graph=big_graph(100, 300, seed))))
    lines = [message for message in wire.taken() if getattr(message, "name", "") == "/graph/edges/likely"]
    redrawn = sum("points" in getattr(message, "updates", {}) for message in lines)
    assert redrawn <= 60 * 0.1 / REDRAW_EVERY_S + 1


def test_the_last_change_of_a_burst_is_drawn_in_the_end(server: viser.ViserServer) -> None:
    clock = Clock()
    layer = EdgesLayer(server.scene, clock)
    layer.show(Snapshot(moment=RunMoment(graph=big_graph(10, 20, seed=0))))
    last = Snapshot(moment=RunMoment(graph=big_graph(10, 25, seed=1)))
    layer.show(last)
    clock.now += REDRAW_EVERY_S
    layer.show(last)
    assert sum(len(batch.handle.points) for batch in layer.lines.batches) == 25


def redrawn_bytes(layer: EdgesLayer, wire: Wire, graph: GraphArrays) -> int:
    """Return how many bytes of arrays a page gets when the map turns into `graph`."""
    wire.taken()
    layer.show(Snapshot(moment=RunMoment(graph=graph)))
    sent = [value for message in wire.taken() for value in getattr(message, "updates", {}).values()]
    return sum(value.nbytes for value in sent if isinstance(value, np.ndarray))


def test_recolouring_a_big_map_stays_small(server: viser.ViserServer, wire: Wire) -> None:
    graph = big_graph(10_000, 50_000)
    layer = EdgesLayer(server.scene, itertools.count(step=2 * REDRAW_EVERY_S).__next__)
    whole = redrawn_bytes(layer, wire, graph)
    thirds = np.floor(3 * graph.p)
    assert redrawn_bytes(layer, wire, replace(graph, p=(2 * thirds + 1) / 3 - graph.p)) <= 400_000
    one_less = np.where(np.arange(len(graph.p)) == graph.p.argmax(), 0.1, graph.p)
    assert redrawn_bytes(layer, wire, replace(graph, p=one_less)) < whole


def test_edges_are_coloured_by_p_and_likely_ones_are_thicker(server: viser.ViserServer) -> None:
    layer = EdgesLayer(server.scene)
    p = np.array([0.0, 0.5, 1.0])
    layer.show(Snapshot(moment=RunMoment(graph=replace(big_graph(3, 3), p=p))))
    shown = [batch.handle for batch in layer.lines.batches if batch.handle.visible]
    colours = np.concatenate([handle.colors[:, 0] for handle in shown])
    np.testing.assert_array_equal(colours, palette.srgb_to_linear(palette.probability_colours(p)))
    thin, middle, thick = (handle.thickness for handle in shown)
    assert thin < middle < thick


def test_the_goal_and_the_place_of_the_robot_stand_out(server: viser.ViserServer, snapshot: Snapshot) -> None:
    layer = NodesLayer(server.scene)
    chosen = int(snapshot.moment.graph.ids[3])
    layer.show(replace(snapshot, selected=chosen))
    colours = Counter(map(tuple, layer.markers.dots.handle.batched_colors.tolist()))
    assert colours[tuple(palette.srgb_to_linear(np.array(palette.GOAL)).tolist())] == 1
    assert colours[tuple(palette.srgb_to_linear(np.array(palette.NODE)).tolist())] == len(snapshot.moment.graph.ids) - 1


def test_the_pin_stands_at_the_goal_and_is_hidden_without_one(server: viser.ViserServer, snapshot: Snapshot) -> None:
    layer = GoalLayer(server.scene)
    layer.show(snapshot)
    assert not layer.pin.visible
    layer.show(replace(snapshot, selected=int(snapshot.moment.graph.ids[3])))
    assert layer.pin.visible
    np.testing.assert_allclose(layer.pin.position[:2], snapshot.moment.graph.poses[3, :2], atol=1e-6)


def test_the_pin_stays_at_the_goal_of_the_query_while_the_next_one_is_chosen(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    graph, layer = snapshot.moment.graph, GoalLayer(server.scene)
    layer.show(replace(snapshot, selected=int(graph.ids[3]), way=WayNodes(None, None, int(graph.ids[1]))))
    np.testing.assert_allclose(layer.pin.position[:2], graph.poses[1, :2], atol=1e-6)


def test_there_and_back_are_two_lines() -> None:
    there = np.array([[[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 0.0]]])
    moved = offset_right(there)
    assert np.all(moved[0, :, 1] < 0)
    assert np.all(moved[1, :, 1] > 0)


def test_the_node_marker_points_ahead_and_is_closed() -> None:
    vertices, faces = marker_mesh(0.2, 0.03)
    assert vertices[:, 0].max() == pytest.approx(0.2)
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert set(Counter(map(tuple, sides.tolist())).values()) == {2}


def test_nodes_and_edges_have_a_dark_outline_right_below(server: viser.ViserServer) -> None:
    nodes, edges, graph = NodesLayer(server.scene), EdgesLayer(server.scene), big_graph(5, 7)
    nodes.show(Snapshot(moment=RunMoment(graph=graph)))
    edges.show(Snapshot(moment=RunMoment(graph=graph)))
    drawn = [batch for batch in edges.lines.batches if batch.handle.visible]
    assert drawn
    for batch in drawn:
        lines, outline = batch.handle, batch.outline
        assert outline is not None
        np.testing.assert_allclose(outline.points[..., :2], lines.points[..., :2])
        assert np.all(outline.points[..., 2] < lines.points[..., 2])
        assert outline.thickness > lines.thickness
        assert outline.colors.max() < 40
    dots, rim = nodes.markers.dots.handle, nodes.markers.outline.handle
    np.testing.assert_allclose(rim.batched_positions[:, :2], dots.batched_positions[:, :2])
    assert rim.visible


def test_nodes_lie_above_edges_and_only_the_selected_one_shows_where_it_looks(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    nodes, edges = NodesLayer(server.scene), EdgesLayer(server.scene)
    nodes.show(snapshot)
    edges.show(snapshot)
    drawn = [batch.handle for batch in edges.lines.batches if batch.handle.visible]
    low = nodes.markers.dots.handle.batched_positions[:, 2].min()
    assert drawn
    assert all(low > lines.points[..., 2].max() for lines in drawn)
    assert not nodes.heading.handle.visible
    nodes.show(replace(snapshot, selected=int(snapshot.moment.graph.ids[3])))
    assert nodes.heading.handle.visible
    np.testing.assert_allclose(nodes.heading.handle.batched_positions[:, :2], snapshot.moment.graph.poses[3:4, :2])


def test_all_nodes_cost_two_draw_calls_of_few_triangles(server: viser.ViserServer) -> None:
    layer = NodesLayer(server.scene)
    layer.show(Snapshot(moment=RunMoment(graph=big_graph(500, 10))))
    assert len(layer.markers.dots.handle.batched_positions) == 500
    assert len(layer.markers.dots.handle.faces) <= 8
