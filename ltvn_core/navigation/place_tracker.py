"""Tracks the place of the robot over all images of a query.

Owns which images update the belief. The places and their weights are in `graph.place_belief`.
"""

from collections.abc import Collection

from ltvn_core.graph.localiser import near_enough
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.place_belief import BelievedPlace, PlaceBelief
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.observation_trail import ObservationTrail
from ltvn_core.types import NodeId, Pose, Waypoint


class PlaceTracker:
    """Tracks the robot through one query; returns no place if the system localises by single images."""

    def __init__(self, graph: TopologicalGraph, matcher: Matcher, system: NavigationSystem) -> None:
        """Start without a place."""
        self._matcher = matcher
        self._config = system.method.localising
        self._belief = PlaceBelief(graph) if system.follows_places else None
        self._seen = self._beginnings = 0

    def begin_at(self, node: NodeId, trail: ObservationTrail, odometry: Pose) -> None:
        """Believe that the robot, at an odometry pose (3,), stands at a node, whatever the observations so far show."""
        if self._belief is not None:
            self._belief.begin_at(node, odometry)
        self._seen = trail.count
        self._beginnings = trail.beginnings

    def place(self, trail: ObservationTrail, odometry: Pose, doubted: Collection[NodeId] = ()) -> BelievedPlace | None:
        """Return the most probable place of a robot at an odometry pose (3,), given the trail of observations; None if
        unknown."""
        if self._belief is None:
            return None
        self._follow(self._belief, trail)
        return self._belief.best(odometry, doubted)

    def probability_at(self, trail: ObservationTrail, odometry: Pose, node: NodeId, waypoint: Waypoint) -> float | None:
        """Return the probability that a node is at a waypoint (3,) from a robot at an odometry pose (3,); None if the
        system localises by single images."""
        if self._belief is None:
            return None
        self._follow(self._belief, trail)
        return self._belief.probability_at(odometry, node, waypoint)

    def _follow(self, belief: PlaceBelief, trail: ObservationTrail) -> None:
        """Update the belief with the observations since the last call."""
        if trail.beginnings != self._beginnings:
            belief.forget()
        for pose, features in trail.since(self._seen):
            matches = self._matcher.match(features, belief.nodes_to_ask(pose))
            belief.see(pose, matches, near_enough(matches, self._config))
        self._seen = trail.count
        self._beginnings = trail.beginnings
