"""The navigator: from a goal node to a stream of events and ticks.

Owns the beginning and the end of a query, and that the robot stands still afterwards whatever happened. What comes in
between is `nav.task`. A query is a generator: it yields events, and a `Tick` whenever the caller should let one control
step of 0.1 s pass.
"""

from collections.abc import Iterator

import numpy as np

from ltvn_core.config import Method
from ltvn_core.errors import MapError
from ltvn_core.graph.ltvn import ltvn
from ltvn_core.graph.system import System
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.nav.body import Body, QueryOver
from ltvn_core.nav.events import Event, NavigatorState, QueryEnded, QueryStarted, StateChanged, Tick
from ltvn_core.nav.eyes import Eyes
from ltvn_core.nav.mind import Mind
from ltvn_core.nav.task import Task
from ltvn_core.types import Intrinsics, NodeId, Observation, Predictor, Robot


class Navigator:
    """Drives a robot from picture to picture through a map, and keeps the map true."""

    def __init__(
        self,
        robot: Robot,
        graph: TopologicalGraph,
        views: Views,
        predictor: Predictor,
        method: Method,
        rng: np.random.Generator,
        *,
        intrinsics: Intrinsics | None = None,
        system: System | None = None,
    ) -> None:
        """Navigate in `graph`, whose images `views` holds; both change on the way if the system maintains.

        Without a `system` it is the paper's with `method`; with one, that system's own thresholds hold.
        """
        self._robot = robot
        self._mind = Mind.of(graph, views, predictor, system or ltvn(method), rng, intrinsics or Intrinsics())
        self._body: Body | None = None
        self.view: Observation | None = None
        """The picture it looked at last. Events name it by its step, so whoever records events records it too."""

    def query(self, goal: NodeId, query: int) -> Iterator[Event | Tick]:
        """Drive to a node: yield events, and ticks at which the caller lets time pass.

        Closing the iterator stops the robot at once and yields nothing more; `cancel` ends the query with its events.
        Raises MapError at once if the goal is not in the map.
        """
        if goal not in self._mind.graph.nodes:
            count = len(self._mind.graph.nodes)
            raise MapError(f"Node {goal} is not in the map, which has {count} nodes; choose one of them as the goal.")
        return self._query(goal, query)

    def cancel(self) -> None:
        """End the running query at its next control step."""
        if self._body is not None:
            self._body.cancelled = True

    def _query(self, goal: NodeId, query: int) -> Iterator[Event | Tick]:
        body = self._body = Body(self._robot, query, self._mind.method.recovering)
        eyes = Eyes(body, self._mind.predictor, self._mind.matcher, self._saw)
        try:
            yield QueryStarted(query, goal)
            try:
                outcome = yield from Task(self._mind, body, eyes, goal, query).run()
            except QueryOver as over:
                outcome = over.outcome
            body.stop()
            yield StateChanged(NavigatorState.IDLE)
            yield QueryEnded(query, goal, outcome, body.steps, body.collisions, body.path_m)
        finally:
            body.stop()
            self._body = None

    def _saw(self, observation: Observation) -> None:
        self.view = observation
