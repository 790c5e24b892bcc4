"""The view that follows the robot, for those who want it."""

import time
from collections.abc import Callable, Iterable

import numpy as np
import viser

from ltvn_core.types import Pose
from ltvn_viz.session.snapshot import Snapshot

MOVE_EVERY_S = 1 / 15


class FollowCamera:
    """Moves every page's view along with the robot while its box is ticked."""

    def __init__(
        self,
        gui: viser.GuiApi,
        clients: Callable[[], Iterable[viser.ClientHandle]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Add the box to the container that is open, not ticked."""
        self._box = gui.add_checkbox("Follow the robot", initial_value=False, hint="the view moves along with it")
        self._clients, self._clock = clients, clock
        self._at: Pose | None = None
        self._due = float("-inf")

    def show(self, snapshot: Snapshot) -> None:
        """Shift the views by as much as the robot moved."""
        pose = snapshot.moment.robot
        if pose is None or not self._box.value:
            self._at = None
            return
        if self._at is None:
            self._at = pose
        if self._clock() < self._due or np.array_equal(pose[:2], self._at[:2]):
            return
        shift = np.append(pose[:2] - self._at[:2], 0.0)
        self._at, self._due = pose, self._clock() + MOVE_EVERY_S
        for client in self._clients():
            # Setting the position keeps the direction of view.
            client.camera.position = client.camera.position + shift
