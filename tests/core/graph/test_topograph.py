"""A map is the fold of its deltas, and no delta can break its invariants."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.errors import MapError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import TopologicalGraph

AHEAD = d.PoseRow(1.0, 0.0, 0.0)
SURE = d.Belief(0.9, 1.0, 0.02)


def node(frame: int) -> d.NodeAdded:
    return d.NodeAdded(d.Node(frame, d.PoseRow(float(frame), 0.0, 0.0)), d.Cause.BUILD)


def edge(source: int, target: int, *, belief: d.Belief = SURE, protected: bool = False) -> d.EdgeAdded:
    return d.EdgeAdded(d.Edge(source, target, AHEAD, belief, protected=protected), d.Cause.BUILD)


@st.composite
def histories(draw: st.DrawFn) -> list[d.GraphDelta]:
    """Draw a history of which every delta fits."""
    graph, history = TopologicalGraph(), []
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    for _ in range(draw(st.integers(0, 60))):
        delta = _any_delta(graph, rng)
        if delta is not None:
            graph.apply(delta)
            history.append(delta)
    return history


def _any_delta(graph: TopologicalGraph, rng: np.random.Generator) -> d.GraphDelta | None:
    frame = int(rng.integers(25))
    nodes, edges, reserve = list(graph.nodes), list(graph.edges), list(graph.reserve)
    free = frame not in graph.frames
    kinds = [
        "node",
        "edge",
        "edge",
        "belief",
        "presence",
        "prune",
        "drop",
        "reserve",
        "release",
        "protect",
        "name",
        "action",
    ]
    kind = rng.choice(kinds)
    if kind == "node" and free:
        return node(frame)
    if kind == "edge" and len(nodes) > 1:
        source, target = (int(one) for one in rng.choice(nodes, 2, replace=False))
        return None if (source, target) in graph.edges else edge(source, target)
    if kind == "belief" and edges:
        source, target = edges[rng.integers(len(edges))]
        belief = d.Belief(float(rng.random()), float(rng.random()), 0.01)
        return d.BeliefUpdated(source, target, belief, 3, int(rng.integers(4)), d.Cause.ATTEMPT)
    if kind == "presence" and edges:
        source, target = edges[rng.integers(len(edges))]
        return d.PresenceObserved(source, target, bool(rng.random() < 0.5), float(rng.random()), d.Cause.ATTEMPT)
    if kind == "prune" and edges:
        return d.EdgePruned(*edges[rng.integers(len(edges))], d.Cause.HAND)
    if kind == "protect" and edges:
        return d.EdgeProtected(*edges[rng.integers(len(edges))], bool(rng.random() < 0.5), d.Cause.HAND)
    if kind == "action" and edges:
        return d.EdgeActionSet(*edges[rng.integers(len(edges))], str(rng.choice(["", "Open the door"])), d.Cause.HAND)
    if kind == "name" and nodes:
        chosen, name = int(rng.choice(nodes)), str(rng.choice(["", "kitchen", "door"]))
        taken = graph.names.get(name, chosen) != chosen
        return None if taken else d.NodeNamed(chosen, name, bool(rng.random() < 0.5), d.Cause.HAND)
    if kind == "drop" and nodes:
        return d.NodeDropped(int(rng.choice(nodes)), d.Cause.HAND)
    if kind == "reserve" and free:
        return d.FramesReserved((frame,), d.Cause.BUILD)
    if kind == "release" and reserve:
        return d.FramesReleased((int(rng.choice(reserve)),), d.Cause.EXPAND)
    return None


@given(histories())
def test_folding_the_history_gives_the_map(history: list[d.GraphDelta]) -> None:
    graph = TopologicalGraph()
    for delta in history:
        graph.apply(delta)
    assert TopologicalGraph(history) == graph
    assert graph.version == len(history)


@given(histories())
def test_the_short_history_of_a_map_folds_to_the_same_map(history: list[d.GraphDelta]) -> None:
    graph = TopologicalGraph(history)
    assert TopologicalGraph(graph.deltas()) == graph
    assert graph.copy() == graph


@settings(max_examples=30)
@given(histories())
def test_every_edge_joins_two_nodes_and_both_ends_know_it(history: list[d.GraphDelta]) -> None:
    graph = TopologicalGraph(history)
    for source, target in graph.edges:
        assert source in graph.nodes
        assert target in graph.nodes
        assert target in graph.successors(source)
        assert source in graph.predecessors(target)
    assert sum(len(graph.successors(each)) for each in graph.nodes) == len(graph.edges)
    assert len(set(graph.frames)) == len(graph.frames)


def test_a_copy_goes_its_own_way() -> None:
    graph = TopologicalGraph([node(1), node(2), edge(1, 2)])
    copy = graph.copy()
    copy.apply(d.EdgePruned(1, 2, d.Cause.HAND))
    assert graph != copy
    assert (1, 2) in graph.edges


def test_a_copy_knows_which_names_are_taken() -> None:
    copy = TopologicalGraph([node(1), node(2), d.NodeNamed(1, "sofa", False, d.Cause.HAND)]).copy()
    with pytest.raises(MapError, match="sofa"):
        copy.apply(d.NodeNamed(2, "sofa", False, d.Cause.HAND))


def test_an_edge_keeps_its_action_until_it_leaves() -> None:
    graph = TopologicalGraph([node(1), node(2), edge(1, 2), edge(2, 1)])
    driven = graph.copy()
    graph.apply(d.EdgeActionSet(1, 2, "Open the door", d.Cause.HAND))
    assert graph != driven
    assert graph.edges[1, 2].action == "Open the door"
    assert set(graph.driven_edges) == {(2, 1)}
    graph.apply(d.EdgePruned(1, 2, d.Cause.HAND))
    graph.apply(edge(1, 2))
    assert set(graph.driven_edges) == {(2, 1), (1, 2)}


def test_a_dropped_node_takes_its_edges_along() -> None:
    graph = TopologicalGraph([node(1), node(2), node(3), edge(1, 2), edge(2, 1), edge(2, 3), edge(3, 1)])
    graph.apply(d.NodeDropped(2, d.Cause.HAND))
    assert set(graph.edges) == {(3, 1)}
    assert not graph.successors(1)
    assert not graph.successors(2)


@pytest.mark.parametrize(
    ("delta", "message"),
    [
        (node(1), "Node 1 is in the map already"),
        (node(9), "Frame 9 is in the reserve"),
        (d.NodeDropped(5, d.Cause.HAND), "Node 5 is not in the map"),
        (edge(1, 5), "Node 5 is not in the map"),
        (edge(1, 1), "cannot have an edge to itself"),
        (edge(1, 2), "Edge 1 -> 2 is in the map already"),
        (edge(2, 1, belief=d.Belief(1.2, 1.0, 0.1)), r"p = 1.2; it must lie in \[0, 1\]"),
        (edge(2, 1, belief=d.Belief(0.5, float("nan"), 0.1)), "mu = nan"),
        (edge(2, 1, belief=d.Belief(0.5, 1.0, 0.0)), "sigma2 = 0.0; it must be positive"),
        (d.EdgePruned(2, 1, d.Cause.ATTEMPT), "Edge 2 -> 1 is not in the map"),
        (d.BeliefUpdated(1, 2, SURE, 1, 2, d.Cause.ATTEMPT), "counts 2 successes in 1 attempts"),
        (d.EdgeProtected(2, 1, True, d.Cause.HAND), "Edge 2 -> 1 is not in the map"),
        (d.EdgeActionSet(2, 1, "Open the door", d.Cause.HAND), "Edge 2 -> 1 is not in the map"),
        (d.EdgeActionSet(1, 2, "Open\nthe door", d.Cause.HAND), "use one line"),
        (d.EdgeActionSet(1, 2, "x" * 201, d.Cause.HAND), "at most 200"),
        (d.PresenceObserved(2, 1, False, 3.0, d.Cause.ATTEMPT), "Edge 2 -> 1 is not in the map"),
        (d.PresenceObserved(1, 2, False, math.inf, d.Cause.ATTEMPT), "a moment must be finite"),
        (d.NodeNamed(5, "kitchen", False, d.Cause.HAND), "Node 5 is not in the map"),
        (d.NodeNamed(2, "door", False, d.Cause.HAND), "Node 1 is called 'door' already"),
        (d.FramesReserved((1,), d.Cause.BUILD), "Frame 1 is a node"),
        (d.FramesReserved((9,), d.Cause.BUILD), "Frame 9 is in the reserve already"),
        (d.FramesReleased((8, 9), d.Cause.EXPAND), "Frame 8 is not in the reserve"),
    ],
)
def test_a_delta_that_does_not_fit_is_refused_and_changes_nothing(delta: d.GraphDelta, message: str) -> None:
    graph = TopologicalGraph([node(1), node(2), edge(1, 2), d.FramesReserved((9,), d.Cause.BUILD)])
    graph.apply(d.NodeNamed(1, "door", False, d.Cause.HAND))
    before = graph.copy()
    with pytest.raises(MapError, match=message):
        graph.apply(delta)
    assert graph == before


def test_only_a_person_prunes_a_protected_edge() -> None:
    graph = TopologicalGraph([node(1), node(2), edge(1, 2, protected=True)])
    with pytest.raises(MapError, match="protected"):
        graph.apply(d.EdgePruned(1, 2, d.Cause.ATTEMPT))
    graph.apply(d.EdgePruned(1, 2, d.Cause.HAND))
    assert not graph.edges
