"""One query to a goal: the state that all its parts share, and the questions that most of them ask.

Owns this state, what of it ends when the robot is carried, and the only way in which the map changes meanwhile. The
loop itself is in `navigation.query_runner`.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.place_belief import SURE, BelievedPlace
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.attempt_driver import AttemptDriver
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.events import GraphChanged
from ltvn_core.navigation.motion import MotionExecutor
from ltvn_core.navigation.perception import Perception
from ltvn_core.navigation.place_tracker import PlaceTracker
from ltvn_core.navigation.query_memory import QueryMemory
from ltvn_core.types import NodeId, Pose, Waypoint

_SURVEYED_M = 1.5
"""Distance from a turn on the spot within which what it showed still counts, in metres."""


class Departure(NamedTuple):
    """Where an attempt began, from where obstacles can be compared with the map."""

    node: NodeId
    waypoint: Waypoint
    """(3,) pose of the node in the robot's frame."""
    odometry: Pose
    """(3,) pose of the robot in the odometry frame."""
    needed_share: float
    """Least share of the surroundings that the map must know."""


class Survey(NamedTuple):
    """A turn on the spot to see what is around."""

    odometry: Pose
    """(3,) pose of the robot in the odometry frame."""
    is_confirmed: bool
    """Whether the images in all directions showed the believed place."""


class Query:
    """A query that runs."""

    def __init__(
        self, context: NavigationContext, motion: MotionExecutor, perception: Perception, goal: NodeId, number: int
    ) -> None:
        """Start with an empty memory."""
        self.context = context
        self.motion = motion
        self.perception = perception
        self.goal = goal
        self.number = number
        self.memory = QueryMemory(context.method.planning, context.method.localising)
        self.forget_odometry()

    def forget_odometry(self) -> None:
        """Renew what follows the robot by odometry: obstacles, the place belief, and the place of departure."""
        context = self.context
        self.driver = AttemptDriver(
            self.motion, self.perception, context.method.driving, context.spec, bystanders=context.bystanders
        )
        self.places = self.perception.places = PlaceTracker(context.graph, context.matcher, context.system)
        self.departure: Departure | None = None
        self.survey: Survey | None = None

    @property
    def method(self) -> Method:
        """The system's thresholds."""
        return self.context.method

    @property
    def now_s(self) -> float:
        """Time of the world at the current observation, in seconds."""
        return self.context.world_time_s(self.perception.observation.stamp)

    def place(self) -> BelievedPlace | None:
        """Return the robot's most probable place; None without a place belief."""
        return self.places.place(self.motion.odometry, self.memory.doubted)

    def place_p(self) -> float | None:
        """Return the probability of the robot's likeliest place; None without a place belief."""
        place = self.place()
        return None if place is None else place.probability

    def known_waypoint(self, node: NodeId, probability: float) -> Waypoint | None:
        """Return the waypoint (3,) of a node from here, if the likeliest place is more probable than `probability`."""
        return self.nodes_around(probability).get(node)

    def nodes_around(self, probability: float) -> Mapping[NodeId, Pose]:
        """Return the poses (3,) of the nodes around, in the robot's frame, the nearest first; none unless the likeliest
        place is more probable than `probability`."""
        place = self.place()
        return {} if place is None or place.probability <= probability else place.nodes

    def look(self) -> BelievedPlace | None:
        """Update the place belief with the current image, and return the most probable place; None without any."""
        _ = self.perception.features  # The belief gets every image that is encoded.
        return self.place()

    @property
    def is_surveyed(self) -> bool:
        """Whether the robot has turned round near here, to see what is around."""
        survey = self.survey
        return survey is not None and np.hypot(*(self.motion.odometry - survey.odometry)[:2]) < _SURVEYED_M

    def surveyed_waypoint(self, node: NodeId) -> Waypoint | None:
        """Return the waypoint (3,) of a node from here, if the images in all directions confirmed the sure place."""
        is_confirmed = self.survey is not None and self.survey.is_confirmed and self.is_surveyed
        return self.known_waypoint(node, SURE) if is_confirmed else None

    def is_recognised(self, reachability: float) -> bool:
        """Tell whether a node with this r is recognised."""
        return reachability > self.method.localising.reachability

    def begin_anew(self) -> None:
        """Forget the place, which was probably wrong, and trust all nodes and edges again."""
        self.places.forget()
        self.survey = None
        self.memory.begin_anew(self.motion.path_m)

    def never_closed(self, edge: EdgeKey) -> bool:
        """Tell whether an edge is a short one to the goal, which obstacles beside the goal may only seem to close."""
        is_short = self.context.graph.edges[edge].belief.mu <= self.method.building.connect_distance
        return edge[1] == self.goal and is_short

    def apply(self, deltas: Iterable[GraphDelta], attempt: int | None = None) -> Iterator[GraphChanged]:
        """Change the map, and yield an event for each change."""
        for delta in deltas:
            self.context.graph.apply(delta)
            self.context.planner.mirror_delta(delta)
            yield GraphChanged(delta, self.number, attempt)
