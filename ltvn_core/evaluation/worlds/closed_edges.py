"""Which edges of a map are closed in a state of its world, by the truth, and which of them a query met.

An edge is closed where its straight way is free in the scene as it was made, and is not any more.
"""

from collections.abc import Collection, Sequence
from functools import cache

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.deltas import PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import AttemptEnded, AttemptStarted, Event, GraphChanged
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.changes.world import World
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


class DoorWatch:
    """Counts while events come in."""

    def __init__(self, world: World, closed_edges: ClosedEdges) -> None:
        """Watch a robot in a world."""
        self._world, self._closed_edges = world, closed_edges
        self.blocked_tries = 0
        """Attempts along edges that were closed at that moment."""
        self.door_tries = 0
        """Those of them through closed doors, which no detour leads round."""
        self.met_closed: set[int] = set()
        """Closed doors of these, or of edges that the map learned are closed,"""
        self.used: set[int] = set()
        """and doors on edges that were driven with success."""

    def consume(self, event: Event) -> None:
        """Take in the next event while the world is as it was then."""
        if isinstance(event, AttemptStarted) and event.source is not None:
            edge = event.source, event.target
            if self._closed_edges.among([edge], self._world.scene.clearance):
                self.blocked_tries += 1
                self.door_tries += self._meet(edge)
        elif isinstance(event, GraphChanged) and isinstance(event.delta, PresenceObserved):
            if not event.delta.present:
                self._meet((event.delta.source, event.delta.target))
        elif isinstance(event, AttemptEnded) and event.source is not None and event.succeeded:
            self.used |= self._closed_edges.doors_of((event.source, event.target))

    def _meet(self, edge: EdgeKey) -> bool:
        """Tell whether an edge leads through a closed door, and remember which."""
        doors = self._closed_edges.doors_of(edge) & self._world.state.closed_doors
        self.met_closed |= doors
        return bool(doors)
