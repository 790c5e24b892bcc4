"""Ways along the nodes of a map: how long they are, how long they take, and through which doorways they lead.

Reads exact poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.geometry import relative
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.simulation.rooms import Doorway
from ltvn_core.types import NodeId

_SPEED_M_S, _BACKWARDS_M_S, _TURN_RAD_S = 0.35, 0.1, 0.6
"""About how fast a robot gets on by its map."""
_STANDING_M = 0.1
"""A robot that backs up by less than this rather stands."""
_BESIDE_M = 0.15
"""A way may pass so far beside a doorway, because an edge is straight and a drive is not."""


@dataclass(frozen=True, slots=True, eq=False)
class MappedWays:
    """What ways along nodes are in truth."""

    truth: GroundTruth
    doors: Sequence[Doorway]

    def edges_through(self, edges: Sequence[EdgeKey], door: int) -> list[EdgeKey]:
        """Return those edges whose straight ways lead through a doorway."""
        if not edges:
            return []
        ends = self.truth.poses([node for edge in edges for node in edge])[:, :2].reshape(-1, 2, 2)
        return [edges[k] for k in np.flatnonzero(_are_through(ends, self.doors[door])).tolist()]

    def length_m(self, nodes: Sequence[NodeId]) -> float:
        """Return how long the way along nodes is."""
        if len(nodes) < 2:
            return 0.0
        steps = np.diff(self.truth.poses(list(nodes))[:, :2], axis=0)
        return float(np.hypot(*steps.T).sum())

    def duration_s(self, nodes: Sequence[NodeId]) -> float:
        """Return about how long driving along nodes takes; backwards it is slow."""
        if len(nodes) < 2:
            return 0.0
        poses = self.truth.poses(list(nodes))
        steps = relative(poses[:-1], poses[1:])
        speeds_m_s = np.where(steps[:, 0] > 0, _SPEED_M_S, _BACKWARDS_M_S)
        turns_s = np.abs(steps[:, 2]) / _TURN_RAD_S
        return float((np.hypot(steps[:, 0], steps[:, 1]) / speeds_m_s + turns_s).sum())

    def is_backwards(self, nodes: Sequence[NodeId]) -> bool:
        """Tell whether driving along nodes means to back up somewhere."""
        poses = self.truth.poses(list(nodes))
        return bool((relative(poses[:-1], poses[1:])[:, 0] < -_STANDING_M).any())


def _are_through(ends: NDArray[np.float64], doorway: Doorway) -> NDArray[np.bool_]:
    """Tell which straight ways (N, 2, 2) in metres lead through a doorway, (N,)."""
    across, along = ends[:, :, doorway.axis] - doorway.wall, ends[:, :, 1 - doorway.axis]
    passes = across[:, 0] * across[:, 1] < 0
    gap = np.where(passes, across[:, 0] - across[:, 1], 1.0)
    at = along[:, 0] + across[:, 0] / gap * (along[:, 1] - along[:, 0])
    return passes & (at > doorway.low - _BESIDE_M) & (at < doorway.high + _BESIDE_M)
