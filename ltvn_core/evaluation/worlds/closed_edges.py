"""Which edges of a map the doors of a scene close, and which are closed in any state of its world, by the truth.

Owns the geometry: the straight way of an edge is free in the scene as it was made and is not any more.
"""

from collections.abc import Collection, Sequence
from functools import cache

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.oracle_predictor import MIN_CLEARANCE_M, is_line_free
from ltvn_core.simulation.scene import Scene
from ltvn_core.worlds.world_state import WorldState


class ClosedEdges:
    """Asks the truth about edges; answers for one door are kept."""

    def __init__(self, scene: Scene, truth: GroundTruth) -> None:
        """Ask about edges in a scene as it was made; `truth` knows where nodes are."""
        self._base = scene.clearance
        self._truth = truth
        scenes, doors = ChangedScenes(scene), range(len(scene.parts.doors))
        self._with_door_closed = [scenes.at(WorldState(closed_doors=frozenset({door}))).clearance for door in doors]
        self._doors_of = cache(self._find_doors)

    def among(self, edges: Sequence[EdgeKey], now: ClearanceMap) -> list[EdgeKey]:
        """Return the edges that are closed where the world has this clearance map."""
        if not edges or now is self._base:
            return []
        sources, targets = (self._truth.poses(ends) for ends in zip(*edges, strict=True))
        before, after = (is_line_free(clearance, sources, targets, MIN_CLEARANCE_M) for clearance in (self._base, now))
        return [edge for edge, closed in zip(edges, before & ~after, strict=True) if closed]

    def doors_of(self, edge: EdgeKey) -> frozenset[int]:
        """Return the doors through which an edge leads."""
        return self._doors_of(edge)

    def doors_on(self, edges: Collection[EdgeKey]) -> frozenset[int]:
        """Return the doors through which any of the edges leads."""
        return frozenset(door for edge in edges for door in self._doors_of(edge))

    def _find_doors(self, edge: EdgeKey) -> frozenset[int]:
        closes = (bool(self.among([edge], clearance)) for clearance in self._with_door_closed)
        return frozenset(door for door, closed in enumerate(closes) if closed)
