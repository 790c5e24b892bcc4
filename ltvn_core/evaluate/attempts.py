"""Drives single edges in simulation with the navigator itself: its localisation, controller, veto and judgement.

Owns the tiny map in which an edge is driven, and where the robot starts. What counts as arrived is
`ltvn_core.nav.episode`.
"""

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from ltvn_core.config import Method
from ltvn_core.evaluate.ground import Ground
from ltvn_core.evaluate.proposals import Proposal
from ltvn_core.geometry import compose
from ltvn_core.graph.beliefs import initial
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, GraphDelta, NodeAdded, PoseRow
from ltvn_core.graph.operators import node_of, pose_row
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.nav.episode import judge
from ltvn_core.nav.events import Event, LegEnd, LegEnded, Localised, Tick
from ltvn_core.nav.navigator import Navigator
from ltvn_core.sim.odometry import OdometryNoise
from ltvn_core.sim.robot import SimulatedRobot
from ltvn_core.types import CONTROL_STEP_S, FrameId, Pose, Predictor, Waypoint

_STEP_LIMIT = 240
_LOOKS = 3
_STARTS = 20
_ROOM_M = 0.2
"""The robot is put down where it has a little more room than its radius."""


@dataclass(frozen=True, slots=True)
class Attempted:
    """An edge was driven."""

    edge: Proposal
    succeeded: bool
    """The method's own verdict, s of Eq. 3."""
    arrived: bool
    """The robot truly stands within 0.72 m and 0.4 rad of the edge's end."""
    end: LegEnd
    reason: str
    """Of the method's verdict."""


class Attempts:
    """A robot in one scene that drives one edge after the other."""

    def __init__(
        self,
        ground: Ground,
        predictor: Predictor,
        method: Method,
        errors: Waypoint,
        rng: np.random.Generator,
        *,
        noise: OdometryNoise | None = None,
    ) -> None:
        """Start edges where drives to their source would end: off by one of `errors` (E, 3), in its frame."""
        self._ground, self._predictor, self._rng, self._errors = ground, predictor, rng, errors
        short = replace(method.recovering, step_limit=_STEP_LIMIT, give_up_after_looks=_LOOKS)
        self._method = replace(method, maintain=False, recovering=short)
        start, first_step = next(iter(ground.poses.values())), max(ground.poses) + 1
        self._robot = SimulatedRobot(
            ground.scene, ground.camera, start=start, rng=rng, odometry_noise=noise, first_step=first_step
        )

    def close(self) -> None:
        """Free the physics engine."""
        self._robot.close()

    def drive(self, edge: Proposal) -> Attempted | None:
        """Drive an edge once; None if the robot never set out, because it did not find itself at the source."""
        self._robot.teleport(self._start(edge.source))
        goal = self._ground.farthest_from(edge.source)
        graph = TopologicalGraph(self._map(edge, goal))
        navigator = Navigator(self._robot, graph, self._ground.views, self._predictor, self._method, self._rng)
        # Closing the query ends it wherever it is, here after its first leg.
        with closing(cast(Generator[Event | Tick, None, None], navigator.query(goal, 0))) as events:
            for event in events:
                if isinstance(event, Tick):
                    self._robot.advance(CONTROL_STEP_S)
                elif isinstance(event, Localised) and event.node not in (None, edge.source):
                    return None
                elif isinstance(event, LegEnded) and event.source is not None:
                    return self._attempted(edge, event)
        return None

    def _attempted(self, edge: Proposal, end: LegEnded) -> Attempted:
        arrived = judge(0, self._robot.exact_pose, self._ground.poses[edge.target]).reached
        return Attempted(edge, end.succeeded, arrived, end.end, end.reason)

    def _map(self, edge: Proposal, goal: FrameId) -> list[GraphDelta]:
        """Return a map of the edge and of one that leads on, so that the edge's end is not the goal.

        At a goal the navigator would look twice and not drive the last edge when it seems to be there already.
        """
        believing, nodes = self._method.believing, (edge.source, edge.target, goal)
        belief = initial(edge.reachability, 1.0, believing)
        onward = Edge(edge.target, goal, PoseRow(1.0, 0.0, 0.0), belief)
        return [
            *(NodeAdded(node_of(self._ground.views.observation(frame)), Cause.LOAD) for frame in nodes),
            EdgeAdded(Edge(edge.source, edge.target, pose_row(edge.waypoint), belief), Cause.LOAD),
            EdgeAdded(onward, Cause.LOAD),
        ]

    def _start(self, source: FrameId) -> Pose:
        """Return where a drive to `source` would have ended, (3,)."""
        driving, exact = self._method.driving, self._ground.poses[source]
        for _ in range(_STARTS if len(self._errors) else 0):
            tolerance = [driving.position_tolerance_m, driving.position_tolerance_m, driving.yaw_tolerance_rad]
            missed = self._rng.choice(self._errors) + self._rng.uniform(-1, 1, 3) * tolerance
            start = compose(exact, missed)
            if self._ground.scene.clearance.along(exact[None, :2], start[None, :2])[0] > _ROOM_M:
                return start
        return exact
