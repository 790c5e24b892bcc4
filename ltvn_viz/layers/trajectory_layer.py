"""Where the robot drove, and in a recording where it is going to drive."""

import time
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core import palette
from ltvn_core.analysis.recorded_frames import NO_TRAJECTORY
from ltvn_viz.layers import COURSE_Z, TRAJECTORY_Z
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
        _draw(self.lines, poses, TRAJECTORY_Z, palette.TRAJECTORY)


class CourseLayer:
    """A thin line along all poses of an open recording, so that one sees at its beginning already where it leads."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Add the empty line."""
        self.lines = LineSegments(scene, "/course", thickness_px=1.5)
        self._drawn = NO_TRAJECTORY

    def show(self, snapshot: Snapshot) -> None:
        """Draw the course when another recording was opened."""
        if snapshot.course is not self._drawn:
            self._drawn = snapshot.course
            _draw(self.lines, snapshot.course, COURSE_Z, palette.COURSE)


def _draw(lines: LineSegments, poses: NDArray[np.float64], height_m: float, colour: palette.Rgb8) -> None:
    """Draw a line along poses (T, 3), with a gap where the robot was set down elsewhere."""
    line = points(poses, height_m)
    segments = np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else np.empty((0, 2, 3), np.float32)
    segments = segments[np.linalg.norm(segments[:, 0] - segments[:, 1], axis=1) < JUMP_M]
    lines.draw(segments, np.full((len(segments), 3), colour, np.uint8))
