"""The goals a person can choose from by picture: a gallery of different places, and look-alikes of an upload.

Owns which are offered and their thumbnails. Pictures come from the map in the worker's thread.
"""

from collections.abc import Sequence

from ltvn_core.types import FrameId, NodeId, Rgb
from ltvn_viz.gallery import spread
from ltvn_viz.history import GraphView
from ltvn_viz.mapping import Mapping
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.worker import Worker

GALLERY_SIZE = 12
LOOKALIKES = 4
GROWTH = 1.15
"""The gallery is chosen anew when the map has grown by this factor, so that it does not flicker while one drives."""


class Goals:
    """What is offered and what is chosen."""

    def __init__(self, mapping: Mapping, worker: Worker, thumbnails: Thumbnails) -> None:
        """Offer places of the live map."""
        self._mapping, self._worker, self._thumbnails = mapping, worker, thumbnails
        self.selected: NodeId | None = None
        self.gallery: tuple[NodeId, ...] = ()
        self.lookalikes: tuple[NodeId, ...] = ()
        self._graph: GraphView | None = None
        self._chosen_of = 0

    def refresh(self, graph: GraphView) -> None:
        """Bring the gallery up to date with the map."""
        if graph is self._graph:
            return
        self._graph = graph
        known = set(graph.ids.tolist())
        if self.selected not in known:
            self.selected = None
        self.lookalikes = tuple(node for node in self.lookalikes if node in known)
        grown = len(known) >= self._chosen_of * GROWTH or len(self.gallery) < min(GALLERY_SIZE, len(known))
        if grown or not known.issuperset(self.gallery):
            self._chosen_of = len(known)
            self.offer([int(graph.ids[row]) for row in spread(graph.poses, GALLERY_SIZE)])

    def offer(self, nodes: Sequence[NodeId]) -> None:
        """Offer these nodes as soon as their pictures are at hand."""

        def show(pictures: Sequence[tuple[FrameId, Rgb]]) -> None:
            self._keep(pictures)
            self.gallery = tuple(frame for frame, _ in pictures)

        self._worker.submit(lambda: self._mapping.pictures(nodes), show)

    def offer_lookalikes(self, nodes: Sequence[NodeId], pictures: Sequence[tuple[FrameId, Rgb]]) -> None:
        """Offer nodes that look like an upload, best first."""
        self._keep(pictures)
        self.lookalikes = tuple(nodes)

    def _keep(self, pictures: Sequence[tuple[FrameId, Rgb]]) -> None:
        for frame, rgb in pictures:
            self._thumbnails.put(frame, rgb)
