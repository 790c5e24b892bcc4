"""Where the robot probably is, by all the images on its way.

Owns which images the belief gets to see. The places and their weights are in `graph.place_belief`.
"""

from collections.abc import Collection

from ltvn_core.graph.localiser import near_enough
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.place_belief import BelievedPlace, PlaceBelief
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.observation_trail import ObservationTrail
from ltvn_core.types import NodeId, Pose


class PlaceTracker:
    """Follows the robot through one query; a system that takes each image by itself never knows a place."""

    def __init__(self, graph: TopologicalGraph, matcher: Matcher, system: NavigationSystem) -> None:
        """Know nothing yet."""
        self._matcher = matcher
        self._config = system.method.localising
        self._belief = PlaceBelief(graph) if system.follows_places else None
        self._seen = self._beginnings = 0

    def place(self, trail: ObservationTrail, odometry: Pose, doubted: Collection[NodeId] = ()) -> BelievedPlace | None:
        """Return where the robot probably is at an odometry pose (3,), after all of the trail; None if unknown."""
        if self._belief is None:
            return None
        if trail.beginnings != self._beginnings:
            self._belief.forget()
        for pose, features in trail.since(self._seen):
            matches = self._matcher.match(features, self._belief.nodes_to_ask(pose))
            self._belief.see(pose, matches, near_enough(matches, self._config))
        self._seen = trail.count
        self._beginnings = trail.beginnings
        return self._belief.best(odometry, doubted)
