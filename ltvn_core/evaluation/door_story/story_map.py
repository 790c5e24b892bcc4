"""What a story needs to know of a map: from where to where it can play, and when the map would try its door again.

Reads exact poses, for it sets the scene; the robot that plays in it knows nothing of that. Owns which nodes are thought
of as starts and goals; what lies between them is judged in `stage_search`.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.door_story.mapped_ways import MappedWays
from ltvn_core.evaluation.door_story.stage_search import Stage, StageSearch
from ltvn_core.evaluation.door_story.unknown_way import UnknownWay, find_unknown_way
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.geometry import wrap_angle
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.presence.presence_plan import plan_by_presence
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.simulation.changes.world import World
from ltvn_core.types import FrameId, NodeId, Observation, Pose

MOST_GOALS = 30
"""So many nodes are thought of as goals."""
START_WITHIN_M, RINGS, DIRECTIONS = 2.1, 3, 8
"""As starts those this near to where the robot was led, one in each of so many rings, looking each of so many ways."""
NEAREST_M = 1.2
"""The robot must be so near to a node."""
_AHEAD = 10
"""The heading of a way is that towards its point of this number."""
_YAW_WEIGHT_M = 0.5
"""A radian to turn counts as much as this way."""
_WAITS_S = (600.0, 1800.0, 3600.0, 2 * 3600.0, 4 * 3600.0, 8 * 3600.0, 16 * 3600.0, 24 * 3600.0)


class StoryMap:
    """A map in a world with doors. For one thread, while nobody else changes the map."""

    def __init__(
        self,
        graph: TopologicalGraph,
        system: NavigationSystem,
        world: World,
        observation: Callable[[FrameId], Observation],
        robot: Callable[[], Pose],
    ) -> None:
        """Take hold of all; `observation` returns a node's image, `robot` where the robot really is, (3,)."""
        self.graph, self.system, self.world = graph, system, world
        self._truth = GroundTruth(world.base.clearance, observation)
        self._ways = MappedWays(self._truth, world.base.parts.doors)
        self.robot = robot
        self.unknown_way_found: UnknownWay | None = None
        """What `unknown_way` found last."""

    def stage(self) -> Stage | None:
        """Return the shortest story there is from where the robot is, best with a way round; None without any."""
        start = self._nearest()
        return None if start is None else self._best([start], self._goals())

    def stage_by(self, way: UnknownWay) -> Stage | None:
        """Return the shortest story with a way round that begins where the robot was led; None without any."""
        near = self._facing_all_ways(way.path[0])
        best = self._best(near, self._goals())
        return best if best is not None and best.has_way_round else None

    def stage_anywhere(self) -> Stage | None:
        """Return a story with a way round, wherever the robot must be carried for it; None without any."""
        nodes = list(self.graph.nodes)
        best = self._best(nodes[:: max(1, len(nodes) // DIRECTIONS)], self._goals()) if nodes else None
        return best if best is not None and best.has_way_round else None

    def unknown_way(self) -> UnknownWay | None:
        """Return a way that the map lacks and that gives it a way round a door; None where there is none."""
        nodes = list(self.graph.nodes)
        mapped = self._truth.poses(nodes)[:, :2].reshape(-1, 2)
        found = find_unknown_way(self.world.base, self.world.state, mapped) if nodes else None
        self.unknown_way_found = found
        return found

    def start_of(self, way: UnknownWay) -> NodeId:
        """Return the node at the beginning of a way, the one that looks along it best."""
        nodes = list(self.graph.nodes)
        poses, ahead = self._truth.poses(nodes), way.path[min(_AHEAD, len(way.path) - 1)] - way.path[0]
        away_m = np.hypot(*(poses[:, :2] - way.path[0]).T)
        turned = np.abs(wrap_angle(poses[:, 2] - np.arctan2(ahead[1], ahead[0])))
        return nodes[int(np.argmin(away_m + _YAW_WEIGHT_M * turned))]

    def pose(self, node: NodeId) -> Pose:
        """Return where a node is, (3,)."""
        return self._truth.poses([node])[0]

    def room(self, point: NDArray[np.float64]) -> str:
        """Return what the room around a point (2,) is called."""
        x, y = point
        kinds = (
            room.kind.value for room in self.world.base.rooms if room.x0 <= x <= room.x1 and room.y0 <= y <= room.y1
        )
        return next(kinds, "scene")

    def passes(self, nodes: Sequence[NodeId], door: int) -> bool:
        """Tell whether a way leads through a door."""
        return bool(self._ways.edges_through(list(itertools.pairwise(nodes)), door))

    def wait_s(self, stage: Stage) -> float:
        """Return after how many seconds the map would try the door of a story again; the longest if never."""
        presence = self.system.presence
        if presence is None:
            return _WAITS_S[0]
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

    def _goals(self) -> list[NodeId]:
        nodes = list(self.graph.nodes)
        return nodes[:: max(1, len(nodes) // MOST_GOALS)]

    def _best(self, starts: Sequence[NodeId], goals: Sequence[NodeId]) -> Stage | None:
        return StageSearch(self.graph, self._planner(), self._ways).best(starts, goals)

    def _planner(self) -> Planner:
        return Planner(self.graph, self.system.method.planning, weight=self.system.edge_weight)

    def _nearest(self) -> NodeId | None:
        robot, nodes = self.robot(), list(self.graph.nodes)
        if not nodes:
            return None
        poses = self._truth.poses(nodes)
        away = np.hypot(*(poses[:, :2] - robot[:2]).T)
        if away.min() > NEAREST_M:
            return None
        turned = np.abs(wrap_angle(poses[:, 2] - robot[2]))
        return nodes[int(np.argmin(away + _YAW_WEIGHT_M * turned))]

    def _facing_all_ways(self, point: NDArray[np.float64]) -> list[NodeId]:
        """Return nodes near a point (2,), in each ring one for each direction in which one looks."""
        nodes = list(self.graph.nodes)
        poses = self._truth.poses(nodes)
        away_m = np.hypot(*(poses[:, :2] - point).T)
        directions = np.floor(poses[:, 2] / (2 * np.pi) * DIRECTIONS).astype(int) % DIRECTIONS
        rings = np.floor(away_m / START_WITHIN_M * RINGS).astype(int)
        order = [int(k) for k in np.argsort(away_m) if away_m[k] < START_WITHIN_M]
        return [nodes[k] for k in {(int(rings[k]), int(directions[k])): k for k in reversed(order)}.values()]
