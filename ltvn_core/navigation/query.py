"""One query to a goal: the state that all its parts share, and the rules that change it.

Owns this state, what of it ends when the robot is carried, and the only way in which the map changes meanwhile. The
loop itself is in `navigation.query_runner`.
"""

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.place_belief import SURE, BelievedPlace
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.action_performer import ActionPerformer
from ltvn_core.navigation.attempt_driver import AttemptDriver
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.events import GraphChanged, NavigatorState, Outcome, StateChanged
from ltvn_core.navigation.perception import MotionExecutor, Perception, PlaceTracker
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import NodeId, Pose, Waypoint

MOST_OBSTRUCTIONS = 4
"""Number of obstructions in one query after which the robot plans no more paths through edges that seem closed."""
_MOST_FRESH_HOPES = 2
"""Number of times that closed edges may be tried again, each after a full look around."""
_SURVEYED_M = 1.5
"""Distance from a turn on the spot within which what it showed still counts, in metres."""


@dataclass(frozen=True, slots=True, eq=False)
class NavigationContext:
    """The objects that outlive one query."""

    graph: TopologicalGraph
    keyframes: KeyframeStore
    system: NavigationSystem
    rng: np.random.Generator
    spec: RobotSpec
    """The robot's size and camera."""
    matcher: Matcher
    planner: Planner
    bystanders: Bystanders
    """The people around the robot."""
    world_time: Callable[[], float] | None = None
    """Returns the time of the world in seconds; None if the robot's clock shows the time of the world."""
    actions: ActionPerformer | None = None
    """Performs the actions of edges; if None, each action fails."""
    attempt_numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))
    """Numbers of the next attempts."""


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


