"""Drives single edges in simulation with the navigator: its localisation, controller and obstacle avoidance.

Each edge is driven in a small map of its own. `ltvn_core.evaluation.query_run` defines arrival.
"""

from collections.abc import Generator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from ltvn_core.config import Method
from ltvn_core.evaluation.query_run import judge_goal_reached
from ltvn_core.geometry import compose
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, GraphDelta, NodeAdded, PoseRow
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.operators import initial_belief, node_from_observation, pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import AttemptEnd, AttemptEnded, Event, Localised, Tick
from ltvn_core.navigation.steering import REACHED_M, REACHED_RAD
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.simulation.wheel_odometry import OdometryNoise
from ltvn_core.types import CONTROL_STEP_S, FrameId, Pose, Predictor, Renderer, Waypoint

if TYPE_CHECKING:
    from ltvn_core.simulation.scene import Scene

_STEP_LIMIT = 240
_MAX_LOCALISATIONS = 3
_START_DRAWS = 20
_START_CLEARANCE_M = 0.2
"""Clearance of the start, a little more than the robot's radius, in metres."""


@dataclass(frozen=True, eq=False)
class ImagedScene:
    """A scene with encoded images at exact poses."""

    scene: "Scene"
    camera: Renderer
    keyframes: KeyframeStore
    """The images, encoded."""
    poses: Mapping[FrameId, Pose]
    """(3,) exact pose of each image."""
    spec: RobotSpec = LOCOBOT
    """The robot that took the images."""

    def farthest_from(self, source: FrameId, *, other_than: FrameId) -> FrameId:
        """Return the image taken farthest from `source`, other than `source` and `other_than`."""
        here = self.poses[source]
        others = [frame for frame in self.poses if frame not in (source, other_than)]
        return max(others, key=lambda frame: float(np.hypot(*(self.poses[frame] - here)[:2])))


@dataclass(frozen=True, slots=True, eq=False)
class EdgeProposal:
    """An edge that may be driven."""

    source: FrameId
    target: FrameId
    waypoint: Waypoint
    """(3,) waypoint that the edge would have in the map."""
    reachability: float
    """The method's r, with temporal support if the method uses it."""
    true: bool
    """Whether the edge is true."""
    connected: bool
    """Whether the method would add the edge to the map."""


@dataclass(frozen=True, slots=True)
class MeasuredAttempt:
    """The result of driving one edge."""

    edge: EdgeProposal
    succeeded: bool
    """Decision of the method, s of Eq. 3."""
    arrived: bool
    """Whether the robot truly is within 0.72 m and 0.4 rad of the target."""
    end: AttemptEnd
    reason: str
    """Reason for the method's decision."""


class EdgeDriver:
    """Drives edges in one scene, one by one."""

    def __init__(
        self,
        imaged_scene: ImagedScene,
        predictor: Predictor,
        method: Method,
        errors: Waypoint,
        rng: np.random.Generator,
        *,
        noise: OdometryNoise | None = None,
        body: BodyName = "auto",
    ) -> None:
        """Create a driver that starts near the source of an edge, with one of `errors` (E, 3) in the source's frame."""
        self._imaged_scene = imaged_scene
        self._predictor = predictor
        self._rng = rng
        self._errors = errors
        short = replace(method.recovering, step_limit=_STEP_LIMIT, give_up_after_looks=_MAX_LOCALISATIONS)
        self._method = replace(method, maintain=False, recovering=short)
        start = next(iter(imaged_scene.poses.values()))
        first_step = max(imaged_scene.poses) + 1
        self._robot = SimulatedRobot(
            imaged_scene.scene,
            imaged_scene.camera,
            start=start,
            rng=rng,
            odometry_noise=noise,
            first_step=first_step,
            spec=imaged_scene.spec,
            body=body,
        )

    def close(self) -> None:
        """Free the body's memory."""
        self._robot.close()

    def drive(self, edge: EdgeProposal) -> MeasuredAttempt | None:
        """Drive an edge once; None if the robot did not start, because it did not localise at the source."""
        self._robot.teleport(self._start(edge.source))
        # A bad network may propose an edge to the farthest image of all, which cannot be the goal as well.
        goal = self._imaged_scene.farthest_from(edge.source, other_than=edge.target)
        small = TopologicalMap(
            graph=TopologicalGraph(self._map(edge, goal)),
            keyframes=self._imaged_scene.keyframes,
            predictor=self._predictor,
            system=ltvn_system(self._method),
        )
        navigator = small.navigator(self._robot, seed=self._rng)
        # Closing the generator ends the query, here after its first attempt.
        with closing(cast(Generator[Event | Tick, None, None], navigator.query(goal, 0))) as events:
            for event in events:
                if isinstance(event, Tick):
                    self._robot.advance(CONTROL_STEP_S)
                elif isinstance(event, Localised) and event.node not in (None, edge.source):
                    return None
                elif isinstance(event, AttemptEnded) and event.source is not None:
                    return self._attempted(edge, event)
        return None

    def _attempted(self, edge: EdgeProposal, end: AttemptEnded) -> MeasuredAttempt:
        arrived = judge_goal_reached(0, self._robot.exact_pose, self._imaged_scene.poses[edge.target]).reached
        return MeasuredAttempt(edge=edge, succeeded=end.succeeded, arrived=arrived, end=end.end, reason=end.reason)

    def _map(self, edge: EdgeProposal, goal: FrameId) -> list[GraphDelta]:
        """Return a map with the edge and a second edge behind it, so that the target of the first edge is not the goal.

        At a goal, the navigator would check for arrival first, and would not drive the edge if it believed that it had
        arrived.
        """
        believing = self._method.believing
        nodes = (edge.source, edge.target, goal)
        belief = initial_belief(edge.reachability, 1.0, believing)
        onward = Edge(source=edge.target, target=goal, waypoint=PoseRow(1.0, 0.0, 0.0), belief=belief)
        return [
            *(
                NodeAdded(node_from_observation(self._imaged_scene.keyframes.observation(frame)), Cause.LOAD)
                for frame in nodes
            ),
            EdgeAdded(
                Edge(source=edge.source, target=edge.target, waypoint=pose_row(edge.waypoint), belief=belief),
                Cause.LOAD,
            ),
            EdgeAdded(onward, Cause.LOAD),
        ]

    def _start(self, source: FrameId) -> Pose:
        """Return the pose (3,) at which a drive to `source` could have ended."""
        exact = self._imaged_scene.poses[source]
        # A real drive ends with the error of a waypoint plus the tolerance of the controller.
        for _ in range(_START_DRAWS if len(self._errors) else 0):
            missed = self._rng.choice(self._errors) + self._rng.uniform(-1, 1, 3) * [REACHED_M, REACHED_M, REACHED_RAD]
            start = compose(exact, missed)
            if self._imaged_scene.scene.clearance.along(exact[None, :2], start[None, :2])[0] > _START_CLEARANCE_M:
                return start
        return exact
