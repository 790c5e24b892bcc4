"""The live camera picture: the image of the method, or a larger one on request.

A larger picture is rendered in a separate thread, for the newest pose: requests that arrive during rendering replace
each other and are counted. So the picture never delays driving, and without requests nothing is rendered.
"""

import logging
import threading
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from ltvn_core.robots.robot import Clock
from ltvn_core.types import Depth, Observation, Pose, Rgb
from ltvn_viz.session.snapshot import CameraImage, ImageSource

logger = logging.getLogger(__name__)

IMAGES_PER_S = 12.0


class FeedImage(NamedTuple):
    """A picture on show and its age."""

    image: CameraImage | None
    age_s: float
    dropped: int
    """Number of pictures that were skipped because a newer one was requested."""


class ImageFeed(Protocol):
    """Pictures of the live camera for the person."""

    def latest_image(self, pose: Pose) -> FeedImage:
        """Request a picture from `pose` (3,) and return the newest one."""
        ...


class ObservationFeed:
    """The robot's own images, which the method uses."""

    def __init__(self, newest: Callable[[], Observation | None], clock: Clock) -> None:
        """Show the image that `newest` returns; `clock` is the robot's."""
        self._newest = newest
        self._clock = clock
        self._shown: tuple[Observation, CameraImage] | None = None

    def latest_image(self, pose: Pose) -> FeedImage:
        """Return the newest image; `pose` is ignored."""
        seen = self._newest()
        if seen is None:
            return FeedImage(None, 0.0, 0)
        if self._shown is None or self._shown[0] is not seen:
            self._shown = seen, CameraImage(seen.rgb, seen.depth)
        return FeedImage(self._shown[1], max(0.0, self._clock.now() - seen.stamp), 0)


class _RenderRequest(NamedTuple):
    """The pose to render from, and the time of the request."""

    pose: Pose
    when: float
    look: object = None
    """State of the world; a different object means that the picture differs even from the same pose."""

    def sees_as(self, other: "_RenderRequest") -> bool:
        """Tell whether both requests give the same picture."""
        return self.look is other.look and np.array_equal(self.pose, other.pose)


class LargerFeed:
    """Renders a larger picture from the newest pose, several times a second."""

    def __init__(
        self,
        render: Callable[[Pose], tuple[Rgb, Depth]],
        clock: Callable[[], float] = time.monotonic,
        *,
        look: Callable[[], object] = lambda: None,
    ) -> None:
        """Start the thread that calls `render`. `look` returns a different object when the world changed."""
        self._render = render
        self._clock = clock
        self._look = look
        self._change = threading.Condition()
        self._wanted: _RenderRequest | None = None
        self._asked = _RenderRequest(np.full(3, np.nan), float("-inf"))
        self._shown: tuple[CameraImage | None, _RenderRequest] = (None, self._asked)
        self._dropped = 0
        self._closing = False
        self._thread = threading.Thread(target=self._draw_forever, name="larger feed", daemon=True)
        self._thread.start()

    def latest_image(self, pose: Pose) -> FeedImage:
        """Request a picture from `pose` (3,) and return the newest one available."""
        now = self._clock()
        request = _RenderRequest(pose, now, self._look())
        with self._change:
            if now - self._asked.when >= 1 / IMAGES_PER_S and not request.sees_as(self._asked):
                self._dropped += self._wanted is not None
                self._asked = self._wanted = request
                self._change.notify()
            image, wish = self._shown
            # While nothing changes, an old picture is as good as a new one.
            age_s = 0.0 if image is None or request.sees_as(wish) else now - wish.when
            return FeedImage(image, age_s, self._dropped)

    def close(self) -> None:
        """End the thread."""
        with self._change:
            self._closing = True
            self._change.notify()
        self._thread.join(timeout=2.0)

    def _draw_forever(self) -> None:
        while (wish := self._next()) is not None:
            try:
                image = CameraImage(*self._render(wish.pose), ImageSource.RENDERED)
            except Exception:
                logger.exception("the larger image could not be rendered")
                return
            with self._change:
                self._shown = image, wish

    def _next(self) -> _RenderRequest | None:
        with self._change:
            self._change.wait_for(lambda: self._closing or self._wanted is not None)
            wish, self._wanted = self._wanted, None
            return None if self._closing else wish
