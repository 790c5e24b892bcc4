"""Watches one query: which closed edges it tried, which doors it met closed, and which it drove through."""

from ltvn_core.evaluation.worlds.closed_edges import ClosedEdges
from ltvn_core.graph.deltas import PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import AttemptEnded, AttemptStarted, Event, GraphChanged
from ltvn_core.simulation.changes.world import World


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
