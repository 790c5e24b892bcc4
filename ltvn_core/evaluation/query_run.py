"""The loop that runs queries, one or several in turn, and the paper's verdict on their ends.

Lets time pass and counts what became of the map. Exact poses come in from a caller who has a simulator; the navigator
never sees them.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
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
"""The robot must end nearer than this to the goal (paper)."""
SUCCESS_YAW_RAD = 0.4
"""And turned less than this away from it (paper)."""


def judge_goal_reached(query: int, robot: Pose, goal: Pose) -> Judged:
    """Return the paper's verdict on exact poses (3,): nearer than 0.72 m and 0.4 rad."""
    gap = relative(goal, robot)
    away_m = float(np.hypot(gap[0], gap[1]))
    yaw_rad = abs(float(gap[2]))
    return Judged(query, away_m < SUCCESS_DISTANCE_M and yaw_rad < SUCCESS_YAW_RAD, away_m, yaw_rad)


def run_query(
    navigator: Navigator,
    goal: NodeId,
    query: int,
    *,
    advance: Callable[[], None],
    verdict: Callable[[], Judged] | None = None,
    consume: Callable[[Event], None] | None = None,
) -> QueryResult:
    """Run a query to its end; it is closed too where `advance` or `consume` raises.

    Args:
        navigator: What drives the robot.
        goal: Node to drive to.
        query: Number of the query.
        advance: Lets one control step of 0.1 s pass.
        verdict: Judges the robot where it stands at the end. Without it, what the robot believes counts.
        consume: Gets every event, the verdict last.
    """
    ended: QueryEnded | None = None
    changes: Counter[type[Any]] = Counter()
    with closing(navigator.query(goal, query)) as events:  # type: ignore[type-var]  # A generator.
        for event in events:
            if isinstance(event, Tick):
                advance()
                continue
            if consume is not None:
                consume(event)
            if isinstance(event, GraphChanged):
                changes[type(event.delta)] += 1
            ended = event if isinstance(event, QueryEnded) else ended
    assert ended is not None  # A query that is not closed always ends with its event.
    judged = None if verdict is None else verdict()
    if consume is not None and judged is not None:
        consume(judged)
    return QueryResult(
        query=query,
        goal=goal,
        reached=ended.outcome is Outcome.ARRIVED if judged is None else judged.reached,
        outcome=ended.outcome.value,
        steps=ended.steps,
        collisions=ended.collisions,
        path_m=ended.path_m,
        pruned=changes[EdgePruned],
        added_nodes=changes[NodeAdded],
        added_edges=changes[EdgeAdded],
        position_error_m=None if judged is None else judged.position_error_m,
        yaw_error_rad=None if judged is None else judged.yaw_error_rad,
    )


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
    """Run a query to each goal in turn and yield its result; `before` may put the robot somewhere else."""
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
