"""A map that nobody can navigate by is told of, and a map in order is not."""

import numpy as np
import pytest

from ltvn_core.graph.deltas import Cause, NodeAdded
from ltvn_core.graph.map_check import map_doubts
from ltvn_core.graph.operators import node_from_observation
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.recording.map_file import load_map
from ltvn_core.topological_map import build_doubts, build_map
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour
from tests.repository import DEMO_MAP


def test_a_map_of_one_node_is_told(caplog: pytest.LogCaptureFixture) -> None:
    standing = [observation_at(np.array([2.0, 2.0, 0.0]), step) for step in range(30)]
    built = build_map(standing, predictor=FlatPredictor(one_room()))
    assert len(built.graph.nodes) == 1
    doubt = build_doubts(standing, built.graph)[-1]
    assert "has one node, as if all 30 images showed one place" in doubt
    assert doubt in caplog.text


def test_a_map_without_edges_is_told() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    apart = TopologicalGraph(NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in images[::10])
    (doubt,) = map_doubts(apart, len(images))
    assert f"None of the {len(apart.nodes)} nodes is joined to another" in doubt


def test_maps_in_order_and_short_drives_are_not_doubted() -> None:
    loaded = load_map(DEMO_MAP)
    assert map_doubts(loaded.graph, len(loaded.observations)) == ()
    images = list(tour([(0.7, 0.7), (4.2, 0.7), (4.2, 3.2)]))
    built = build_map(images, predictor=FlatPredictor(one_room()), system=None)
    assert map_doubts(built.graph, len(images)) == ()
    assert map_doubts(TopologicalGraph(), 1) == ()
