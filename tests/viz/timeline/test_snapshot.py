"""Snapshots are cheap and share what did not change."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.analysis.map_history import GraphArrays, GraphHistory
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Twist
from ltvn_viz.session.snapshot_builder import hint
from ltvn_viz.timeline.run_moment import moment_of
from tests.viz.session_harness import SessionHarness


def some_history(rng: np.random.Generator, length: int = 300) -> list[d.GraphDelta]:
    """Return deltas that make sense one after the other."""
    graph, deltas, next_id = TopologicalGraph(), [], 0
    for _ in range(length):
        delta = _some_delta(rng, graph, next_id)
        next_id += isinstance(delta, d.NodeAdded)
        graph.apply(delta)
        deltas.append(delta)
    return deltas


def _some_delta(rng: np.random.Generator, graph: TopologicalGraph, next_id: int) -> d.GraphDelta:
    edges, nodes = list(graph.edges), list(graph.nodes)
    kind = rng.random()
    if edges and kind < 0.2:
        return d.BeliefUpdated(
            *edges[rng.integers(len(edges))], d.Belief(float(rng.random()), 1.0, 0.1), 1, 0, d.Cause.ATTEMPT
        )
    if edges and kind < 0.3:
        return d.EdgePruned(*edges[rng.integers(len(edges))], d.Cause.ATTEMPT)
    if len(nodes) > 4 and kind < 0.35:
        return d.NodeDropped(nodes[rng.integers(len(nodes))], d.Cause.HAND)
    if len(nodes) > 1 and kind < 0.8:
        source, target = rng.choice(nodes, 2, replace=False).tolist()
        if (source, target) not in graph.edges:
            edge = d.Edge(source, target, d.PoseRow(1, 0, 0), d.Belief(float(rng.random()), 1.0, 0.1))
            return d.EdgeAdded(edge, d.Cause.ONLINE)
    return d.NodeAdded(d.Node(next_id, d.PoseRow(*rng.random(3).tolist())), d.Cause.ONLINE)


def same(view: GraphArrays, graph: TopologicalGraph) -> bool:
    named = {tuple(view.ids[list(ends)].tolist()): p for ends, p in zip(view.edges, view.p, strict=True)}
    nodes = view.ids.tolist() == list(graph.nodes)
    return nodes and named == {key: edge.belief.p for key, edge in graph.edges.items()}


@pytest.mark.parametrize("seed", range(5))
def test_any_moment_of_the_history_equals_the_fold_up_to_it(seed: int) -> None:
    deltas, history, graph = some_history(np.random.default_rng(seed)), GraphHistory(), TopologicalGraph()
    for stamp, delta in enumerate(deltas):
        history.apply(delta, float(stamp))
    assert same(history.at(0), graph)
    for version, delta in enumerate(deltas, 1):
        graph.apply(delta)
        assert same(history.at(version), graph)


def test_the_past_does_not_change_when_the_history_goes_on() -> None:
    deltas = some_history(np.random.default_rng(7), 600)
    short, long = GraphHistory(), GraphHistory()
    for stamp, delta in enumerate(deltas):
        long.apply(delta, float(stamp))
        if stamp < 300:
            short.apply(delta, float(stamp))
    before, after = short.at(300), long.at(300)
    np.testing.assert_array_equal(before.ids, after.ids)
    np.testing.assert_array_equal(before.p, after.p)
    np.testing.assert_array_equal(before.edges, after.edges)


def test_edges_glow_when_they_come_and_fade_when_they_go() -> None:
    history = GraphHistory()
    for node in (1, 2):
        history.apply(d.NodeAdded(d.Node(node, d.PoseRow(node, 0, 0)), d.Cause.ONLINE), 0.0)
    edge = d.Edge(1, 2, d.PoseRow(1, 0, 0), d.Belief(0.9, 1.0, 0.1))
    history.apply(d.EdgeAdded(edge, d.Cause.ONLINE), 1.0)
    np.testing.assert_allclose(history.added_edges(3, 2.0, 3.0).ages_s, [1.0])
    history.apply(d.EdgePruned(1, 2, d.Cause.ATTEMPT), 2.0)
    assert not len(history.added_edges(4, 2.5, 3.0).ages_s)
    np.testing.assert_allclose(history.removed_edges(4, 2.5, 3.0).ages_s, [0.5])
    assert not len(history.removed_edges(4, 6.0, 3.0).ages_s)


def test_a_loaded_map_does_not_glow() -> None:
    history = GraphHistory()
    for node in (1, 2):
        history.apply(d.NodeAdded(d.Node(node, d.PoseRow(node, 0, 0)), d.Cause.LOAD), 0.0)
    history.apply(d.EdgeAdded(d.Edge(1, 2, d.PoseRow(1, 0, 0), d.Belief(0.9, 1.0, 0.1)), d.Cause.LOAD), 0.0)
    assert not len(history.added_edges(3, 0.0, 3.0).ages_s)


def test_what_did_not_change_is_the_same_object(harness: SessionHarness) -> None:
    first = harness.wait(120).moment  # By then nothing glows any more.
    second = harness.wait(10).moment
    assert second.graph is first.graph
    assert second.trajectory is first.trajectory
    assert second.added_edges is first.added_edges


def test_the_graph_is_a_new_object_when_the_map_grew(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path, mapped=False)
    first = harness.wait(2).moment
    harness.driver.twist = Twist(0.4, 0.3)
    later = harness.wait(120).moment
    assert later.graph is not first.graph
    assert len(later.graph.ids) > len(first.graph.ids)
    assert len(later.trajectory) > len(first.trajectory)


def test_the_trajectory_is_thinned_and_ends_at_the_robot(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path, mapped=False)
    timeline = harness.state.live.timeline
    for step in range(10_000):
        timeline.append_frame(step, step * 0.1, np.array([step * 0.01, 0.0, 0.0]))
    moment = moment_of(timeline)
    assert len(moment.trajectory) <= 2001
    assert moment.trajectory[-1, 0] == pytest.approx(99.99)


def test_a_first_time_visitor_is_told_what_to_do(tmp_path: Path) -> None:
    empty, mapped = SessionHarness(tmp_path, mapped=False).wait(), SessionHarness(tmp_path).wait()
    assert "W A S D" in hint(empty)
    assert "Go" in hint(mapped)
