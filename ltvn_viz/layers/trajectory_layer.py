"""Where the robot drove."""

import time
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_viz.layers import TRAJECTORY_Z
from ltvn_viz.layers.line_segments import LineSegments
from ltvn_viz.layers.pose_geometry import points
from ltvn_viz.session.snapshot import Snapshot

REDRAW_EVERY_S = 0.4
JUMP_M = 1.5
"""Points further apart were not driven: the robot was set down elsewhere."""


class TrajectoryLayer:
    """One line along all poses of the run."""

    def __init__(self, scene: viser.SceneApi, clock: Callable[[], float] = time.monotonic) -> None:
        """Add the empty line."""
        self.lines = LineSegments(scene, "/trajectory", thickness_px=3.0)
        self._clock = clock
        self._drawn: NDArray[np.float64] | None = None
        self._when = -np.inf

    def show(self, snapshot: Snapshot) -> None:
        """Draw the trajectory when it changed, a few times a second at most."""
        poses = snapshot.moment.trajectory
        if poses is self._drawn or self._clock() - self._when < REDRAW_EVERY_S:
            return
        self._drawn, self._when = poses, self._clock()
        line = points(poses, TRAJECTORY_Z)
        segments = np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else np.empty((0, 2, 3), np.float32)
        segments = segments[np.linalg.norm(segments[:, 0] - segments[:, 1], axis=1) < JUMP_M]
        self.lines.draw(segments, np.full((len(segments), 3), palette.TRAJECTORY, np.uint8))
