"""What the recorder needs of whatever writes a recording."""

from collections.abc import Sequence
from typing import Protocol

from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import StampedEvent
from ltvn_core.types import FrameId, Observation


class RecordingSink(Protocol):
    """Writes one recording; used by one thread at a time."""

    @property
    def failure(self) -> str | None:
        """Why nothing more is written, or None."""
        ...

    def write_map(self, graph: TopologicalGraph, observations: Sequence[Observation]) -> None:
        """Begin with a whole map and its images."""
        ...

    def draw_scene(self, glb: bytes) -> None:
        """Draw the scene, a binary glTF; while another thread writes, too."""
        ...

    def write_frame(self, observation: Observation) -> None:
        """Append an image."""
        ...

    def write_event(self, stamped: StampedEvent) -> None:
        """Append an event."""
        ...

    def draw_graph(self, graph: TopologicalGraph, step: FrameId, stamp: float) -> None:
        """Draw the map."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...
