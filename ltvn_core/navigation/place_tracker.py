"""Tracks the place of the robot over all images of a query.

Owns which images update the belief, and when: not before somebody asks for the place. The places and their weights are
in `graph.place_belief`.
"""

from collections import deque
from collections.abc import Collection

from ltvn_core.geometry import distance, relative
from ltvn_core.graph.localiser import near_enough
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.place_belief import BelievedPlace, PlaceBelief
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, NodeId, Pose, Waypoint

_MAX_OBSERVATIONS = 24
"""Maximum number of observations that wait for an update. Odometry drifts, so older ones say little."""
_MIN_SPACING = 0.2
"""Least d from the last observation at which a new one is used."""


class PlaceTracker:
    """Tracks the robot through one query; returns no place if the system localises by single images."""

    def __init__(self, graph: TopologicalGraph, matcher: Matcher, system: NavigationSystem) -> None:
        """Start without a place."""
        self._matcher = matcher
        self._config = system.method.localising
        self._belief = PlaceBelief(graph) if system.follows_places else None
        self._last: Pose | None = None
        self._waiting: deque[tuple[Pose, Features]] = deque(maxlen=_MAX_OBSERVATIONS)

    def observe(self, odometry: Pose, features: Features) -> None:
        """Use features (1, F) taken at an odometry pose (3,), unless the robot has hardly moved since the last."""
        if self._last is None or distance(relative(self._last, odometry)) > _MIN_SPACING:
            self._last = odometry.copy()
            self._waiting.append((self._last, features))

    def forget(self) -> None:
        """Start over, because the place was probably wrong."""
        self._last = None
        self._waiting.clear()
        if self._belief is not None:
            self._belief.forget()

    def begin_at(self, node: NodeId, odometry: Pose) -> None:
        """Believe that the robot, at an odometry pose (3,), stands at a node, whatever the observations so far show."""
        self._waiting.clear()
        if self._belief is not None:
            self._belief.begin_at(node, odometry)

    def place(self, odometry: Pose, doubted: Collection[NodeId] = ()) -> BelievedPlace | None:
        """Return the most probable place of a robot at an odometry pose (3,); None if unknown."""
        belief = self._updated()
        return None if belief is None else belief.best(odometry, doubted)

    def probability_at(self, odometry: Pose, node: NodeId, waypoint: Waypoint) -> float | None:
        """Return the probability that a node is at a waypoint (3,) from a robot at an odometry pose (3,); None if the
        system localises by single images."""
        belief = self._updated()
        return None if belief is None else belief.probability_at(odometry, node, waypoint)

    def _updated(self) -> PlaceBelief | None:
        """Return the belief after all observations so far."""
        belief = self._belief
        while self._waiting:
            odometry, features = self._waiting.popleft()
            if belief is not None:
                matches = self._matcher.match(features, belief.nodes_to_ask(odometry))
                belief.see(odometry, matches, near_enough(matches, self._config))
        return belief
