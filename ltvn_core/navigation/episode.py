"""One query from start to end, and the paper's verdict on it.

Owns the loop that lets time pass and the criterion. Exact poses come in from the caller, who has a simulator; the
navigator never sees them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ltvn_core.geometry import relative
from ltvn_core.navigation.events import Event, Judged, QueryEnded, Tick
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.types import NodeId, Pose

SUCCESS_DISTANCE_M = 0.72
"""The robot must end nearer than this to the goal (paper)."""
SUCCESS_YAW_RAD = 0.4
"""And turned less than this away from it (paper)."""


@dataclass(frozen=True, slots=True)
class Episode:
    """A query that is over, and its verdict."""

    ended: QueryEnded
    judged: Judged

    @property
    def reached(self) -> bool:
        """By the paper's criterion."""
        return self.judged.reached


def judge_goal_reached(query: int, robot: Pose, goal: Pose) -> Judged:
    """Return the paper's verdict on exact poses (3,): nearer than 0.72 m and 0.4 rad."""
    gap = relative(goal, robot)
    away_m, yaw_rad = float(np.hypot(gap[0], gap[1])), abs(float(gap[2]))
    return Judged(query, away_m < SUCCESS_DISTANCE_M and yaw_rad < SUCCESS_YAW_RAD, away_m, yaw_rad)


def run_episode(
    navigator: Navigator,
    goal: NodeId,
    query: int,
    *,
    advance: Callable[[], None],
    verdict: Callable[[], Judged],
    consume: Callable[[Event], None] | None = None,
) -> Episode:
    """Run a query to its end.

    `advance` lets one control step of 0.1 s pass, `verdict` judges the robot where it stands, `consume` gets every
    event, the verdict last.
    """
    ended: QueryEnded | None = None
    for event in navigator.query(goal, query):
        if isinstance(event, Tick):
            advance()
            continue
        if consume is not None:
            consume(event)
        ended = event if isinstance(event, QueryEnded) else ended
    assert ended is not None  # A query that is not closed always ends with its event.
    judged = verdict()
    if consume is not None:
        consume(judged)
    return Episode(ended, judged)
