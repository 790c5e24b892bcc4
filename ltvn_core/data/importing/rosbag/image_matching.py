"""Matches images with the depth and the pose of the same moment, while a bag is streamed.

Owns the queues and their limits. Independent of message types.
"""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

_PATIENCE_S = 1.0
"""Time in seconds after which an image no longer waits for its depth and pose."""
_MOST_BYTES = 2**28
"""Largest size of the waiting images, in bytes."""
_MOST_WAITING = 200


class PendingImage(NamedTuple):
    """An image message in the queue."""

    stamp: float
    """Time when it was taken, in seconds."""
    log_s: float
    """Time when it was recorded, in seconds."""
    message: Any
    size_bytes: int


class MatchedImages(NamedTuple):
    """Colours and the depth of the same moment."""

    colours: PendingImage
    depth: PendingImage | None
    """Depth of the same moment; None if there is no depth topic or no such depth."""


class StampMatcher:
    """Matches colours with depth by their stamps, in the order in which the colours arrived."""

    def __init__(self, *, needs_depth: bool, tolerance_s: float, is_known: Callable[[float], bool]) -> None:
        """Begin with empty queues.

        Args:
            needs_depth: Whether there is a depth topic.
            tolerance_s: Largest difference of stamps in seconds that counts as the same moment.
            is_known: Tells whether the pose at a time has arrived.
        """
        self._needs_depth = needs_depth
        self._tolerance_s = tolerance_s
        self._is_known = is_known
        self.colours: deque[PendingImage] = deque()
        """Images that wait, in the order in which they arrived."""
        self._depths: deque[PendingImage] = deque()

    def add_depth(self, image: PendingImage) -> None:
        """Put a depth image into the queue."""
        self._depths.append(image)
        while len(self._depths) > _MOST_WAITING or _held(self._depths) > _MOST_BYTES:
            self._depths.popleft()

    def ready(self, log_s: float) -> Iterator[MatchedImages]:
        """Yield the images that are complete, or have waited too long, at the log time `log_s`; infinity empties the
        queue."""
        while self.colours:
            first = self.colours[0]
            crowded = len(self.colours) > _MOST_WAITING or _held(self.colours) > _MOST_BYTES
            has_depth = not self._needs_depth or any(depth.stamp >= first.stamp for depth in self._depths)
            is_complete = has_depth and self._is_known(first.stamp)
            if not (crowded or log_s - first.log_s > _PATIENCE_S or is_complete):
                return
            self.colours.popleft()
            while len(self._depths) > 1 and self._depths[0].stamp < first.stamp - self._tolerance_s:
                self._depths.popleft()
            nearest = min(self._depths, key=lambda depth: abs(depth.stamp - first.stamp), default=None)
            is_near = nearest is not None and abs(nearest.stamp - first.stamp) <= self._tolerance_s
            yield MatchedImages(first, nearest if is_near else None)


def _held(images: deque[PendingImage]) -> int:
    return sum(image.size_bytes for image in images)
