"""The ground truth of a map in simulation: exact poses of its nodes, and which of its edges are drivable.

`ltvn_core.simulation.oracle_predictor` defines "drivable"; a turn on the spot is also drivable, and so is a free line
of any length if odometry rather than an image supports the edge. Edges are directed: the two directions of one
prediction are two edges, and driving in reverse counts as driving.
"""

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from ltvn_core.errors import LtvnError, MapError
from ltvn_core.evaluation.map_drawing import MapDrawing
from ltvn_core.evaluation.results import EdgeCalibrationBin, MapTruthMetrics
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.maps.map_coverage import Standing, reached_from_most, standings
from ltvn_core.network.metrics import calibration_table
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.oracle_predictor import MIN_CLEARANCE_M, is_drivable, is_line_free
from ltvn_core.types import FrameId, NodeId, Observation, Pose

MISLOCALISED_M = 1.5
"""Distance beyond which a robot is not at a node, in metres (ours; D_l is about 1 m)."""
MISLOCALISED_YAW_RAD = float(np.deg2rad(60))
"""Difference in heading beyond which a robot is not at a node, in radians."""
MISLOCALISED_PATH_M = 2.0
"""Length of the shortest path beyond which a robot is not at a node, in metres; it may lead around a wall."""
AT_ONE_PLACE_M = 0.5
"""Greatest distance between two poses of an edge that is mainly a turn, in metres; there is no obstacle between
them."""
RECOGNISABLE_DISTANCE = 0.75
"""Value of d (Eq. 2) within which a robot should recognise a node: half a metre and 20 degrees (ours; within D_l)."""


class GroundTruth:
    """The ground truth of one scene and of the images that were taken in it."""

    def __init__(
        self,
        clearance: ClearanceMap,
        observation: Callable[[FrameId], Observation],
        *,
        poses: Mapping[FrameId, Pose] | None = None,
    ) -> None:
        """Call `observation` for the image of a node, once per node that is not in `poses`.

        Node ids are frame ids and nodes never move, so results are cached even when the map changes.
        """
        self.clearance = clearance
        self._observation = observation
        self._poses: dict[FrameId, Pose] = dict(poses or {})
        self._drivable: dict[EdgeKey, bool] = {}
        self._free: dict[EdgeKey, bool] = {}
        """Whether the straight line between the nodes is free, by edge."""

    def pose(self, node: NodeId) -> Pose:
        """Return the exact pose (3,) of a node; raise MapError if its image has none."""
        if node not in self._poses:
            exact = self._observation(node).exact_pose
            if exact is None:
                raise MapError(
                    f"The image of node {node} has no exact pose, because it was not taken in "
                    "simulation. Evaluate maps of drives through simulated scenes."
                )
            self._poses[node] = exact
        return self._poses[node]

    def knows(self, frame: FrameId) -> bool:
        """Return whether the exact pose of an image is known."""
        try:
            self.pose(frame)
        except LtvnError:
            return False
        return True

    def poses(self, nodes: Collection[NodeId]) -> Pose:
        """Return exact poses (N, 3); raise MapError if an image has none."""
        return np.array([self.pose(node) for node in nodes], np.float64).reshape(-1, 3)

    def is_spurious(self, edge: EdgeKey, *, by_odometry: bool = False) -> bool:
        """Return whether an edge from one node to the other would be spurious, whether or not the map has it.

        An edge `by_odometry` leads over floor that was seen free, so it may be of any length if its line is free.
        """
        self._judge_edges([edge])
        return not (self._drivable[edge] or (by_odometry and self._free[edge]))

    def spurious(self, graph: TopologicalGraph) -> set[EdgeKey]:
        """Return the spurious edges of a map; the result for each edge is cached."""
        driven = graph.driven_edges  # An edge with an action, such as a lift, needs no floor between its nodes.
        self._judge_edges(driven)
        return {edge for edge in driven if self.is_spurious(edge, by_odometry=graph.edges[edge].by_odometry)}

    def is_at(self, robot: Pose, node: NodeId) -> bool:
        """Return whether the robot at (3,) is at a node, so that a localisation there is correct.

        The robot is at a node if it is within 1.5 m and 60 degrees, and if the shortest path to the node is at most 2
        m, so that no wall separates them.
        """
        gap = relative(robot, self.pose(node))
        if np.hypot(gap[0], gap[1]) > MISLOCALISED_M or abs(gap[2]) > MISLOCALISED_YAW_RAD:
            return False
        way_m = self.clearance.path_lengths(robot, self.pose(node)[:2], limit_m=MISLOCALISED_PATH_M)
        return bool(np.isfinite(way_m[0]))

    def should_recognise_one(self, robot: Pose, nodes: Collection[NodeId]) -> bool:
        """Return whether a robot at (3,) is so close to one of the nodes that it should recognise it."""
        poses = self.poses(nodes)
        poses = poses[distance(relative(robot, poses)) <= RECOGNISABLE_DISTANCE]
        return bool((self.clearance.along(np.broadcast_to(robot[:2], (len(poses), 2)), poses[:, :2]) > 0).any())

    def _judge_edges(self, edges: Collection[EdgeKey]) -> None:
        fresh = [edge for edge in edges if edge not in self._drivable]
        if fresh:
            sources, targets = (self.poses(ends) for ends in zip(*fresh, strict=True))
            free = is_line_free(self.clearance, sources, targets)
            # At one place, a robot can turn by any angle.
            turns = free & (np.hypot(*(targets - sources)[:, :2].T) <= AT_ONE_PLACE_M)
            drivable = is_drivable(self.clearance, sources, targets) | turns
            self._drivable.update(zip(fresh, drivable.tolist(), strict=True))
            self._free.update(zip(fresh, free.tolist(), strict=True))


