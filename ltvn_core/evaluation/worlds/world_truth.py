"""The ground truth of a map in a simulated world: edges that are closed now, doors on edges, and rooms of nodes.

An edge is closed if its straight line is free in the unchanged scene and blocked now. For evaluation, and for the
maintenances `truth` and `brm-rooms`.
"""

from collections.abc import Callable, Collection, Sequence
from functools import cache, cached_property

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.deltas import PresenceObserved
from ltvn_core.graph.presence.edge_presence import EdgePresence, EdgeProbabilities
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import AttemptEnded, AttemptStarted, Event, GraphChanged
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.oracle_predictor import MIN_CLEARANCE_M, is_line_free
from ltvn_core.simulation.scene import Scene
from ltvn_core.systems.brm import RoomOf
from ltvn_core.types import FrameId, NodeId, Observation
from ltvn_core.worlds import WorldState


class ClosedEdges:
    """The ground truth about edges; results for each door are cached."""

    def __init__(self, scene: Scene, truth: GroundTruth) -> None:
        """Start with an unchanged scene; `truth` has the poses of nodes."""
        self._scene = scene
        self._truth = truth
        self._doors_of = cache(self._find_doors)

    def among(self, edges: Sequence[EdgeKey], now: ClearanceMap) -> list[EdgeKey]:
        """Return the edges that are closed in a world with this clearance map.

        Raises MapError for a map whose images have no exact poses.
        """
        base = self._scene.clearance
        if not edges or now is base:
            return []
        sources, targets = (self._truth.poses(ends) for ends in zip(*edges, strict=True))
        before, after = (is_line_free(clearance, sources, targets, MIN_CLEARANCE_M) for clearance in (base, now))
        return [edge for edge, closed in zip(edges, before & ~after, strict=True) if closed]

    def doors_of(self, edge: EdgeKey) -> frozenset[int]:
        """Return the doors through which an edge leads."""
        return self._doors_of(edge)

    def doors_on(self, edges: Collection[EdgeKey]) -> frozenset[int]:
        """Return the doors through which any of the edges leads."""
        return frozenset(door for edge in edges for door in self._doors_of(edge))

    @cached_property
    def _with_door_closed(self) -> list[ClearanceMap]:
        """The clearance maps with only one door closed, for each door."""
        scenes = ChangedScenes(self._scene)
        doors = range(len(self._scene.parts.doors))
        return [scenes.at(WorldState(closed_doors=frozenset({door}))).clearance for door in doors]

    def _find_doors(self, edge: EdgeKey) -> frozenset[int]:
        closes = (bool(self.among([edge], clearance)) for clearance in self._with_door_closed)
        return frozenset(door for door, closed in enumerate(closes) if closed)


class KnownPresence(EdgePresence):
    """The true presence, which is only known in simulation; it needs no observations."""

    def __init__(self, closed_edges: Callable[[TopologicalGraph], Collection[EdgeKey]]) -> None:
        """Use `closed_edges`, which returns the edges of a map that are closed now."""
        self._closed_edges = closed_edges

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return the closed edges, each with p(open) = 0."""
        return dict.fromkeys(self._closed_edges(graph), 0.0)


class DoorWatch:
    """Counts attempts at closed edges and doors from events."""

    def __init__(self, world: World, closed_edges: ClosedEdges) -> None:
        """Count the attempts of a robot in a world."""
        self._world = world
        self._closed_edges = closed_edges
        self.blocked_tries = 0
        """Number of attempts along edges that were closed at that time."""
        self.door_tries = 0
        """Number of these attempts whose edges lead through a closed door."""
        self.met_closed: set[int] = set()
        """Closed doors on edges that were attempted, or that the map learned to be closed."""
        self.used: set[int] = set()
        """Doors on edges that were driven successfully."""

    def consume(self, event: Event) -> None:
        """Count the next event, while the world still has its state at the event."""
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
        """Tell whether an edge leads through a closed door, and remember the door."""
        doors = self._closed_edges.doors_of(edge) & self._world.state.closed_doors
        self.met_closed |= doors
        return bool(doors)


def true_presence(world: World, observation: Callable[[FrameId], Observation]) -> KnownPresence:
    """Return the true presence of a map's edges in a world; `observation` returns the images of its nodes."""
    closed_edges = ClosedEdges(world.base, GroundTruth(world.base.clearance, observation))
    return KnownPresence(lambda graph: set(closed_edges.among(list(graph.edges), world.scene.clearance)))


def true_rooms(scene: Scene, observation: Callable[[FrameId], Observation]) -> RoomOf:
    """Return a lookup of a node's room, by the exact pose of its image, which `observation` returns.

    The lookup raises MapError for images without exact poses.
    """
    truth = GroundTruth(scene.clearance, observation)

    @cache  # Nodes do not move.
    def room_of(node: NodeId) -> int | None:
        x, y, _ = truth.poses([node])[0]
        return room_at(scene, x, y)

    return room_of


def room_at(scene: Scene, x: float, y: float) -> int | None:
    """Return the number of the room around a point; None outside all rooms."""
    inside = (k for k, room in enumerate(scene.rooms) if room.x0 <= x <= room.x1 and room.y0 <= y <= room.y1)
    return next(inside, None)
