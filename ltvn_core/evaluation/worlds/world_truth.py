"""What the simulated world knows of a map: which edges are closed now, through which doors they lead, and its rooms.

An edge is closed where its straight way is free in the scene as it was made, and is not any more. For judging, and for
the maintenances `truth` and `brm-rooms`.
"""

from collections.abc import Callable, Collection, Sequence
from functools import cache, cached_property

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.deltas import PresenceObserved
from ltvn_core.graph.presence.edge_presence import KnownPresence
from ltvn_core.graph.topological_graph import EdgeKey
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
    """Asks the truth about edges; answers for one door are kept."""

    def __init__(self, scene: Scene, truth: GroundTruth) -> None:
        """Ask about edges in a scene as it was made; `truth` knows where nodes are."""
        self._scene = scene
        self._truth = truth
        self._doors_of = cache(self._find_doors)

    def among(self, edges: Sequence[EdgeKey], now: ClearanceMap) -> list[EdgeKey]:
        """Return the edges that are closed where the world has this clearance map.

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
        """The clearance map with each door closed alone."""
        scenes = ChangedScenes(self._scene)
        doors = range(len(self._scene.parts.doors))
        return [scenes.at(WorldState(closed_doors=frozenset({door}))).clearance for door in doors]

    def _find_doors(self, edge: EdgeKey) -> frozenset[int]:
        closes = (bool(self.among([edge], clearance)) for clearance in self._with_door_closed)
        return frozenset(door for door, closed in enumerate(closes) if closed)


class DoorWatch:
    """Counts while events come in."""

    def __init__(self, world: World, closed_edges: ClosedEdges) -> None:
        """Watch a robot in a world."""
        self._world = world
        self._closed_edges = closed_edges
        self.blocked_tries = 0
        """Attempts along edges that were closed at that moment."""
        self.door_tries = 0
        """Those of them through closed doors, which no detour leads round."""
        self.met_closed: set[int] = set()
        """Closed doors on edges that were attempted, or that the map learned are closed."""
        self.used: set[int] = set()
        """Doors on edges that were driven with success."""

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


def true_presence(world: World, observation: Callable[[FrameId], Observation]) -> KnownPresence:
    """Return what tells which edges of a map are open; `observation` returns the images of its nodes."""
    closed_edges = ClosedEdges(world.base, GroundTruth(world.base.clearance, observation))
    return KnownPresence(lambda graph: set(closed_edges.among(list(graph.edges), world.scene.clearance)))


def true_rooms(scene: Scene, observation: Callable[[FrameId], Observation]) -> RoomOf:
    """Return what tells the rooms of nodes; `observation` returns their images.

    It raises MapError for images that have no exact poses.
    """
    truth = GroundTruth(scene.clearance, observation)

    @cache  # Nodes do not move.
    def room_of(node: NodeId) -> int | None:
        x, y, _ = truth.poses([node])[0]
        return room_at(scene, x, y)

    return room_of


def room_at(scene: Scene, x: float, y: float) -> int | None:
    """Return the number of the room around a point, None outside all."""
    inside = (k for k, room in enumerate(scene.rooms) if room.x0 <= x <= room.x1 and room.y0 <= y <= room.y1)
    return next(inside, None)