def shortest_m(clearance: ClearanceMap, start: Pose, goal: Pose) -> float:
    """Return the length in metres of the shortest feasible path between poses (3,), for SPL; inf if there is none.

    At most 3 % too long, because paths around corners follow the grid of the clearance map.
    """
    return float(clearance.path_lengths(start, goal[:2])[0])


def map_truth_metrics(graph: TopologicalGraph, truth: GroundTruth, goals: Sequence[NodeId]) -> MapTruthMetrics:
    """Return the size of a map and its errors.

    A goal is connected if a path leads to it from at least half of the other nodes.
    """
    spurious = truth.spurious(graph)
    told = [standing is not Standing.HELD for standing in standings(graph, goals)]
    reachable = reached_from_most(graph, goals, lambda edge: (edge.source, edge.target) not in spurious)
    return MapTruthMetrics(
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        spurious_edges=len(spurious),
        pieces=len(strongly_connected_components(graph)),
        goals_connected=sum(reached_from_most(graph, goals)),
        goals_told=sum(told),
        goals_told_rightly=sum(is_told and not way for is_told, way in zip(told, reachable, strict=True)),
        goals_untold=sum(not is_told and not way for is_told, way in zip(told, reachable, strict=True)),
    )


def calibration_bins(graph: TopologicalGraph, truth: GroundTruth, bins: int = 10) -> tuple[EdgeCalibrationBin, ...]:
    """Return the calibration of p over a map's edges, in equal bins without the empty ones."""
    spurious = truth.spurious(graph)
    p = np.array([edge.belief.p for edge in graph.edges.values()], np.float64)
    drivable = np.array([edge not in spurious for edge in graph.edges], bool)
    return tuple(
        EdgeCalibrationBin(
            low=cell.low, high=cell.high, edges=cell.pairs, mean_p=cell.predicted, drivable=cell.reachable
        )
        for cell in calibration_table(p, drivable, bins)
        if cell.predicted is not None and cell.reachable is not None
    )


def floorplan(graph: TopologicalGraph, truth: GroundTruth) -> MapDrawing:
    """Return the floor plan with the map, for drawing; rounded to three digits, which keeps the file small."""
    spurious = truth.spurious(graph)
    clearance = truth.clearance
    x_m, y_m = clearance.origin.tolist()
    fits = clearance.grid > MIN_CLEARANCE_M
    return MapDrawing(
        origin=(x_m, y_m),
        resolution_m=clearance.resolution_m,
        free=tuple("".join(row) for row in np.where(fits, ".", "#")),
        nodes=tuple((node, *_numbers(truth.pose(node))) for node in graph.nodes),
        edges=tuple((*key, round(edge.belief.p, 3), key in spurious) for key, edge in graph.edges.items()),
    )


def _numbers(pose: Pose) -> tuple[float, float, float]:
    x_m, y_m, yaw_rad = pose.round(3).tolist()
    return x_m, y_m, yaw_rad
