"""Search for a story in a map: its start, door and goal, and the time after which the map would try the door again.

Owns the criteria of a good story: it is short, the map has another path, and the door is not too close to the start or
the goal. Reads exact poses to set up the story; the robot does not use them.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.door_story.unknown_way import UnknownWay, find_unknown_way
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.worlds.world_truth import room_at
from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.presence.presence_plan import plan_by_presence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.simulation.changes.world import World
from ltvn_core.types import FrameId, NodeId, Observation, Pose

_SPEED_M_S, _BACKWARDS_M_S, _TURN_RAD_S = 0.35, 0.1, 0.6
"""Approximate speeds of a robot that drives by its map: forwards and backwards in m/s, turning in rad/s."""
_STANDING_M = 0.1
"""Length of a backward motion below which the robot counts as standing, in metres."""
_BESIDE_M = 0.15
"""Greatest distance between a doorway and a path through it, in metres; an edge is straight, a drive is not."""
BEFORE_DOOR_M, BEYOND_DOOR_M = 1.0, 0.6
"""Least lengths of the planned path before and behind the door, in metres."""
_DETOUR_COST = 4.0
"""Least additional cost of the other path (one unit is about a metre), so that no plan takes it before the door was
seen closed."""
_BLIND_S = 60.0
"""Time to detect a closed door for a robot that drives backwards, in seconds."""
_S_PER_WIDTH_M = 20.0
"""Time at a closed door per metre of its width, in seconds, because the robot tries one edge after the other."""
MOST_GOALS = 30
"""Maximum number of nodes that are tried as goals."""
START_WITHIN_M, RINGS, DIRECTIONS = 2.1, 3, 8
"""Choice of starts: greatest distance from the path along which the robot was led, in metres; number of distance rings;
number of viewing directions."""
NEAREST_M = 1.2
"""Greatest distance of the robot from a node, in metres."""
_AHEAD = 10
"""Index of the path point that determines the heading at the start of the path."""
_YAW_WEIGHT_M = 0.5
"""Length of path that counts as much as a turn by one radian, in metres."""
_WAITS_S = (600.0, 1800.0, 3600.0, 2 * 3600.0, 4 * 3600.0, 8 * 3600.0, 16 * 3600.0, 24 * 3600.0)


@dataclass(frozen=True, slots=True)
class Stage:
    """Start, door and goal of a story."""

    door: int
    start: NodeId
    goal: NodeId
    duration_s: float
    """Approximate duration of the story, in seconds: to the door, and from there to the goal by the other path if there
    is one."""
    has_way_round: bool


@dataclass(frozen=True, slots=True)
class _Crossing:
    """A plan through a door."""

    door: int
    there: Sequence[NodeId]
    place: int
    """Index of the last node before the door."""
    before_s: float
    """Approximate time to that node, in seconds."""
    least_s: float
    """Approximate time of the whole path if the door is open, in seconds; a lower bound on `Stage.duration_s`."""


class StoryMap:
    """A map in a world with doors, which must not change meanwhile. Not safe for several threads."""

    def __init__(
        self,
        graph: TopologicalGraph,
        system: NavigationSystem,
        world: World,
        observation: Callable[[FrameId], Observation],
        robot: Callable[[], Pose],
    ) -> None:
        """Store the parts; `observation` returns a node's image, `robot` the robot's exact pose (3,)."""
        self.graph = graph
        self.system = system
        self.world = world
        self.robot = robot
        self._truth = GroundTruth(world.base.clearance, observation)

    def stage(self) -> Stage | None:
        """Return the shortest story from the robot's place, preferably with another path; None without any."""
        poses = self._poses(self.graph.nodes)
        robot = self.robot()
        if not len(poses) or np.hypot(*(poses[:, :2] - robot[:2]).T).min() > NEAREST_M:
            return None
        return self._best_stage([self._nearest(robot)])

    def stage_by(self, way: UnknownWay) -> Stage | None:
        """Return the shortest story with another path that starts where the robot was led; None without any."""
        best = self._best_stage(self._facing_all_ways(way.path[0]))
        return best if best is not None and best.has_way_round else None

    def unknown_way(self) -> UnknownWay | None:
        """Return a path that the map lacks and that leads around a door; None if there is none."""
        mapped = self._poses(self.graph.nodes)[:, :2]
        return find_unknown_way(self.world.base, self.world.state, mapped) if len(mapped) else None

    def start_of(self, way: UnknownWay) -> NodeId:
        """Return the node at the beginning of a path whose heading fits it best."""
        ahead = way.path[min(_AHEAD, len(way.path) - 1)] - way.path[0]
        return self._nearest(np.array([*way.path[0], np.arctan2(ahead[1], ahead[0])]))

    def pose(self, node: NodeId) -> Pose:
        """Return the exact pose (3,) of a node."""
        return self._truth.pose(node)

    def room(self, point: NDArray[np.float64]) -> str:
        """Return the name of the room around a point (2,)."""
        room = room_at(self.world.base, *point)
        return "scene" if room is None else self.world.base.rooms[room].kind.value

    def passes(self, nodes: Sequence[NodeId], door: int) -> bool:
        """Tell whether a path leads through a door."""
        return bool(self._edges_through(list(itertools.pairwise(nodes)), door))

    def wait_s(self, stage: Stage) -> float:
        """Return the time in seconds after which the map would try the door again; the longest waiting time if it never
        would."""
        presence = self.system.presence
        for wait_s in _WAITS_S:
            path = plan_by_presence(
                self._planner(),
                stage.start,
                stage.goal,
                {},
                presence.probabilities(self.graph, self.world.time_s + wait_s),
                belief_weight=self.system.method.planning.belief_weight,
            )
            if self.passes(path.nodes, stage.door):
                return wait_s
        return _WAITS_S[-1]

    def _best_stage(self, starts: Sequence[NodeId]) -> Stage | None:
        """Return the shortest story with another path from one of these nodes; without another path, the shortest story
        of all."""
        nodes = list(self.graph.nodes)
        goals = nodes[:: max(1, len(nodes) // MOST_GOALS)]
        planner = self._planner()
        closings = [self._closing(door) for door in range(len(self.world.base.parts.doors))]
        plans = (planner.plan(start, goal).nodes for start in starts for goal in goals)
        found = (each for there in plans for each in self._crossings(there, closings))
        shortest_first = sorted(found, key=lambda each: each.least_s)
        best: Stage | None = None
        for each in shortest_first:
            if best is not None and each.least_s >= best.duration_s:
                break
            stage = self._round_about(each, closings[each.door], planner)
            best = stage if stage is not None and (best is None or stage.duration_s < best.duration_s) else best
        if best is None and shortest_first:
            first = shortest_first[0]
            best = Stage(first.door, first.there[0], first.there[-1], first.least_s, has_way_round=False)
        return best

    def _crossings(self, there: Sequence[NodeId], closings: Sequence[Mapping[EdgeKey, float]]) -> Iterator[_Crossing]:
        """Yield the crossings of a plan through one door, far enough from its ends."""
        for door, closing in enumerate(closings):
            crossed = [edge for edge in itertools.pairwise(there) if edge in closing]
            if len(crossed) != 1:
                continue
            place = there.index(crossed[0][0])
            before = self._steps(there[: place + 1])
            behind = self._steps(there[place + 1 :])
            if _length_m(before) < BEFORE_DOOR_M or _length_m(behind) < BEYOND_DOOR_M:
                continue
            at_door = self._steps(there[max(0, place - 2) : place + 2])
            before_s = _duration_s(before) + _S_PER_WIDTH_M * self.world.base.parts.doors[door].width_m
            before_s += _BLIND_S * bool((at_door[:, 0] < -_STANDING_M).any())
            yield _Crossing(door, there, place, before_s, before_s + _duration_s(behind))

    def _round_about(self, crossing: _Crossing, closing: Mapping[EdgeKey, float], planner: Planner) -> Stage | None:
        """Return the story of a crossing if there is another path to the goal and it costs clearly more; None
        otherwise."""
        here = crossing.there[crossing.place]
        goal = crossing.there[-1]
        around = planner.plan(here, goal, closing)
        if not around.nodes or around.cost - planner.plan(here, goal).cost < _DETOUR_COST:
            return None
        duration_s = crossing.before_s + _duration_s(self._steps(around.nodes))
        return Stage(crossing.door, crossing.there[0], goal, duration_s, has_way_round=True)

    def _closing(self, door: int) -> dict[EdgeKey, float]:
        """Return the additional costs of edges through a closed door."""
        return dict.fromkeys(self._edges_through(list(self.graph.edges), door), math.inf)

    def _edges_through(self, edges: Sequence[EdgeKey], door: int) -> list[EdgeKey]:
        """Return the edges whose straight lines lead through a doorway."""
        doorway = self.world.base.parts.doors[door]
        ends = self._poses([node for edge in edges for node in edge])[:, :2].reshape(-1, 2, 2)
        across = ends[:, :, doorway.axis] - doorway.wall
        along = ends[:, :, 1 - doorway.axis]
        passes = across[:, 0] * across[:, 1] < 0
        gap = np.where(passes, across[:, 0] - across[:, 1], 1.0)
        at = along[:, 0] + across[:, 0] / gap * (along[:, 1] - along[:, 0])
        through = passes & (at > doorway.low - _BESIDE_M) & (at < doorway.high + _BESIDE_M)
        return [edges[k] for k in np.flatnonzero(through).tolist()]

    def _nearest(self, pose: Pose) -> NodeId:
        """Return the node that is nearest to a pose (3,), including the heading."""
        poses = self._poses(self.graph.nodes)
        away_m = np.hypot(*(poses[:, :2] - pose[:2]).T)
        turned = np.abs(wrap_angle(poses[:, 2] - pose[2]))
        return list(self.graph.nodes)[int(np.argmin(away_m + _YAW_WEIGHT_M * turned))]

    def _facing_all_ways(self, point: NDArray[np.float64]) -> list[NodeId]:
        """Return nodes near a point (2,), one per distance ring and viewing direction."""
        nodes = list(self.graph.nodes)
        poses = self._poses(nodes)
        away_m = np.hypot(*(poses[:, :2] - point).T)
        directions = np.floor(poses[:, 2] / (2 * np.pi) * DIRECTIONS).astype(int) % DIRECTIONS
        rings = np.floor(away_m / START_WITHIN_M * RINGS).astype(int)
        order = [int(k) for k in np.argsort(away_m) if away_m[k] < START_WITHIN_M]
        return [nodes[k] for k in {(int(rings[k]), int(directions[k])): k for k in reversed(order)}.values()]

    def _steps(self, nodes: Sequence[NodeId]) -> Pose:
        """Return the moves (N - 1, 3) along N nodes."""
        poses = self._poses(nodes)
        return relative(poses[:-1], poses[1:])

    def _poses(self, nodes: Iterable[NodeId]) -> Pose:
        return self._truth.poses(list(nodes))

    def _planner(self) -> Planner:
        return Planner(self.graph, self.system.method.planning, weight=self.system.edge_weight)


def _length_m(steps: Pose) -> float:
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def _duration_s(steps: Pose) -> float:
    """Return the approximate time of moves (N, 3) in seconds; backing up is slow."""
    speeds_m_s = np.where(steps[:, 0] > 0, _SPEED_M_S, _BACKWARDS_M_S)
    turns_s = np.abs(steps[:, 2]) / _TURN_RAD_S
    return float((np.hypot(steps[:, 0], steps[:, 1]) / speeds_m_s + turns_s).sum())
