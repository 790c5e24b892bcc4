"""Watches one query: which closed edges it tried, and which doors it drove through."""

from ltvn_core.evaluation.worlds.closed_edges import ClosedEdges
from ltvn_core.navigation.events import AttemptEnded, AttemptStarted, Event
from ltvn_core.simulation.changes.world import World


class DoorWatch:
    """Counts while events come in."""

    def __init__(self, world: World, closed_edges: ClosedEdges) -> None:
        """Watch a robot in a world."""
        self._world, self._closed_edges = world, closed_edges
        self.blocked_tries = 0
        """Attempts along edges that were closed at that moment."""
        self.tried: set[int] = set()
        """Closed doors on these edges,"""
        self.used: set[int] = set()
        """and doors on edges that were driven with success."""

    def consume(self, event: Event) -> None:
        """Take in the next event while the world is as it was then."""
        if isinstance(event, AttemptStarted) and event.source is not None:
            edge = event.source, event.target
            if self._closed_edges.among([edge], self._world.scene.clearance):
                self.blocked_tries += 1
                self.tried |= self._closed_edges.doors_of(edge) & self._world.state.closed_doors
        elif isinstance(event, AttemptEnded) and event.source is not None and event.succeeded:
            self.used |= self._closed_edges.doors_of((event.source, event.target))
