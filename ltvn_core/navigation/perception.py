"""Motion and perception of the robot during one query, one control step at a time.

Owns the numbers of steps and collisions and their limits: every step returns control to the caller with a `Tick`. Owns
the current observation, encoded at most once and compared with nodes on demand, and which images update the belief in
the robot's place, and when: not before somebody asks for the place. The places and their weights are in
`graph.place_belief`. Decides nothing.
"""

from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.depth_points import map_points, transform_points
from ltvn_core.config import RecoveryConfig
from ltvn_core.errors import RobotPausedError
from ltvn_core.geometry import compose, distance, relative
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import Localisation, LocalisationPrior, near_enough
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.place_belief import BelievedPlace, PlaceBelief
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.graph.wheel_slips import SlipTracker
from ltvn_core.navigation.events import Collided, Event, Note, Outcome, Severity, Tick
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import (
    CONTROL_STEP_S,
    ZERO_TWIST,
    Features,
    NodeId,
    Observation,
    Pose,
    Predictor,
    RobotState,
    Twist,
    Waypoint,
    is_usable,
)

_T = TypeVar("_T")
EventGenerator: TypeAlias = Generator[Event | Tick, None, _T]
"""Part of a query: yields events and ticks, returns a result."""


class QueryAborted(Exception):
    """The query ended early, because a limit was reached or a person cancelled it."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.value)
        self.outcome = outcome


class MotionExecutor:
    """Drives the robot for one query."""

    def __init__(self, robot: Robot, query: int, limits: RecoveryConfig, *, slips: SlipTracker | None = None) -> None:
        """Start counting at zero; `slips` corrects odometry where images contradict it."""
        self._robot = robot
        self._query = query
        self._limits = limits
        self._slips = slips
        self.state = self._mended(robot.state())
        """State of the robot after the last step, with corrected odometry."""
        self.steps = 0
        self._uncounted = 0
        self.collisions = 0
        self.path_m = 0.0
        self.cancelled = False

    @property
    def odometry(self) -> Pose:
        """(3,) pose of the robot in the odometry frame."""
        return self.state.odometry

    def observe(self) -> Observation:
        """Take an observation now; correct odometry if the observation shows that the wheels slipped."""
        while True:
            try:
                seen = self._robot.observe()
                break
            except RobotPausedError:  # After a pause of this program, stand still until the robot obeys again.
                self._robot.stop()
                self._robot.clock.advance(CONTROL_STEP_S)
        if self._slips is None:
            return seen
        seen = self._slips.see(seen)
        self.state = self.state._replace(odometry=self._mended(self._robot.state()).odometry)
        return seen

    def move(self, twist: Twist) -> Iterator[Event | Tick]:
        """Command a velocity for one control step; raise QueryAborted at a limit."""
        if self.cancelled:
            raise QueryAborted(Outcome.CANCELLED)
        if self.steps - self._uncounted >= self._limits.step_limit:
            raise QueryAborted(Outcome.STEP_LIMIT)
        self._robot.drive(twist)
        yield Tick()
        felt = self._robot.state()
        before, self.state = self.state, self._mended(felt)
        self.steps += 1
        self.path_m += float(np.hypot(*(self.state.odometry - before.odometry)[:2]))
        if self.state.bumper_pressed and not before.bumper_pressed:
            self.collisions += 1
            yield Collided(self._query, self.collisions)
        if self.collisions > self._limits.collision_limit:
            raise QueryAborted(Outcome.COLLISION_LIMIT)
        if self._slips is not None and self._slips.needs_image(felt.odometry):
            self.observe()

    def wait_one_step(self) -> Iterator[Event | Tick]:
        """Stand still for one control step.

        The step counts against the step limit, so that no loop is endless.
        """
        yield from self.move(ZERO_TWIST)

    def stand_by(self) -> Iterator[Event | Tick]:
        """Let one control step pass while the robot may be carried.

        It counts neither against the step limit nor as driven distance.
        """
        driven_m = self.path_m
        self._uncounted += 1
        yield from self.move(ZERO_TWIST)
        self.path_m = driven_m

    def drive_straight(
        self, length_m: float, speed_m_s: float, *, goes_on: Callable[[], bool] = lambda: True
    ) -> Iterator[Event | Tick]:
        """Drive straight by a length, backwards if negative; stop at a collision, or when `goes_on` returns False."""
        start = self.path_m
        for _ in range(2 + int(2 * abs(length_m) / (speed_m_s * CONTROL_STEP_S))):
            if self.path_m - start >= abs(length_m) or not goes_on():
                return
            collisions_before = self.collisions
            yield from self.move(Twist(float(np.sign(length_m) * speed_m_s), 0.0))
            if self.collisions > collisions_before:
                return

    def _mended(self, state: RobotState) -> RobotState:
        """Return a state of the robot with odometry corrected for wheel slips."""
        return state if self._slips is None else state._replace(odometry=self._slips.mended(state.odometry))


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
        self._belief = PlaceBelief(graph, matcher) if system.follows_places else None
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
        belief = self.belief()
        return None if belief is None else belief.best(odometry, doubted)

    def belief(self) -> PlaceBelief | None:
        """Return the belief after all observations so far; None if the system localises by single images."""
        belief = self._belief
        while self._waiting:
            odometry, features = self._waiting.popleft()
            if belief is not None:
                matches = self._matcher.match(features, belief.nodes_to_ask(odometry))
                belief.see(odometry, matches, near_enough(matches, self._config))
        return belief


class NodeMatch(NamedTuple):
    """The prediction for a node from the current observation."""

    reachability: float
    distance: float
    """d(w), Eq. 2."""
    waypoint: Waypoint
    """(3,): the node in the robot's frame."""

    def with_waypoint(self, waypoint: Waypoint) -> "NodeMatch":
        """Return the same match with a better waypoint."""
        return self._replace(waypoint=waypoint, distance=float(distance(waypoint)))


