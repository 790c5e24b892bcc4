"""The live camera picture: the image of the method, and a larger one for people.

A larger picture is rendered in a separate thread, for the newest pose: requests that arrive during rendering replace
each other and are counted. So the picture never delays driving, and while no page shows it nothing is rendered.
"""

import logging
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ltvn_core.robots.robot import Clock
from ltvn_core.types import Observation, Pose
from ltvn_viz.session.snapshot import CameraImage

logger = logging.getLogger(__name__)

IMAGES_PER_S = 12.0
RESTS = 3.0  # After each picture, times as long as it was computed: at most a quarter of a core is taken.
STILL_S = 0.3  # What did not change for so long is rendered once more, finely.


class LargerImage(NamedTuple):
    """The larger picture on show."""

    jpeg: bytes = b""
    dropped: int = 0
    """Number of pictures that were skipped because a newer one was requested."""


def image_of(seen: Observation) -> CameraImage:
    """Return an image as the page shows it, with the robot's own one if that is larger."""
    own = seen.original
    return CameraImage(seen.rgb, seen.depth, own.jpeg if own and own.camera.width > seen.rgb.shape[1] else b"")


class ObservationFeed:
    """The robot's own images, which the method uses."""

    def __init__(self, newest: Callable[[], Observation | None], clock: Clock) -> None:
        """Show the image that `newest` returns; `clock` is the robot's."""
        self._newest = newest
        self._clock = clock
        self._shown: tuple[Observation, CameraImage] | None = None

    def latest_image(self) -> tuple[CameraImage | None, float]:
        """Return the newest image and its age in seconds."""
        seen = self._newest()
        if seen is None:
            return None, 0.0
        if self._shown is None or self._shown[0] is not seen:
            self._shown = seen, image_of(seen)
        return self._shown[1], max(0.0, self._clock.now() - seen.stamp)


class _RenderRequest(NamedTuple):
    pose: Pose
    look: object = None  # Of the world; a different object means that the picture differs even from the same pose.
    is_fine: bool = False

    def sees_as(self, other: "_RenderRequest") -> bool:
        """Tell whether both requests show the same."""
        return self.look is other.look and np.array_equal(self.pose, other.pose)


class LargerFeed:
    """Renders a larger picture from the newest pose: coarse and several times a second in motion, fine at rest."""

    def __init__(
        self,
        render: Callable[[Pose, bool], bytes],
        clock: Callable[[], float] = time.monotonic,
        *,
        look: Callable[[], object] = lambda: None,
    ) -> None:
        """Start the thread that calls `render`, which returns a JPEG, fine or not. `look` returns a different object
        when the world changed."""
        self._render = render
        self._clock = clock
        self._look = look
        self._change = threading.Condition()
        self._wanted: _RenderRequest | None = None
        self._asked = self._last = _RenderRequest(np.full(3, np.nan))
        self._due = self._changed = float("-inf")
        self._shown = LargerImage()
        self._closing = False
        self._thread = threading.Thread(target=self._draw_forever, name="larger feed", daemon=True)
        self._thread.start()

    def latest_image(self, pose: Pose, *, is_shown: bool) -> LargerImage:
        """Return the newest picture, and request one from `pose` (3,) if a page shows it."""
        if not is_shown:
            return self._shown
        now = self._clock()
        request = _RenderRequest(pose.copy(), self._look())
        if not request.sees_as(self._last):
            self._changed = now
        self._last = request
        request = request._replace(is_fine=now - self._changed >= STILL_S)
        with self._change:
            is_new = not request.sees_as(self._asked) or request.is_fine > self._asked.is_fine
            if is_new and now >= self._due:
                self._shown = self._shown._replace(dropped=self._shown.dropped + (self._wanted is not None))
                self._asked = self._wanted = request
                self._due = now + 1 / IMAGES_PER_S
                self._change.notify()
            return self._shown

    def close(self) -> None:
        """End the thread."""
        with self._change:
            self._closing = True
            self._change.notify()
        self._thread.join(timeout=2.0)

    def _draw_forever(self) -> None:
        while (wish := self._next()) is not None:
            began = time.thread_time()
            try:
                jpeg = self._render(wish.pose, wish.is_fine)
            except Exception:
                logger.exception("the larger image could not be rendered")
                self._shown = LargerImage()  # The method's image fills the place.
                return
            with self._change:
                self._shown = self._shown._replace(jpeg=jpeg)
                self._due = max(self._due, self._clock() + RESTS * (time.thread_time() - began))

    def _next(self) -> _RenderRequest | None:
        with self._change:
            self._change.wait_for(lambda: self._closing or self._wanted is not None)
            wish, self._wanted = self._wanted, None
            return None if self._closing else wish
