"""Nodes and edges of small maps that a test lays out by hand, in a line. Owns no assertion."""

from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, Node, NodeAdded, PoseRow


def node_added(frame: int, x_m: float = 0.0, cause: Cause = Cause.BUILD) -> NodeAdded:
    """Return the change that brings a node in, with odometry `x_m` along the line."""
    return NodeAdded(Node(frame, PoseRow(x_m, 0.0, 0.0)), cause)


def edge_added(
    source: int,
    target: int,
    x_m: float = 1.0,
    p: float = 0.9,
    *,
    sigma2: float = 0.02,
    attempts: int = 0,
    successes: int = 0,
    protected: bool = False,
    action: str = "",
    cause: Cause = Cause.BUILD,
) -> EdgeAdded:
    """Return the change that brings an edge in which leads `x_m` along the line, back where that is negative."""
    belief = Belief(p, abs(x_m), sigma2)
    waypoint = PoseRow(x_m, 0.0, 0.0)
    return EdgeAdded(Edge(source, target, waypoint, belief, attempts, successes, protected, action=action), cause)
