"""What the map learned in a story, counted from events: which edges were absent, which are back, what is new."""

from dataclasses import dataclass, field

from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, NodeAdded, PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Event, GraphChanged


@dataclass
class StoryFacts:
    """Counts while the story goes on."""

    absent: list[EdgeKey] = field(default_factory=list)
    """Edges that were seen blocked, or pruned, in this order."""
    returned: set[EdgeKey] = field(default_factory=set)
    """Edges of these that were seen open later."""
    nodes_added: int = 0
    edges_added: int = 0
    rerouted: bool = False
    """Whether a plan turned away from the door."""

    @property
    def added(self) -> int:
        """Nodes and edges that driving brought in."""
        return self.nodes_added + self.edges_added

    @property
    def are_all_back(self) -> bool:
        """Whether every edge that was absent returned."""
        return bool(self.absent) and self.returned.issuperset(self.absent)

    def take(self, event: Event) -> None:
        """Count one event."""
        if not isinstance(event, GraphChanged):
            return
        match event.delta:
            case PresenceObserved(source, target, present):
                if not present and (source, target) not in self.absent:
                    self.absent.append((source, target))
                elif present and (source, target) in self.absent:
                    self.returned.add((source, target))
            case EdgePruned(source, target):
                self.absent.append((source, target))
            case NodeAdded():
                self.nodes_added += 1
            case EdgeAdded():
                self.edges_added += 1
            case _:
                pass