class Perception:
    """Takes observations and compares them with nodes."""

    def __init__(self, motion: MotionExecutor, predictor: Predictor, matcher: Matcher) -> None:
        """Observe through `motion`."""
        self._motion = motion
        self._predictor = predictor
        self._matcher = matcher
        self.places: PlaceTracker | None = None
        """Gets every encoded observation, if it is set."""
        self._told_of_no_depth = False
        self._at_step = -1
        self._observation: Observation | None = None
        self._features: Features | None = None
        self._matches: dict[NodeId, Matches] = {}

    @property
    def observation(self) -> Observation:
        """The current observation, a new one if the robot has moved since the last."""
        if self._observation is None or self._at_step != self._motion.steps:
            self._observation = self._motion.observe()
            self._at_step = self._motion.steps
            self._features = None
            self._matches = {}
        return self._observation

    @property
    def is_usable(self) -> bool:
        """Whether the predictor can compare the current observation; some need depth, see `types.is_usable`."""
        return is_usable(self.observation, self._predictor)

    def can_compare(self) -> Generator[Note, None, bool]:
        """Return whether the current observation is usable; yield a note if it is not but the one before was."""
        usable = self.is_usable
        if not usable and not self._told_of_no_depth:
            text = f"Image {self.observation.step} has no depth; the robot continues with its previous belief."
            yield Note(text, Severity.WARN)
        self._told_of_no_depth = not usable
        return usable

    @property
    def features(self) -> Features:
        """(1, F) features of the current observation."""
        seen = self.observation
        if self._features is None:
            self._features = self._predictor.encode([seen])
            if self.places is not None:
                self.places.observe(seen.odometry, self._features)
        return self._features

    def node_match(self, node: NodeId) -> NodeMatch:
        """Compare the current observation with a node; r is 0 if the observation is not usable."""
        if not self.is_usable:
            return NodeMatch(reachability=0.0, distance=np.inf, waypoint=np.zeros(3))
        found = self._match(node)
        return NodeMatch(float(found.reachability[0]), float(found.distances[0]), found.waypoints[0])

    def mapped_points(
        self, nodes: Mapping[NodeId, Pose], reach: int, spec: RobotSpec, *, range_m: float
    ) -> NDArray[np.float64]:
        """Return solid points (M, 2) within a range of the camera in the images of nodes, and in `reach` images before
        and after each, in the frame in which the nodes have these poses (3,)."""
        keyframes = self._matcher.keyframes
        seen = [np.empty((0, 2))]
        for node, pose in nodes.items():
            odometry = keyframes.observation(node).odometry
            for image in map(keyframes.observation, (node, *keyframes.temporal_window(node, reach))):
                points = map_points(image, camera=spec.camera, range_m=range_m, height_m=spec.clear_height_m)
                seen.append(transform_points(points, compose(pose, relative(odometry, image.odometry))))
        return np.concatenate(seen)

    def with_node_support(self, node: NodeId) -> NodeMatch:
        """Compare the current observation with a node; r is lowered to what the node's neighbours in time support."""
        supported = self._matcher.with_node_support(self._match(node), self.features)
        return self.node_match(node)._replace(reachability=float(supported.reachability[0]))

    def _match(self, node: NodeId) -> Matches:
        image = self.features  # Encode first, because a new observation clears the comparisons of the last one.
        if node not in self._matches:
            self._matches[node] = self._matcher.match(image, (node,))
        return self._matches[node]


class PassiveLocaliser:
    """Localises images one by one, as the navigator does at the beginning of a query."""

    def __init__(
        self, graph: TopologicalGraph, keyframes: KeyframeStore, predictor: Predictor, system: NavigationSystem
    ) -> None:
        """Localise in `graph`, which is not changed."""
        self._graph = graph
        self._predictor = predictor
        self._system = system
        self._matcher = Matcher(predictor, keyframes, system.method.matching)
        self._places = PlaceTracker(graph, self._matcher, system)

    def localise(self, seen: Observation) -> Localisation | None:
        """Return where the next image of the drive was taken; None if it cannot be compared, such as an image without
        depth."""
        if not is_usable(seen, self._predictor):
            return None
        features = self._predictor.encode([seen])
        self._places.observe(seen.odometry, features)
        place = self._places.place(seen.odometry)
        return self._system.localise(features, self._graph, LocalisationPrior(place=place), self._matcher)
