"""The loop that runs one or several queries, and the paper's criterion of arrival.

Lets time pass and counts the changes of the map. Exact poses come from a caller with a simulator; the navigator never
reads them.
"""

from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from functools import partial
from typing import Any

import numpy as np

from ltvn_core.errors import MapError
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, NodeAdded
from ltvn_core.navigation.events import Event, GraphChanged, Judged, Outcome, QueryEnded, Tick
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.types import NodeId, Pose

SUCCESS_DISTANCE_M = 0.72
"""Greatest distance to a reached goal, in metres (paper)."""
SUCCESS_YAW_RAD = 0.4
"""Greatest difference of heading at a reached goal, in radians (paper)."""


def judge_goal_reached(query: int, robot: Pose, goal: Pose) -> Judged:
    """Return the paper's verdict on exact poses (3,): nearer than 0.72 m and 0.4 rad."""
    gap = relative(goal, robot)
    away_m = float(np.hypot(gap[0], gap[1]))
    yaw_rad = abs(float(gap[2]))
    return Judged(query, away_m < SUCCESS_DISTANCE_M and yaw_rad < SUCCESS_YAW_RAD, away_m, yaw_rad)


class QueryRun:
    """A running query: yields its events, counts their changes of the map, and ends with a verdict.

    The caller lets time pass at each `Tick`. Closing the iterator ends the query at once.
    """

    def __init__(
        self, navigator: Navigator, goal: NodeId, query: int, *, verdict: Callable[[], Judged | None] | None = None
    ) -> None:
        """Start a query. Raises MapError at once if the goal is not in the map.

        `verdict` judges the robot's final pose, unless a person cancelled the query; without one, or if it returns
        None, the robot's own decision counts.
        """
        self._query = query
        self._goal = goal
        self._verdict = verdict
        self._events = navigator.query(goal, query)
        self._changes: Counter[type[Any]] = Counter()
        self._ended: QueryEnded | None = None
        self._judged: Judged | None = None

    def events(self) -> Generator[Event | Tick, None, None]:
        """Yield the events of the query and a `Tick` for each control step; the verdict comes last."""
        with closing(self._events):
            for event in self._events:
                if isinstance(event, GraphChanged):
                    self._changes[type(event.delta)] += 1
                elif isinstance(event, QueryEnded):
                    self._ended = event
                yield event
        if self._ended is not None and self._ended.outcome is not Outcome.CANCELLED and self._verdict is not None:
            self._judged = self._verdict()
        if self._judged is not None:
            yield self._judged

    @property
    def result(self) -> QueryResult:
        """Result of the finished query."""
        ended = self._ended
        judged = self._judged
        assert ended is not None  # A query that is not closed always ends with its event.
        return QueryResult(
            query=self._query,
            goal=self._goal,
            reached=ended.outcome is Outcome.ARRIVED if judged is None else judged.reached,
            outcome=ended.outcome.value,
            steps=ended.steps,
            collisions=ended.collisions,
            path_m=ended.path_m,
            pruned=self._changes[EdgePruned],
            added_nodes=self._changes[NodeAdded],
            added_edges=self._changes[EdgeAdded],
            position_error_m=None if judged is None else judged.position_error_m,
            yaw_error_rad=None if judged is None else judged.yaw_error_rad,
        )


def run_query(
    navigator: Navigator,
    goal: NodeId,
    query: int,
    *,
    advance: Callable[[], None],
    verdict: Callable[[], Judged] | None = None,
    consume: Callable[[Event], None] | None = None,
) -> QueryResult:
    """Run a query to its end; it is also closed if `advance` or `consume` raises.

    Args:
        navigator: Drives the robot.
        goal: Node to drive to.
        query: Number of the query.
        advance: Lets one control step of 0.1 s pass.
        verdict: Judges the robot's final pose. Without it, the robot's own decision counts.
        consume: Called with every event, the verdict last.
    """
    run = QueryRun(navigator, goal, query, verdict=verdict)
    with closing(run.events()) as events:
        for event in events:
            if isinstance(event, Tick):
                advance()
            elif consume is not None:
                consume(event)
    return run.result


def run_queries(
    navigator: Navigator,
    goals: Sequence[NodeId],
    *,
    advance: Callable[[], None],
    verdict: Callable[[int, NodeId], Judged],
    first_query: int = 0,
    before: Callable[[int], None] | None = None,
    consume: Callable[[Event], None] | None = None,
) -> Iterator[QueryResult]:
    """Run a query to each goal in turn and yield its result; `before` may move the robot to another place."""
    for query, goal in enumerate(goals, first_query):
        if before is not None:
            before(query)
        judge = partial(verdict, query, goal)
        yield run_query(navigator, goal, query, advance=advance, verdict=judge, consume=consume)


def random_goals(nodes: Sequence[NodeId], count: int, rng: np.random.Generator) -> tuple[NodeId, ...]:
    """Return `count` goals, none twice in a row; raise MapError if there are no nodes."""
    if not nodes:
        raise MapError("The map has no nodes to go to; build it from a recording first.")
    goals: list[NodeId] = []
    while len(goals) < count:
        goal = nodes[int(rng.integers(len(nodes)))]
        if len(nodes) == 1 or not goals or goal != goals[-1]:
            goals.append(goal)
    return tuple(goals)
