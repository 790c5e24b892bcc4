"""Where a story can play: which plan leads through one door, and how long the way round takes once it is closed.

Owns what makes a story a good one: short, with a way round, and with some way to go before the door and behind it.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ltvn_core.evaluation.door_story.mapped_ways import MappedWays
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

BEFORE_DOOR_M, BEYOND_DOOR_M = 1.0, 0.6
"""The planned way goes so far at least before the door and behind it."""
_DETOUR_COST = 4.0
"""A way round is so much dearer, about as many metres, that no plan takes it before the door was seen closed."""
_BLIND_S = 60.0
"""A robot that backs up to a door does not see that it is closed, which takes it so long to find out."""
_S_PER_WIDTH_M = 20.0
"""Wide doorways are many edges wide, and the robot tries one after the other."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Where the story plays."""

    door: int
    start: NodeId
    goal: NodeId
    duration_s: float
    """About what it takes to get to the door, and from there to the goal, round about where one can."""
    has_way_round: bool


class _Crossing(NamedTuple):
    """A plan through a door."""

    door: int
    there: Sequence[NodeId]
    place: int
    """Of the last node before the door."""
    before_s: float
    """About what it takes to get there."""
    least_s: float
    """What the whole way takes if the door is open, which is less than any way round does."""


@dataclass(frozen=True, slots=True, eq=False)
class StageSearch:
    """Looks for stages in a map, as a planner sees it."""

    graph: TopologicalGraph
    planner: Planner
    ways: MappedWays

    def best(self, starts: Sequence[NodeId], goals: Sequence[NodeId]) -> Stage | None:
        """Return the shortest story with a way round, without any the shortest of all."""
        closings = [self._closing(door) for door in range(len(self.ways.doors))]
        plans = (self.planner.plan(start, goal).nodes for start in starts for goal in goals)
        found = (each for there in plans for each in self._crossings(there, closings))
        shortest_first = sorted(found, key=lambda each: each.least_s)
        best: Stage | None = None
        for each in shortest_first:
            if best is not None and each.least_s >= best.duration_s:
                break
            stage = self._round_about(each, closings[each.door])
            best = stage if stage is not None and (best is None or stage.duration_s < best.duration_s) else best
        if best is None and shortest_first:
            first = shortest_first[0]
            best = Stage(first.door, first.there[0], first.there[-1], first.least_s, has_way_round=False)
        return best

    def _closing(self, door: int) -> dict[EdgeKey, float]:
        """Return what a closed door adds to the cost of edges."""
        return dict.fromkeys(self.ways.edges_through(list(self.graph.edges), door), math.inf)

    def _crossings(self, there: Sequence[NodeId], closings: Sequence[Mapping[EdgeKey, float]]) -> Iterator[_Crossing]:
        """Yield where a plan leads through one door, far enough from its ends."""
        for door, closing in enumerate(closings):
            crossed = [edge for edge in itertools.pairwise(there) if edge in closing]
            if len(crossed) != 1:
                continue
            place = there.index(crossed[0][0])
            before, behind = there[: place + 1], there[place + 1 :]
            if self.ways.length_m(before) < BEFORE_DOOR_M or self.ways.length_m(behind) < BEYOND_DOOR_M:
                continue
            before_s = self.ways.duration_s(before) + _S_PER_WIDTH_M * self.ways.doors[door].width_m
            before_s += _BLIND_S * self.ways.is_backwards(there[max(0, place - 2) : place + 2])
            yield _Crossing(door, there, place, before_s, before_s + self.ways.duration_s(behind))

    def _round_about(self, crossing: _Crossing, closing: Mapping[EdgeKey, float]) -> Stage | None:
        """Return the story of a crossing where another way leads to the goal that is clearly dearer, or None."""
        here, goal = crossing.there[crossing.place], crossing.there[-1]
        around = self.planner.plan(here, goal, closing)
        if not around.nodes or around.cost - self.planner.plan(here, goal).cost < _DETOUR_COST:
            return None
        duration_s = crossing.before_s + self.ways.duration_s(around.nodes)
        return Stage(crossing.door, crossing.there[0], goal, duration_s, has_way_round=True)
