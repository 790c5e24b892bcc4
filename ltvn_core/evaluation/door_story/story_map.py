"""Where the story happens: the places of the shipped map of the demo apartment, and what its map knows there.

Reads exact poses to set up the story; the robot does not use them.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.deltas import Belief, Edge
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.planner import GraphPath, Planner
from ltvn_core.graph.presence.edge_presence import EdgeProbabilities, plan_by_presence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.scene import Scene
from ltvn_core.types import FrameId, NodeId, Observation, Pose

NO_STORY = "The story plays in the shipped map of the demo apartment, as it was built. Open it with: ltvn app"
SCENE, DOOR = "demo", 0
START, GOAL, LED_FROM = NodeId(1669), NodeId(2202), NodeId(1294)
"""Nodes of the shipped map: where the robot starts, its goal behind the door, and the begin of `LED_ALONG`."""
_PLACES = {START: (5.597, 1.529), GOAL: (4.454, 6.237), LED_FROM: (5.268, 2.027)}
"""Positions of these nodes in metres, by which the shipped map is known from another of this apartment."""
_SAME_M = 0.01
TABLE = "own/high-table-1"
"""The piece of furniture that blocks the way through the kitchen."""
LED_ALONG = np.array(
    [(5.38, 2.03), (4.82, 1.63), (4.42, 1.63), (3.78, 1.88), (3.52, 2.38), (3.38, 2.92), (3.18, 3.52), (3.18, 4.18)]
)
"""(M, 2) the way through the kitchen in metres, which the map lacks; it begins and ends on floor that is in the map."""
_UNKNOWN_M = 0.7
"""Distance from all nodes beyond which the floor counts as not mapped, in metres."""
_BESIDE_M = 0.15
"""Greatest distance between a doorway and a path through it, in metres; an edge is straight, a drive is not."""
WRONG_EDGE = START, GOAL
_WRONG_WAYPOINT, _WRONG_BELIEF = (0.6, 0.0, 0.0), Belief(0.6, 0.6, 0.02)
_WRONG_FAILURES = 2
_WAITS_S = (0.0, 600.0, 1800.0, 3600.0, 2 * 3600.0, 4 * 3600.0, 8 * 3600.0, 16 * 3600.0, 24 * 3600.0)


def why_no_story(scene: Scene, graph: TopologicalGraph, observation: Callable[[FrameId], Observation]) -> str:
    """Return why the story cannot be played in a map, and what to do; empty if it can.

    `observation` returns a node's image.
    """
    if scene.address != SCENE or any(node not in graph.nodes for node in _PLACES):
        return NO_STORY
    for node, place in _PLACES.items():
        pose = observation(node).exact_pose
        if pose is None or np.hypot(*(pose[:2] - place)) > _SAME_M:
            return NO_STORY
    return ""


class StoryMap:
    """The shipped map in its world, which must not change meanwhile. Not safe for several threads."""

    def __init__(
        self,
        graph: TopologicalGraph,
        system: NavigationSystem,
        world: World,
        observation: Callable[[FrameId], Observation],
    ) -> None:
        """Store the parts; `observation` returns a node's image."""
        self.graph = graph
        self.system = system
        self.world = world
        self.observation = observation
        self._truth = GroundTruth(world.base.clearance, observation)

    def pose(self, node: NodeId) -> Pose:
        """Return the exact pose (3,) of a node."""
        return self._truth.pose(node)

    @property
    def knows_other_way(self) -> bool:
        """Whether the whole way through the kitchen is in the map."""
        ends = itertools.pairwise(LED_ALONG)
        way = np.concatenate([np.linspace(*each, 5) for each in ends])
        away = way[:, None] - self._places(list(self.graph.nodes))[None]
        return bool(np.hypot(*away.transpose(2, 0, 1)).min(1).max() < _UNKNOWN_M)

    def passes(self, nodes: Sequence[NodeId]) -> bool:
        """Tell whether a path leads through the door."""
        return bool(self.through_door(list(itertools.pairwise(nodes))))

    def wait_s(self, *, at_least_s: float = 0.0) -> float:
        """Return the time in seconds after which the map would plan through the door; the longest one if never."""
        presence = self.system.presence
        for wait_s in _WAITS_S:
            if wait_s >= at_least_s:
                open_then = presence.probabilities(self.graph, self.world.time_s + wait_s)
                if self.passes(self._plan(open_then).nodes):
                    return wait_s
        return _WAITS_S[-1]

    def wrong_edge(self) -> Edge:
        """Return an edge of a map that takes what lies ahead of the start for the goal, and that failed before."""
        return Edge(
            *WRONG_EDGE, waypoint=pose_row(np.array(_WRONG_WAYPOINT)), belief=_WRONG_BELIEF, attempts=_WRONG_FAILURES
        )

    def through_door(self, edges: Sequence[EdgeKey]) -> list[EdgeKey]:
        """Return the edges whose straight lines lead through the doorway."""
        edges = [edge for edge in edges if edge != WRONG_EDGE]
        doorway = self.world.base.parts.doors[DOOR]
        ends = self._places([node for edge in edges for node in edge]).reshape(-1, 2, 2)
        across = ends[:, :, doorway.axis] - doorway.wall
        along = ends[:, :, 1 - doorway.axis]
        passes = across[:, 0] * across[:, 1] < 0
        gap = np.where(passes, across[:, 0] - across[:, 1], 1.0)
        at = along[:, 0] + across[:, 0] / gap * (along[:, 1] - along[:, 0])
        through = passes & (at > doorway.low - _BESIDE_M) & (at < doorway.high + _BESIDE_M)
        return [edges[k] for k in np.flatnonzero(through).tolist()]

    def _plan(self, open_then: EdgeProbabilities) -> GraphPath:
        planner = Planner(self.graph, self.system.method.planning, weight=self.system.edge_weight)
        weight = self.system.method.planning.belief_weight
        return plan_by_presence(planner, START, GOAL, {}, open_then, belief_weight=weight)

    def _places(self, nodes: Sequence[NodeId]) -> NDArray[np.float64]:
        return self._truth.poses(nodes)[:, :2]
