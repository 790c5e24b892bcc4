"""How long a plan takes on a large map."""

import numpy as np

from benchmarks.measurement import Measurement, measured, seconds
from ltvn_core.config import ROBUST
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, Node, NodeAdded, PoseRow
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph

NODES, EDGES = 10_000, 50_000


def large_graph(rng: np.random.Generator) -> TopologicalGraph:
    """Return a random map in which each node is joined to nodes near it in number."""
    graph = TopologicalGraph(
        NodeAdded(Node(node, PoseRow(float(node % 100), float(node // 100), 0.0)), Cause.BUILD) for node in range(NODES)
    )
    while len(graph.edges) < EDGES:
        source = int(rng.integers(NODES))
        target = (source + int(rng.integers(1, 40)) * int(rng.choice([-1, 1]))) % NODES
        if (source, target) not in graph.edges:
            belief = Belief(float(rng.uniform(0.5, 0.95)), float(rng.uniform(0.2, 1.5)), 0.02)
            graph.apply(EdgeAdded(Edge(source, target, PoseRow(1.0, 0.0, 0.0), belief), Cause.BUILD))
    return graph


def plan_large_map() -> list[Measurement]:
    """Time a plan between random nodes of a map of 10,000 nodes and 50,000 edges."""
    rng = np.random.default_rng(0)
    planner = Planner(large_graph(rng), ROBUST.planning)

    def plan() -> None:
        planner.plan(int(rng.integers(NODES)), int(rng.integers(NODES)))

    return [measured("plan, 10,000 nodes and 50,000 edges", 1e3 * seconds(plan, 51), "ms", at_most=10)]
