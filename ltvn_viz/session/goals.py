"""The goals a person can choose from by picture: a gallery of different places, and look-alikes of an upload.

Owns which are offered and their thumbnails. Pictures come from the map in the worker's thread.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.types import FrameId, NodeId, Pose, Rgb
from ltvn_viz.server.thumbnails import ThumbnailStore
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.worker import Worker

GALLERY_SIZE = 12
SIMILAR_NODE_COUNT = 4
GROWTH = 1.15
"""The gallery is chosen anew when the map has grown by this factor, so that it does not flicker while one drives."""
RADIAN_IN_M = 0.5
"""A turn by a radian makes two views as different as this many metres."""


class Goals:
    """What is offered and what is chosen."""

    def __init__(self, live_map: LiveMap, worker: Worker, thumbnails: ThumbnailStore) -> None:
        """Offer places of the live map."""
        self._live_map, self._worker, self._thumbnails = live_map, worker, thumbnails
        self.selected: NodeId | None = None
        self.gallery: tuple[NodeId, ...] = ()
        self.similar_nodes: tuple[NodeId, ...] = ()
        self._graph: GraphArrays | None = None
        self._chosen_of = 0

    def refresh(self, graph: GraphArrays) -> None:
        """Bring the gallery up to date with the map."""
        if graph is self._graph:
            return
        self._graph = graph
        known = set(graph.ids.tolist())
        if self.selected not in known:
            self.selected = None
        self.similar_nodes = tuple(node for node in self.similar_nodes if node in known)
        grown = len(known) >= self._chosen_of * GROWTH or len(self.gallery) < min(GALLERY_SIZE, len(known))
        if grown or not known.issuperset(self.gallery):
            self._chosen_of = len(known)
            self.offer([int(graph.ids[row]) for row in farthest_points(graph.poses, GALLERY_SIZE)])

    def offer(self, nodes: Sequence[NodeId]) -> None:
        """Offer these nodes as soon as their pictures are at hand."""

        def show(node_images: Sequence[tuple[FrameId, Rgb]]) -> None:
            self._keep(node_images)
            self.gallery = tuple(frame for frame, _ in node_images)

        self._worker.submit(lambda: self._live_map.node_images(nodes), show)

    def offer_similar_nodes(self, nodes: Sequence[NodeId], node_images: Sequence[tuple[FrameId, Rgb]]) -> None:
        """Offer nodes that look like an upload, best first."""
        self._keep(node_images)
        self.similar_nodes = tuple(nodes)

    def _keep(self, node_images: Sequence[tuple[FrameId, Rgb]]) -> None:
        for frame, rgb in node_images:
            self._thumbnails.put(frame, rgb)


def farthest_points(poses: Pose, count: int) -> NDArray[np.int64]:
    """Return up to `count` rows of poses (N, 3) that lie far from each other, farthest point first."""
    if not len(poses):
        return np.empty(0, np.int64)
    embedded = np.concatenate(
        [poses[:, :2], RADIAN_IN_M * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)], axis=1
    )
    chosen = [int(np.argmin(np.linalg.norm(embedded - embedded.mean(axis=0), axis=1)))]
    gap = np.linalg.norm(embedded - embedded[chosen[0]], axis=1)
    while len(chosen) < min(count, len(poses)) and gap.max() > 0:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(embedded - embedded[chosen[-1]], axis=1))
    return np.array(chosen)
