"""Small pictures of nodes by number, as JPEG, for the page's routes.

Owns a bounded store that the session fills and the server's threads read.
"""

import threading
from collections import OrderedDict

import cv2

from ltvn_core.types import FrameId, Rgb

LIMIT = 512


class ThumbnailStore:
    """The latest pictures that a panel may ask for."""

    def __init__(self) -> None:
        """Begin empty."""
        self._lock = threading.Lock()
        self._jpegs: OrderedDict[FrameId, bytes] = OrderedDict()

    def __contains__(self, frame: FrameId) -> bool:
        """Tell whether a picture is there."""
        with self._lock:
            return frame in self._jpegs

    def put(self, frame: FrameId, rgb: Rgb) -> None:
        """Keep a picture (H, W, 3); the oldest goes when there are too many."""
        _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88])
        with self._lock:
            self._jpegs[frame] = jpeg.tobytes()
            self._jpegs.move_to_end(frame)
            while len(self._jpegs) > LIMIT:
                self._jpegs.popitem(last=False)

    def get(self, frame: FrameId) -> bytes | None:
        """Return a picture as JPEG. May be called from any thread."""
        with self._lock:
            return self._jpegs.get(frame)