@dataclass(slots=True, eq=False)
class QueryState:
    """A query that runs. Beliefs that outlive it belong to the map."""

    context: NavigationContext
    motion: MotionExecutor
    perception: Perception
    goal: NodeId
    number: int

    # Set by each round of the loop.
    state: NavigatorState = NavigatorState.IDLE
    plan: tuple[NodeId, ...] = ()
    """Nodes of the last plan; localisation searches around them first."""
    reached: NodeId | None = None
    """The node that the last attempt approached and reached."""
    approached: NodeId | None = None
    """The node that the robot last approached before driving to its successor."""
    assumed_node: NodeId | None = None
    """Node where the robot is assumed to be, because an attempt to reach it took no step; used once."""

    # Set by attempts, kept until the query ends; the rules against driving in circles.
    driven: Counter[EdgeKey] = field(default_factory=Counter)
    failed: set[EdgeKey] = field(default_factory=set)
    stopped: set[EdgeKey] = field(default_factory=set)
    """Edges on which an obstacle stopped the robot."""
    penalties: dict[EdgeKey, float] = field(default_factory=dict)
    """Extra costs of edges."""
    searched: set[NodeId] = field(default_factory=set)
    """Starts without a path, from where the map was extended."""
    surveys: int = 0
    """Number of turns on the spot to see whether the goal is here."""

    # Set by recovery.
    consecutive_failures: int = 0
    """Consecutive observations without a node or without a path."""
    give_up_outcome: Outcome = Outcome.LOST
    """Outcome if the query is given up; `NO_PATH` takes precedence over `LOST`."""

    # Renewed by `begin_anew`.
    first_looks: int = 0
    """Number of turns since the place was forgotten, because the robot was lost or could be at several places."""
    began_at_m: float = 0.0
    """Distance driven when the place was forgotten, in metres."""
    doubted: set[NodeId] = field(default_factory=set)
    """Nodes that localisation excludes, because attempts from them or to them failed."""
    failed_from: Counter[NodeId] = field(default_factory=Counter)
    fresh_hopes: int = 0
    obstructions: int = 0
    """Number of obstructions met so far; renewed a few times."""
    felt_closed: set[EdgeKey] = field(default_factory=set)
    """Edges closed by an obstacle that stopped the robot; an image of a free path does not reopen them."""

    # Renewed when the robot is carried, because they follow it by odometry.
    driver: AttemptDriver = field(init=False)
    places: PlaceTracker = field(init=False)
    departure: Departure | None = field(init=False)
    survey: Survey | None = field(init=False)
    looked_from: list[Pose] = field(init=False)
    """Poses (3,) in the odometry frame from where the robot looked to tell places apart."""

    def __post_init__(self) -> None:
        """Start with a robot that knows nothing about its place."""
        self._forget_odometry()

    def _forget_odometry(self) -> None:
        context = self.context
        self.driver = AttemptDriver(
            self.motion, self.perception, self.method.driving, context.spec, bystanders=context.bystanders
        )
        self.places = self.perception.places = PlaceTracker(context.graph, context.matcher, context.system)
        self.departure = self.survey = None
        self.looked_from = []

    @property
    def method(self) -> Method:
        """The system's thresholds."""
        return self.context.system.method

    @property
    def now_s(self) -> float:
        """Time of the world at the current observation, in seconds."""
        world_time = self.context.world_time
        stamp = self.perception.observation.stamp
        return stamp if world_time is None else world_time()

    def place(self) -> BelievedPlace | None:
        """Return the robot's most probable place; None without a place belief."""
        return self.places.place(self.motion.odometry, self.doubted)

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

    @property
    def survey_here(self) -> Survey | None:
        """The last turn on the spot, if it was made near here."""
        survey = self.survey
        is_here = survey is not None and np.hypot(*(self.motion.odometry - survey.odometry)[:2]) < _SURVEYED_M
        return survey if is_here else None

    def surveyed_waypoint(self, node: NodeId) -> Waypoint | None:
        """Return the waypoint (3,) of a node from here, if the images in all directions confirmed the sure place."""
        here = self.survey_here
        return self.known_waypoint(node, SURE) if here is not None and here.is_confirmed else None

    def is_recognised(self, reachability: float) -> bool:
        """Tell whether a node with this r is recognised."""
        return reachability > self.method.localising.reachability

    def never_closed(self, edge: EdgeKey) -> bool:
        """Tell whether an edge is a short one to the goal, which obstacles beside the goal may only seem to close."""
        is_short = self.context.graph.edges[edge].belief.mu <= self.method.building.connect_distance
        return edge[1] == self.goal and is_short

    def count_drive(self, edge: EdgeKey) -> bool:
        """Count an attempt along an edge; tell whether the number of attempts exceeds the limit of repeats."""
        self.driven[edge] += 1
        return 0 < self.method.planning.repeat_limit < self.driven[edge]

    def record_failures(self, edges: Iterable[EdgeKey]) -> None:
        """Remember that an attempt along edges failed, and raise their costs; any of them may be the cause."""
        for edge in edges:
            self.failed.add(edge)
            if penalty := self.method.planning.failure_penalty:
                self.penalties[edge] = self.penalties.get(edge, 0.0) + penalty

    def record_failure_from(self, node: NodeId) -> None:
        """Remember that an attempt from a node failed; after several failures, doubt that the robot is there."""
        self.failed_from[node] += 1
        if 0 < self.method.localising.doubt_after_failures <= self.failed_from[node]:
            self.doubted.add(node)

    def begin_anew(self) -> None:
        """Forget the place, which was probably wrong, and trust all nodes again; the penalties are kept.

        A few times per query, closed edges are trusted again, too.
        """
        self.places.forget()
        self.survey = None
        self.looked_from.clear()
        self.first_looks = 0
        self.began_at_m = self.motion.path_m
        self.doubted.clear()
        self.failed_from.clear()
        self.fresh_hopes += 1
        if self.fresh_hopes <= _MOST_FRESH_HOPES:
            self.obstructions = 0
            self.felt_closed.clear()

    def arrive_elsewhere(self, node: NodeId) -> None:
        """Continue at a node to which the robot was carried; what was known about its place no longer holds."""
        self.assumed_node = node
        self.approached = None
        self.doubted.clear()
        self._forget_odometry()
        self.places.begin_at(node, self.motion.odometry)

    def enter(self, state: NavigatorState) -> Iterator[StateChanged]:
        """Go over to a state, and yield an event if it is another."""
        if state is not self.state:
            self.state = state
            yield StateChanged(state)

    def apply(self, deltas: Iterable[GraphDelta], attempt: int | None = None) -> Iterator[GraphChanged]:
        """Change the map, and yield an event for each change."""
        for delta in deltas:
            self.context.graph.apply(delta)
            self.context.planner.mirror_delta(delta)
            yield GraphChanged(delta, self.number, attempt)
