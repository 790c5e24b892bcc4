"""The images of goal, subgoal and localised node in the Rerun viewer.

The viewer cannot look up the image of another step, so the pictures are logged once more when the navigator names their
node. Owns which compressed images stay in memory for that.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator

import rerun as rr

from ltvn_core.graph.deltas import FramesReserved, NodeAdded
from ltvn_core.navigation import events as ev
from ltvn_core.recording import schema
from ltvn_core.recording.map_drawing import DrawnEntity
from ltvn_core.types import FrameId, NodeId

_RECENT_BYTES = 8 << 20
"""Size of the newest images that are kept because one of them may become a node."""


class NodeImages:
    """Remembers the JPEG of every image of the map, and draws those that an event names."""

    def __init__(self) -> None:
        self._of_map: dict[FrameId, bytes] = {}
        self._recent: OrderedDict[FrameId, bytes] = OrderedDict()
        self._recent_bytes = 0
        self._drawn: dict[str, NodeId | None] = {}

    def add_frame(self, frame: FrameId, jpeg: bytes) -> None:
        """Remember an image; one that is not of the map is forgotten after some megabytes of others."""
        self._recent[frame] = jpeg
        self._recent_bytes += len(jpeg)
        while self._recent_bytes > _RECENT_BYTES:
            self._recent_bytes -= len(self._recent.popitem(last=False)[1])

    def keep(self, frames: Iterable[FrameId]) -> None:
        """Keep images that belong to the map for as long as the recording lasts."""
        for frame in frames:
            if frame in self._recent:
                self._of_map[frame] = self._recent.pop(frame)
                self._recent_bytes -= len(self._of_map[frame])

    def draw(self, event: ev.Event) -> Iterator[DrawnEntity]:
        """Yield the images of the nodes that an event names, where they are not shown already."""
        match event:
            case ev.GraphChanged(delta=NodeAdded(node=node)):
                self.keep([node.id])
            case ev.GraphChanged(delta=FramesReserved(frames=frames)):
                self.keep(frames)
            case ev.QueryStarted(goal=goal):
                yield from self._image(schema.GOAL_IMAGE, goal)
            case ev.Localised(node=node) if node is not None:
                yield from self._image(schema.NODE_IMAGE, node)
            case ev.AttemptStarted(target=target):
                yield from self._image(schema.SUBGOAL_IMAGE, target)
            case _:
                pass

    def _image(self, entity: str, node: NodeId) -> Iterator[DrawnEntity]:
        if self._drawn.get(entity) != node and (jpeg := self._of_map.get(node)) is not None:
            self._drawn[entity] = node
            yield DrawnEntity(entity, [rr.EncodedImage(contents=jpeg, media_type="image/jpeg")])
