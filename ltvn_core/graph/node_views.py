"""Views: images of nodes taken at other times, beside the image that names the node.

Owns the views and their invariants, and which view of a node is the least useful. Does not own their images
(`graph.keyframes`), how they are compared (`graph.matching`) nor when one is added (`navigation.view_learner`).
"""

import math
from collections.abc import KeysView, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Self, TypeAlias

from ltvn_core.errors import MapError
from ltvn_core.graph.deltas import Cause, NodeView, ViewAdded, ViewDropped, ViewUsed
from ltvn_core.types import FrameId, NodeId

Views: TypeAlias = Mapping[NodeId, tuple[NodeView, ...]]
"""The views of each node that has any."""

NO_VIEWS: Views = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class ViewConfig:
    """When a node gets a view, and how many it may have. All values are ours."""

    most: int = 2
    """Largest number of views of a node beside its own image. That image always stays: it names the node, its depth
    shows what was solid when the map was made, and its look may return, by day or with a door open."""
    distance: float = 0.5
    """Largest d between a view and its node."""
    recognised_above: float = 0.5
    """A node with a higher r is recognised and needs no view."""
    half_life_s: float = 86400.0
    """Time without use after which the uses of a view count half, in seconds."""

    def usefulness(self, view: NodeView, now_s: float) -> float:
        """Return how useful a view is; one that is taken now counts as one use now."""
        return (view.uses + 1) * 0.5 ** (max(0.0, now_s - view.used_s) / self.half_life_s)


def view_deltas(views: Views, node: NodeId, view: NodeView, config: ViewConfig) -> tuple[ViewDropped | ViewAdded, ...]:
    """Return the deltas that give a node a view, and drop the least useful one if there are too many."""
    held = views.get(node, ())
    left = sorted(held, key=lambda each: config.usefulness(each, view.used_s))[: max(0, len(held) + 1 - config.most)]
    dropped = (ViewDropped(node, each.frame, Cause.SIGHT) for each in left)
    return (*dropped, ViewAdded(node, view, Cause.SIGHT))


class NodeViews:
    """The views of all nodes of one map."""

    def __init__(self) -> None:
        """Start without views."""
        self._by_node: dict[NodeId, tuple[NodeView, ...]] = {}
        self._owners: dict[FrameId, NodeId] = {}

    @property
    def by_node(self) -> Views:
        """Views by node, in the order of their frames; read only, and always as the map is now."""
        return MappingProxyType(self._by_node)

    @property
    def frames(self) -> KeysView[FrameId]:
        """The images of all views."""
        return self._owners.keys()

    def add(self, node: NodeId, view: NodeView) -> None:
        """Give a node a view. Raises MapError for an image that is a view already, and for invalid numbers."""
        if view.frame in self._owners:
            raise MapError(f"Frame {view.frame} is a view of node {self._owners[view.frame]} already.")
        if not all(map(math.isfinite, (*view.pose, view.used_s))) or view.uses < 0:
            raise MapError(
                f"View {view.frame} of node {node} has {view}; its numbers must be finite and its uses >= 0."
            )
        self._by_node[node] = tuple(sorted((*self._by_node.get(node, ()), view), key=_frame))
        self._owners[view.frame] = node

    def use(self, used: ViewUsed) -> None:
        """Count a use of a view. Raises MapError if the node has no such view."""
        self._require(used.node, used.frame)
        if not math.isfinite(used.stamp):
            raise MapError(f"View {used.frame} was used at {used.stamp} s; a moment must be finite.")
        self._by_node[used.node] = tuple(
            replace(view, uses=view.uses + 1, used_s=used.stamp) if view.frame == used.frame else view
            for view in self._by_node[used.node]
        )

    def drop(self, node: NodeId, frame: FrameId) -> None:
        """Remove a view. Raises MapError if the node has no such view."""
        self._require(node, frame)
        left = tuple(view for view in self._by_node[node] if view.frame != frame)
        del self._owners[frame]
        if left:
            self._by_node[node] = left
        else:
            del self._by_node[node]

    def forget(self, node: NodeId) -> None:
        """Remove all views of a node."""
        for view in self._by_node.pop(node, ()):
            del self._owners[view.frame]

    def deltas(self, cause: Cause) -> list[ViewAdded]:
        """Return the deltas that add all views."""
        return [ViewAdded(node, view, cause) for node, views in self._by_node.items() for view in views]

    def copy(self) -> Self:
        """Return an independent copy."""
        clone = type(self)()
        clone._by_node = self._by_node.copy()
        clone._owners = self._owners.copy()
        return clone

    def _require(self, node: NodeId, frame: FrameId) -> None:
        if self._owners.get(frame) != node:
            raise MapError(f"Node {node} has no view {frame}.")


def _frame(view: NodeView) -> FrameId:
    return view.frame
