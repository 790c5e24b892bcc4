"""Query after query with one map: random goals, and what became of the map.

Owns the choice of goals and the counts. Time and verdicts come from the caller, as in `navigation.episode`.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ltvn_core.errors import MapError
from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, NodeAdded
from ltvn_core.navigation.episode import Episode, run_episode
from ltvn_core.navigation.events import Event, GraphChanged, Judged
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.types import NodeId


@dataclass(frozen=True, slots=True)
class LifelongTotals:
    """What several queries came to."""

    queries: int
    reached: int
    """By the paper's criterion."""
    collisions: int
    steps: int
    pruned: int
    """Edges that left the map."""
    added: int
    """Edges that came in."""
    nodes_added: int


class LifelongRun:
    """Counts while queries run."""

    def __init__(self, consume: Callable[[Event], None] | None = None) -> None:
        """Pass every event on to `consume`."""
        self._consume = consume
        self._changes: Counter[type] = Counter()
        self._episodes: list[Episode] = []

    def run(
        self,
        navigator: Navigator,
        goals: Sequence[NodeId],
        *,
        first_query: int,
        advance: Callable[[], None],
        verdict: Callable[[int, NodeId], Judged],
        before: Callable[[int], None] | None = None,
    ) -> Iterator[Episode]:
        """Run a query to each goal in turn and yield its episode; `before` may put the robot somewhere else."""
        for query, goal in enumerate(goals, first_query):
            if before is not None:
                before(query)
            episode = run_episode(
                navigator,
                goal,
                query,
                advance=advance,
                verdict=lambda q=query, g=goal: verdict(q, g),
                consume=self._count,
            )
            self._episodes.append(episode)
            yield episode

    def totals(self) -> LifelongTotals:
        """Return the counts so far."""
        ended = [episode.ended for episode in self._episodes]
        return LifelongTotals(
            len(ended),
            sum(episode.reached for episode in self._episodes),
            sum(end.collisions for end in ended),
            sum(end.steps for end in ended),
            self._changes[EdgePruned],
            self._changes[EdgeAdded],
            self._changes[NodeAdded],
        )

    def _count(self, event: Event) -> None:
        if isinstance(event, GraphChanged):
            self._changes[type(event.delta)] += 1
        if self._consume is not None:
            self._consume(event)


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
